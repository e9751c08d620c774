#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <span>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/link/client_session.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/server/server.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/studies/bench/pinned_thread.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {
namespace {

constexpr int kBlock = 1000;     // exchanges that are timed together
constexpr int kBlocksEach = 20;  // a round
constexpr std::int64_t kTickNs = 1'000'000;
constexpr double kMost = 1.1;     // of the time without the gate: what this bench can tell
constexpr double kSwingNm = 0.5;  // of the tip, from command to command: some per cent of the force

using Bytes = std::array<std::uint8_t, link::kMaxDatagramBytes>;

/// A server with one session that presses on the sample, up and down by kSwingNm with each command.
class PressedSession {
 public:
  PressedSession(const std::shared_ptr<const scene::Scene>& scene, bool may_leave_out,
                 const link::ReplyDeadband& deadband)
      : server_(server_config(), served(scene)), client_(client_config(may_leave_out)), deadband_(deadband) {
    peer_.port = 4000;
    client_.start(now_ns_);
    Bytes out, in;
    for (int i = 0; i < 2000 && client_.state() != link::ClientState::kEstablished; ++i, now_ns_ += kTickNs) {
      const std::size_t n = client_.poll(now_ns_, out);
      if (n == 0) continue;
      const std::size_t m = server_.on_datagram(std::span(out).first(n), peer_, now_ns_, in);
      if (m > 0) client_.on_datagram(std::span(in).first(m), now_ns_);
    }
    if (client_.state() != link::ClientState::kEstablished) throw RunError("bench: a session does not open");
    if (may_leave_out != ((client_.features() & link::kFeatureReplyDeadband) != 0))
      throw RunError("bench: the reply deadband is not agreed on as it was asked for");
  }

  /// Nanoseconds of processor time an exchange.
  double block() {
    for (int i = 0; i < kBlock; ++i) {
      const auto at = static_cast<std::size_t>(i);
      link::Command command;
      command.flags = link::kFlagClutch | link::kFlagDeadman;
      command.tip_pos_w_nm = client_.welcome().start_pos_w_nm;
      command.tip_pos_w_nm.z() = client_.welcome().surface_z_w_nm - 4 + (tick_++ % 2 == 0 ? 0 : kSwingNm);
      command.reply_deadband = deadband_;
      command_bytes_[at] = client_.make_command(command, now_ns_ + i * kTickNs, commands_[at]);
    }
    const std::int64_t begin_ns = clock_ns(CLOCK_THREAD_CPUTIME_ID);
    for (int i = 0; i < kBlock; ++i) {
      const auto at = static_cast<std::size_t>(i);
      reply_bytes_[at] = server_.on_datagram(std::span(commands_[at]).first(command_bytes_[at]), peer_,
                                             now_ns_ + i * kTickNs, replies_[at]);
    }
    const std::int64_t took_ns = clock_ns(CLOCK_THREAD_CPUTIME_ID) - begin_ns;
    now_ns_ += kBlock * kTickNs;
    for (std::size_t at = 0; at < reply_bytes_.size(); ++at) {
      if (reply_bytes_[at] == 0) continue;
      ++replied_;
      client_.on_datagram(std::span(replies_[at]).first(reply_bytes_[at]), now_ns_);
    }
    return static_cast<double>(took_ns) / kBlock;
  }
  const server::ServerCounters& counters() const noexcept { return server_.counters(); }
  std::uint64_t replied() const noexcept { return replied_; }

 private:
  static server::ServerConfig server_config() {
    server::ServerConfig config;
    config.secret = {1, 2};
    return config;
  }
  static server::ServedScene served(const std::shared_ptr<const scene::Scene>& scene) {
    server::ServedScene served;
    served.name = server::scene_name(scene->name);
    served.hash = scene->hash;
    served.make_slave = slave::nve_slaves(scene);
    return served;
  }
  static link::ClientConfig client_config(bool may_leave_out) {
    link::ClientConfig config;
    config.nonce_seed = 7;
    // With a log of steps every command is answered.
    config.feature_bits = link::kKnownFeatures & ~std::uint64_t{link::kFeatureStepLog};
    if (!may_leave_out) config.feature_bits &= ~std::uint64_t{link::kFeatureReplyDeadband};
    return config;
  }

  server::Server server_;
  link::ClientSession client_;
  link::ReplyDeadband deadband_;
  net::Address peer_;
  std::int64_t now_ns_ = kTickNs;
  std::int64_t tick_ = 0;
  std::uint64_t replied_ = 0;
  std::vector<Bytes> commands_ = std::vector<Bytes>(kBlock), replies_ = std::vector<Bytes>(kBlock);
  std::vector<std::size_t> command_bytes_ = std::vector<std::size_t>(kBlock);
  std::vector<std::size_t> reply_bytes_ = std::vector<std::size_t>(kBlock);
};

}  // namespace

std::vector<BenchRow> run_gate_bench(const ServerBenchOptions& o) {
  if (!o.only.empty() && o.only != "reply_gate") return {};
  struct Case {
    const char* name;
    link::ReplyDeadband deadband;
    double share;  ///< of the replies that are left out
  };
  constexpr std::array<Case, 3> kCases = {Case{"gate_asks_all", {}, 0}, Case{"gate_sends_all", {1, 1}, 0},
                                          Case{"gate_leaves_out", {1'000'000'000, 1000}, 5.0 / 6}};
  const auto scene = scene::load_scene(o.flat);
  std::vector<BenchRow> rows;
  const PinnedHere pinned(o.server_cpu);
  for (const Case& c : kCases) {
    PressedSession with(scene, true, c.deadband), without(scene, false, {});
    with.block();
    without.block();
    std::vector<double> product, floor;
    for (int i = 0; i < o.rounds * kBlocksEach; ++i) {
      floor.push_back(without.block());
      product.push_back(with.block());
    }
    const server::ServerCounters& counters = with.counters();
    const double left_out = static_cast<double>(counters.left_out) / static_cast<double>(counters.exchanges);
    fmt::print(stderr, "telenano-lab: server {}: {:.1f} % of the replies left out\n", c.name, 100 * left_out);
    if (with.replied() + counters.left_out != counters.exchanges || std::abs(left_out - c.share) > 0.01 ||
        without.replied() != without.counters().exchanges)
      throw RunError(fmt::format("bench: {}: {} of {} replies left out, {} came", c.name, counters.left_out,
                                 counters.exchanges, with.replied()));
    rows.push_back({c.name, "exchange_ns", median(product), median(floor), kMost, false});
  }
  return rows;
}

}  // namespace telenano::studies

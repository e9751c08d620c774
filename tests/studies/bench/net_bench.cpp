#include "tests/studies/bench/net_bench.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <cstdio>
#include <optional>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/realtime_thread.h"
#include "tests/studies/bench/motion.h"
#include "tests/studies/bench/raw_udp.h"
#include "tests/studies/bench/served.h"
#include "tests/support/wire_station.h"

namespace telenano::studies {
namespace {

struct Mode {
  const char* name;
  bool polled;
  bool across;  ///< the two ends on two processors
};
constexpr std::array<Mode, 3> kModes = {
    {{"polled", true, true}, {"blocking_same_core", false, false}, {"blocking_across_cores", false, true}}};
constexpr double kTarget = 1.5;

constexpr std::int64_t kLostNs = 200'000'000;

std::int64_t now_ns() noexcept {
  return clock_ns(CLOCK_MONOTONIC);
}

/// One side in one mode: latencies of all rounds, and quantiles of each.
struct Series {
  std::vector<double> all_us;
  std::vector<double> p50_us, p99_us;
  std::vector<double> round_us;
  std::uint64_t lost = 0;

  void end_round() {
    p50_us.push_back(quantile(round_us, 0.5));
    p99_us.push_back(quantile(round_us, 0.99));
    all_us.insert(all_us.end(), round_us.begin(), round_us.end());
    round_us.clear();
  }
};

/// The floor: the same bytes to and fro.
class PingPong {
 public:
  PingPong(const Mode& mode, int cpu, std::size_t command_bytes, std::size_t reply_bytes)
      : polled_(mode.polled), command_bytes_(command_bytes) {
    server_.blocking(!polled_);
    client_.blocking(!polled_);
    client_.connect_to(server_.port());
    thread_ = std::make_unique<PinnedThread>(cpu, [this, reply_bytes](const std::atomic<bool>& stop) {
      echo_one_by_one(server_, reply_bytes, stop);
    });
  }
  void round(int exchanges, Series& series) {
    for (int i = 0; i < exchanges; ++i) {
      const std::int64_t begin_ns = now_ns();
      ::send(client_.handle(), bytes_.data(), command_bytes_, 0);
      bool came = false;
      while (!came && now_ns() - begin_ns < kLostNs)
        came = ::recv(client_.handle(), bytes_.data(), bytes_.size(), 0) > 0;
      if (came) {
        series.round_us.push_back(1e-3 * static_cast<double>(now_ns() - begin_ns));
      } else {
        ++series.lost;
      }
    }
    series.end_round();
  }

 private:
  bool polled_;
  std::size_t command_bytes_;
  RawUdp server_;
  RawUdp client_;
  std::array<std::uint8_t, 576> bytes_{};
  std::unique_ptr<PinnedThread> thread_;  // last: ends first
};

class Exchange {
 public:
  Exchange(const std::shared_ptr<const scene::Scene>& scene, const Mode& mode, int cpu)
      : polled_(mode.polled),
        served_(scene, cpu, mode.polled, 8),
        station_(served_.address(), {}),
        wire_(station_.socket, 1) {
    link::Command hold;
    if (!station_.exchange(1, hold, 10'000'000'000)) throw RunError("bench: no session");
    motion_ = Motion::of(station_.client.welcome(), true);
  }
  void round(int exchanges, Series& series) {
    net::Received received;
    for (int i = 0; i < exchanges; ++i) {
      motion_.fill(command_, tick_++);
      const std::int64_t begin_ns = now_ns();
      const std::size_t n = station_.client.make_command(command_, begin_ns, station_.buffer);
      wire_.send({station_.buffer.data(), n}, station_.server);
      wire_.flush();
      command_bytes = n;
      bool came = false;
      while (!came && now_ns() - begin_ns < kLostNs) {
        if (!polled_ && !wire_.wait(net::UdpBatch::kShortWaitNs)) continue;
        if (!wire_.receive(station_.buffer, received)) continue;
        reply_bytes = received.size;
        came = station_.client.on_datagram({station_.buffer.data(), received.size}, now_ns()) ==
               link::ClientEvent::kReply;
      }
      if (came) {
        series.round_us.push_back(1e-3 * static_cast<double>(now_ns() - begin_ns));
      } else {
        ++series.lost;
      }
    }
    series.end_round();
  }

  std::size_t command_bytes = 0;
  std::size_t reply_bytes = 0;

 private:
  bool polled_;
  Served served_;
  support::WireStation station_;
  net::UdpBatch wire_;
  Motion motion_;
  link::Command command_;
  std::int64_t tick_ = 0;
};

}  // namespace

std::vector<BenchRow> run_net_bench(const NetBenchOptions& options) {
  const auto scene = scene::load_scene(options.scene);
  std::optional<rt::CpuAwake> awake;
  if (options.low_latency) {
    awake.emplace();
    if (!awake->held())
      throw RunError(
          "--low-latency: cannot hold /dev/cpu_dma_latency; run as root, or give this user write access");
  }
  std::vector<BenchRow> rows;
  for (const Mode& mode : kModes) {
    const int client_cpu = mode.across ? options.client_cpu : options.server_cpu;
    const PinnedHere pinned(client_cpu);
    Series floor, product;
    std::size_t command_bytes = 0, reply_bytes = 0;
    {
      Exchange first(scene, mode, options.server_cpu);  // warms up, and tells the sizes
      Series ignored;
      first.round(options.exchanges / 4 + 1, ignored);
      command_bytes = first.command_bytes;
      reply_bytes = first.reply_bytes;
    }
    for (int round = 0; round < options.rounds; ++round) {
      // Only one pair of threads at a time: one that spins would take the other's processor.
      {
        PingPong ping(mode, options.server_cpu, command_bytes, reply_bytes);
        Series warm;
        ping.round(100, warm);
        ping.round(options.exchanges, floor);
      }
      Exchange exchange(scene, mode, options.server_cpu);
      Series warm;
      exchange.round(100, warm);
      exchange.round(options.exchanges, product);
    }
    fmt::print(stderr, "telenano-lab: net {}: {} B there, {} B back, {} exchanges a side; lost {} and {}\n",
               mode.name, command_bytes, reply_bytes, product.all_us.size(), product.lost, floor.lost);
    rows.push_back({mode.name, "p50_us", median(product.p50_us), median(floor.p50_us), kTarget, false});
    rows.push_back({mode.name, "p99_us", median(product.p99_us), median(floor.p99_us), kTarget, false});
    rows.push_back(
        {mode.name, "p999_us", quantile(product.all_us, 0.999), quantile(floor.all_us, 0.999), {}, false});
  }
  return rows;
}

}  // namespace telenano::studies

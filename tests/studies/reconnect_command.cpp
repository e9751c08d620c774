#include "tests/studies/reconnect_command.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kCommandEveryNs = 100'000'000;
// With many sessions something comes all the time: nothing for so long, and the server is gone.
constexpr std::int64_t kGoneNs = 300'000'000;

struct Options {
  std::string server = "127.0.0.1:5100";
  std::size_t sessions = 1000;
  double seconds = 60;
};

struct Station {
  Station(const net::Address& server, std::uint64_t seed, std::int64_t now_ns)
      : socket(net::Udp::open_for(server)), session(config(seed)) {
    session.start(now_ns);
  }
  static link::ClientConfig config(std::uint64_t seed) {
    link::ClientConfig c;
    c.rate_hz = 1'000'000'000 / kCommandEveryNs;
    c.nonce_seed = seed;
    return c;
  }
  net::Udp socket;
  link::ClientSession session;
  std::int64_t command_ns = 0;
  std::int64_t came_ns = 0;  ///< its newest Welcome
};

/// All stations in one thread: they are in no hurry.
class Crowd {
 public:
  Crowd(const Options& options, const net::Address& server) : server_(server) {
    for (std::size_t i = 0; i < options.sessions; ++i)
      stations_.push_back(std::make_unique<Station>(
          server, 0x9e3779b97f4a7c15ull * (i + 1) ^ static_cast<std::uint64_t>(clock_.now_ns()),
          clock_.now_ns()));
    back_ns_ = heard_ns_ = clock_.now_ns();
  }

  /// Until all have a session that began after the server was there; then a line. False: not within the time.
  bool all_come(const char* what, std::int64_t end_ns) {
    for (;;) {
      turn();
      const auto here = static_cast<std::size_t>(std::count_if(
          stations_.begin(), stations_.end(), [&](const auto& s) { return s->came_ns >= back_ns_; }));
      const bool all = here == stations_.size();
      if (!all && clock_.now_ns() < end_ns) continue;
      std::vector<double> times_s;
      for (const auto& s : stations_)
        if (s->came_ns >= back_ns_) times_s.push_back(1e-9 * static_cast<double>(s->came_ns - back_ns_));
      std::sort(times_s.begin(), times_s.end());
      if (times_s.empty()) times_s.push_back(0);
      fmt::print("{},{},{},{:.3f},{:.3f}\n", what, stations_.size(), here, times_s[times_s.size() / 2],
                 times_s.back());
      std::fflush(stdout);
      return all;
    }
  }

  /// Until the server was gone, and is heard again.
  bool server_restarts(std::int64_t end_ns) {
    while (clock_.now_ns() - heard_ns_ < kGoneNs) {
      turn();
      if (clock_.now_ns() > end_ns) return false;
    }
    const std::int64_t gone_ns = heard_ns_;
    while (heard_ns_ == gone_ns) {
      turn();
      if (clock_.now_ns() > end_ns) return false;
    }
    back_ns_ = heard_ns_;
    return true;
  }

 private:
  void turn() {
    for (const auto& s : stations_) {
      const std::int64_t now_ns = clock_.now_ns();
      while (s->socket.receive(buffer_, received_)) {
        heard_ns_ = std::max(heard_ns_, now_ns);
        if (s->session.on_datagram(std::span(buffer_).first(std::min(received_.size, buffer_.size())),
                                   now_ns) == link::ClientEvent::kWelcome)
          s->came_ns = now_ns;
      }
      if (const std::size_t n = s->session.poll(now_ns, buffer_))
        s->socket.send(std::span<const std::uint8_t>(buffer_).first(n), server_);
      if (now_ns - s->command_ns < kCommandEveryNs) continue;
      s->command_ns = now_ns;
      link::Command command;
      command.tip_pos_w_nm = s->session.welcome().start_pos_w_nm;
      if (const std::size_t n = s->session.make_command(command, now_ns, buffer_))
        s->socket.send(std::span<const std::uint8_t>(buffer_).first(n), server_);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  net::Address server_;
  rt::SteadyClock clock_;
  std::vector<std::unique_ptr<Station>> stations_;
  std::int64_t heard_ns_ = 0;
  std::int64_t back_ns_ = 0;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer_{};
  net::Received received_;
};

bool reconnect(const Options& options) {
  const rt::SteadyClock clock;
  const std::int64_t end_ns = clock.now_ns() + static_cast<std::int64_t>(options.seconds * 1e9);
  Crowd crowd(options, net::parse_address(options.server, "--server"));
  fmt::print("what,sessions,here,p50_s,last_s\n");
  if (!crowd.all_come("first", end_ns)) return false;
  return crowd.server_restarts(end_ns) && crowd.all_come("again", end_ns);
}

}  // namespace

void add_reconnect_command(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<Options>();
  CLI::App* const command =
      app.add_subcommand("reconnect",
                         "Open many sessions on one server and measure how long they take to start, and to "
                         "come back after you kill and restart the server; as CSV");
  command->add_option("--server", options->server, "HOST:PORT of telenano-nve serve without encryption")
      ->capture_default_str();
  command->add_option("--sessions", options->sessions, "Number of sessions")
      ->capture_default_str()
      ->check(CLI::Range(1, 4096));
  command->add_option("--seconds", options->seconds, "Time after which to give up, s")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 3600.0));
  command->callback([options, &exit_code] { exit_code = reconnect(*options) ? 0 : 1; });
}

}  // namespace telenano::studies

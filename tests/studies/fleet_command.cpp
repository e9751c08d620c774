#include "tests/studies/fleet_command.h"

#include <fmt/format.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/connection/failover.h"
#include "telenano/master/connection/server_list.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kTurnNs = 5'000'000;
constexpr std::int64_t kStatusEveryNs = 250'000'000;
constexpr double kPress_nm = 40;  // down and up again in kPeriod_s, into the sample
constexpr double kPeriod_s = 8;
constexpr std::size_t kFilesBesides = 64;

struct Options {
  std::string servers = "127.0.0.1:5100";
  std::size_t sessions = 10'000;
  double rate_hz = 2;
  double seconds = 300;
  double begin_s = 10;  // the sessions begin within this time, not all at once
};

/// One emulated station: the real session, over a socket of its own, behind it a hand that presses the sample
/// slowly. It goes from server to server by the rules of the real one (connection::leaves).
struct FleetStation {
  FleetStation(const net::Address& first, std::size_t at, std::uint64_t seed, const Options& options)
      : socket(net::Udp::open_for(first)), session(config(seed, options)), server(at) {
    socket.notice_unreachable();
  }
  static link::ClientConfig config(std::uint64_t seed, const Options& options) {
    link::ClientConfig c;
    c.rate_hz = static_cast<std::uint32_t>(std::ceil(options.rate_hz));
    c.nonce_seed = seed;
    // Rare commands on a machine that is at its limit: silence is what a second says nothing.
    c.silence_ns = 1'000'000'000;
    return c;
  }

  net::Udp socket;
  link::ClientSession session;
  std::size_t server;
  bool begun = false;
  std::int64_t begins_ns = 0;
  std::int64_t command_ns = 0;
  std::int64_t answered_ns = 0;  // its newest reply; 0: none yet
  bool away = true;              // since then it has lost its server
  std::uint32_t epoch = 0;
  double in_aj = 0, out_aj = 0;  // that it was told last
  double rise_s = 0;
};

struct Tally {
  std::size_t here = 0;
  std::uint64_t resumed = 0;  // Welcomes in the same epoch, after the first
  std::uint64_t epochs = 0;   // Welcomes in a new one, after the first
  std::uint64_t fell = 0;     // sessions resumed with less than was told before, in one epoch
  double away_most_s = 0;     // from the last reply of one server to the first of the next
  std::uint64_t replies = 0;
};

class Fleet {
 public:
  explicit Fleet(const Options& options) : options_(options), epoll_(::epoll_create1(EPOLL_CLOEXEC)) {
    for (const std::string& name : connection::server_names(options.servers))
      servers_.push_back(net::parse_address(name, "--server"));
    if (epoll_ < 0) throw RunError("epoll_create1 failed");
    rlimit files{};
    ::getrlimit(RLIMIT_NOFILE, &files);
    const rlim_t wanted = options.sessions + kFilesBesides;
    if (files.rlim_max < wanted)
      throw RunError(fmt::format("{} sessions need as many sockets, and this user may open {} files",
                                 options.sessions, files.rlim_max));
    files.rlim_cur = std::max(files.rlim_cur, wanted);
    ::setrlimit(RLIMIT_NOFILE, &files);
    const std::int64_t now_ns = clock_.now_ns();
    for (std::size_t i = 0; i < options.sessions; ++i) {
      const std::size_t at = i % servers_.size();
      const std::uint64_t seed = 0x9e3779b97f4a7c15ull * (i + 1) ^ static_cast<std::uint64_t>(now_ns);
      stations_.push_back(std::make_unique<FleetStation>(servers_[at], at, seed, options_));
      FleetStation& s = *stations_.back();
      const double part = static_cast<double>(i) / static_cast<double>(options.sessions);
      s.begins_ns = now_ns + static_cast<std::int64_t>(1e9 * options.begin_s * part);
      s.rise_s = kPeriod_s * part;
      epoll_event event{};
      event.events = EPOLLIN;
      event.data.u64 = i;
      if (::epoll_ctl(epoll_, EPOLL_CTL_ADD, s.socket.handle(), &event) != 0)
        throw RunError("epoll_ctl failed");
    }
  }
  ~Fleet() { ::close(epoll_); }
  Fleet(const Fleet&) = delete;
  Fleet& operator=(const Fleet&) = delete;

  void run() {
    fmt::print("here,resumed,new_epochs,energies_fell,away_most_s,replies,by_server\n");
    const std::int64_t end_ns = clock_.now_ns() + static_cast<std::int64_t>(1e9 * options_.seconds);
    std::int64_t turn_ns = 0, status_ns = 0;
    while (clock_.now_ns() < end_ns) {
      hear();
      const std::int64_t now_ns = clock_.now_ns();
      if (now_ns - turn_ns >= kTurnNs) {
        turn_ns = now_ns;
        for (const auto& s : stations_) speak(*s, now_ns);
      }
      if (now_ns - status_ns < kStatusEveryNs) continue;
      status_ns = now_ns;
      if (!say()) return;
    }
  }

 private:
  void hear() {
    std::array<epoll_event, 512> events;
    const int n = ::epoll_wait(epoll_, events.data(), static_cast<int>(events.size()), 1);
    for (int i = 0; i < n; ++i) {
      FleetStation& s = *stations_[events[static_cast<std::size_t>(i)].data.u64];
      net::Received received;
      const std::int64_t now_ns = clock_.now_ns();
      while (s.socket.receive(buffer_, received)) {
        if (!(received.from == servers_[s.server])) continue;
        const auto bytes = std::span(buffer_).first(std::min(received.size, buffer_.size()));
        const link::ClientEvent event = s.session.on_datagram(bytes, now_ns);
        if (event == link::ClientEvent::kWelcome) on_welcome(s);
        if (event == link::ClientEvent::kReply) on_reply(s, now_ns);
      }
    }
  }

  void on_welcome(FleetStation& s) {
    const std::uint32_t epoch = s.session.welcome().epoch;
    if (s.epoch != 0) ++(epoch == s.epoch ? tally_.resumed : tally_.epochs);
    if (epoch != s.epoch) s.in_aj = s.out_aj = 0;
    s.epoch = epoch;
    s.away = true;
  }

  void on_reply(FleetStation& s, std::int64_t now_ns) {
    ++tally_.replies;
    const link::Reply& reply = s.session.reply();
    if (s.away && (reply.energy_in_aj < s.in_aj || reply.energy_out_aj < s.out_aj)) ++tally_.fell;
    s.in_aj = reply.energy_in_aj;
    s.out_aj = reply.energy_out_aj;
    if (s.away && s.answered_ns != 0)
      tally_.away_most_s = std::max(tally_.away_most_s, 1e-9 * static_cast<double>(now_ns - s.answered_ns));
    s.away = false;
    s.answered_ns = now_ns;
  }

  void speak(FleetStation& s, std::int64_t now_ns) {
    if (!s.begun) {
      if (now_ns < s.begins_ns) return;
      s.begun = true;
      s.session.start(now_ns);
    }
    const bool nobody = s.socket.unreachable() == net::Unreachable::kPort;
    if (connection::leaves(s.session, nobody, now_ns) != connection::LeaveCause::kNone) {
      s.server = (s.server + 1) % servers_.size();
      s.session.start(now_ns);
    }
    if (const std::size_t n = s.session.poll(now_ns, buffer_)) send(s, n);
    if (!s.session.has_session() || now_ns - s.command_ns < static_cast<std::int64_t>(1e9 / options_.rate_hz))
      return;
    s.command_ns = now_ns;
    link::Command command;
    command.flags = link::kFlagClutch | link::kFlagDeadman;
    command.tip_pos_w_nm = s.session.welcome().start_pos_w_nm;
    const double phase = std::fmod(1e-9 * static_cast<double>(now_ns) + s.rise_s, kPeriod_s) / kPeriod_s;
    command.tip_pos_w_nm.z() =
        s.session.welcome().surface_z_w_nm + 20 - kPress_nm * (1 - std::abs(2 * phase - 1));
    if (const std::size_t n = s.session.make_command(command, now_ns, buffer_)) send(s, n);
  }

  void send(FleetStation& s, std::size_t bytes) {
    s.socket.send(std::span<const std::uint8_t>(buffer_).first(bytes), servers_[s.server]);
  }

  /// A line; false: whoever reads has gone.
  bool say() {
    std::vector<std::size_t> by_server(servers_.size(), 0);
    tally_.here = 0;
    for (const auto& s : stations_) {
      const bool here = s->session.state() == link::ClientState::kEstablished && !s->away;
      tally_.here += here ? 1 : 0;
      by_server[s->server] += here ? 1 : 0;
    }
    fmt::print("{},{},{},{},{:.3f},{},{}\n", tally_.here, tally_.resumed, tally_.epochs, tally_.fell,
               tally_.away_most_s, tally_.replies, fmt::join(by_server, "|"));
    return std::fflush(stdout) == 0;
  }

  Options options_;
  int epoll_;
  rt::SteadyClock clock_;
  std::vector<net::Address> servers_;
  std::vector<std::unique_ptr<FleetStation>> stations_;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer_{};
  Tally tally_;
};

}  // namespace

void add_fleet_command(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<Options>();
  CLI::App* const command = app.add_subcommand(
      "fleet",
      "Emulate thousands of stations on several servers; a station that loses its server goes to the next "
      "one in the list. Kill and drain the servers meanwhile. Prints four CSV lines per second");
  command
      ->add_option("--server", options->servers,
                   "HOST:PORT,HOST:PORT of telenano-nve serve without encryption")
      ->capture_default_str();
  command->add_option("--sessions", options->sessions, "Number of stations, spread over the servers")
      ->capture_default_str()
      ->check(CLI::Range(1, 100'000));
  command->add_option("--rate", options->rate_hz, "Commands per second of each station")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 1000.0));
  command->add_option("--begin-s", options->begin_s, "Time within which all stations start, s")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 600.0));
  command->add_option("--seconds", options->seconds, "Duration, s")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 86400.0));
  command->callback([options, &exit_code] {
    Fleet(*options).run();
    exit_code = 0;
  });
}

}  // namespace telenano::studies

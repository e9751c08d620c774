#include "tests/studies/stress/realtime_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <exception>
#include <span>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/periodic_timer.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/loop/station_loop.h"
#include "telenano/nve_server/server/server_loop.h"
#include "tests/studies/relay/relay.h"
#include "tests/studies/stress/ending_threads.h"
#include "tests/studies/stress/hands.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/stress_run.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies::stress {
namespace {

constexpr double kSeconds = 6;
constexpr double kStartHeightNm = 5;
constexpr int kAttempts = 4;
constexpr double kPauseMs = 20;  // as long as a stale force is held

/// What a press is like, whoever drives the session.
struct Metrics {
  double hold_n = 0;        ///< mean force in the last quarter of the hold
  double hold_mm = 0;       ///< mean depth of the hand below the ground there
  double peak_n = 0;        ///< of the force
  double extracted_mj = 0;  ///< most
  double rtt_ms = 0;        ///< the station's own figure at the end
  std::uint32_t violated = 0;
  std::int64_t ticks = 0, late = 0;
  double pause_ms = 0;  ///< the longest that the machine kept the station from its tick

  double stiffness_n_m() const noexcept { return hold_mm > 0 ? 1e3 * hold_n / hold_mm : 0; }
};

/// How far a real run may be from the virtual one. What differs: when a datagram arrives within a tick, ticks
/// that the machine delays, its own share of the round trip.
struct Bounds {
  double stiffness = 0.03;    ///< relative: a wall that both show is the same wall
  double peak = 0.10;         ///< relative: how fast the hand goes in decides what it meets
  double extracted_mj = 2.0;  ///< of 20 mJ
  double rtt_ms = 3.0;        ///< a tick of 1 ms each way at the ends, and wake-ups
};

/// A press under way.
class Press {
 public:
  Press(const RunSpec& spec, const station::StationConfig& station, double force_scale)
      : times_(press_times(spec.seconds)), period_s_(1 / spec.rate_hz), invariants_([&] {
          InvariantWatch::Limits limits;
          limits.method = spec.method;
          limits.period_s = 1 / spec.rate_hz;
          limits.force_limit_n = station.force_safety * 12;
          limits.tip_limit_nn = 1e300;  // the slave is another thread's
          limits.damper_cap_n_s_m = spec.damping_n_s_m;
          limits.hand_j_per_aj = control::Scaling{spec.velocity_scale, force_scale}.hand_energy_j(1);
          return limits;
        }()) {}

  bool over() const noexcept { return period_s_ * static_cast<double>(moved_) >= kSeconds + 0.5; }
  /// After a tick and the hand's motion up to the next one.
  void add(const recording::Sample& row, const StressHand& hand, double wall_m,
           const InvariantWatch::Around& around) {
    static const SlaveWatch kUnseen;
    invariants_.look(row, hand, kUnseen, around);
    const int periods = around.periods;
    if (hand.started()) moved_ += periods;
    const double t = period_s_ * static_cast<double>(moved_);
    const double force_n = row.hand_force_applied_h_n[2];
    metrics_.peak_n = std::max(metrics_.peak_n, std::fabs(force_n));
    metrics_.rtt_ms = 1e-3 * row.rtt_us;
    ++metrics_.ticks;
    metrics_.late += periods > 1;
    metrics_.pause_ms = std::max(metrics_.pause_ms, 1e3 * period_s_ * (periods - 1));
    if (t < times_.out_s && t > times_.out_s - 0.25 * (times_.out_s - times_.held_s)) {
      force_sum_ += force_n;
      depth_sum_ += wall_m - hand.pos_h_m().z();
      ++held_;
    }
  }
  Metrics metrics(const StressHand& hand) const {
    Metrics m = metrics_;
    if (held_ > 0) {
      m.hold_n = force_sum_ / held_;
      m.hold_mm = 1e3 * depth_sum_ / held_;
    }
    m.extracted_mj = 1e3 * hand.account().most_extracted_j();
    m.violated = invariants_.violated();
    return m;
  }

 private:
  PressTimes times_;
  double period_s_;
  InvariantWatch invariants_;
  Metrics metrics_;
  std::int64_t moved_ = 0;
  double force_sum_ = 0, depth_sum_ = 0;
  int held_ = 0;
};

station::StationConfig station_config(const RunSpec& spec, double force_scale) {
  station::StationConfig config;
  config.method = spec.method;
  config.rate_hz = spec.rate_hz;
  config.scaling = {spec.velocity_scale, force_scale};
  config.allow_unsafe_scaling = true;
  return config;
}

struct Setting {
  RunSpec spec;
  const Scenes& scenes;
  double force_scale = 0;
  Ground ground;

  Setting(const RunSpec& run, const Scenes& all) : spec(run), scenes(all) {
    const slave::SlaveLimits limits = scenes.make(spec.scene, kStartHeightNm)->limits();
    force_scale = planned_force_scale(spec, limits);
    ground.metres_per_nm = 1e-9 / spec.velocity_scale;
    ground.wall_m = -(limits.start_pos_w_nm.z() - limits.surface_z_w_nm) * ground.metres_per_nm;
  }
  std::unique_ptr<slave::Slave> make_slave() const { return scenes.make(spec.scene, kStartHeightNm); }
};

InvariantWatch::Around before(const StressHand& hand) {
  InvariantWatch::Around around;
  around.given_before_j = hand.account().given_j();
  around.q_before_j = hand.account().quantum_bound_j();
  return around;
}

Metrics in_virtual_time(const Setting& setting) {
  const std::shared_ptr<StressHand> hand = make_hand(setting.spec, setting.ground);
  support::VirtualSessionConfig config;
  config.make_slave = [&setting] { return setting.make_slave(); };
  config.hand = hand;
  config.station = station_config(setting.spec, setting.force_scale);
  config.to_server.delay_ns = config.to_station.delay_ns = std::llround(0.5e6 * setting.spec.rtt_ms);
  support::VirtualSession session(config);
  Press press(setting.spec, config.station, setting.force_scale);
  while (!press.over()) {
    InvariantWatch::Around around = before(*hand);
    const recording::Sample& row = session.step();
    around.reply_ns = session.client().has_reply() ? session.client().reply_time_ns() : -1;
    around.time_s = row.time_s;
    press.add(row, *hand, setting.ground.wall_m, around);
  }
  return press.metrics(*hand);
}

/// Where the system permits it, all that a session needs goes before the machine's other work.
rt::RealtimeConfig realtime(int priority) {
  rt::RealtimeConfig config;
  config.priority = priority;
  config.lock_memory = false;
  return config;
}

Metrics in_real_time(const Setting& setting) {
  const rt::SteadyClock clock;
  const net::Address any = net::parse_address("127.0.0.1:0", "stress");
  net::Udp server_socket = net::Udp::listen(any);
  server::ServerConfig server_config;
  server_config.secret = link::SipKey{1, 2};
  server::ServedScene served;
  served.make_slave = [&setting] { return setting.make_slave(); };
  server::Server server(server_config, std::move(served));
  server::LoopStatus status;
  RelayConfig relay_config;
  relay_config.listen = any;
  relay_config.to = server_socket.local();
  relay_config.to_server.delay_ns = relay_config.to_client.delay_ns =
      std::llround(0.5e6 * setting.spec.rtt_ms);
  Relay relay(relay_config, clock);
  net::Udp socket = net::Udp::open_for(relay.local());
  EndingThreads threads;
  threads.start([&] {
    rt::enter_realtime(realtime(70));
    server::run_loop(
        server, server_socket, clock, [&](std::int64_t ns) { server_socket.wait_readable(ns); }, threads.stop,
        {}, status);
  });
  threads.start([&] {
    rt::enter_realtime(realtime(60));
    while (!threads.stop) relay.step(2'000'000);
  });

  link::ClientConfig client_config;
  client_config.rate_hz = static_cast<std::uint32_t>(setting.spec.rate_hz);
  link::ClientSession client(client_config);
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  const std::int64_t begin_ns = clock.now_ns();
  client.start(begin_ns);
  while (client.state() != link::ClientState::kEstablished) {
    if (clock.now_ns() - begin_ns > 10'000'000'000)
      throw RunError("stress: no session over the relay within 10 s");
    net::Received received;
    socket.wait_readable(5'000'000);
    while (socket.receive(buffer, received))
      client.on_datagram(std::span(buffer).first(std::min(received.size, buffer.size())), clock.now_ns());
    if (const std::size_t n = client.poll(clock.now_ns(), buffer))
      socket.send(std::span<const std::uint8_t>(buffer).first(n), relay.local());
  }
  const link::Welcome& welcome = client.welcome();
  const std::unique_ptr<StressHand> hand = make_hand(setting.spec, setting.ground);
  const station::StationConfig config = station_config(setting.spec, setting.force_scale);
  station::Station station(
      config, hand->info(),
      {welcome.coupling_stiffness_n_m, welcome.coupling_damping_n_s_m, welcome.force_max_nn});
  loop::StationLoop loop(*hand, socket, relay.local(), client, station, &clock);
  Press press(setting.spec, config, setting.force_scale);
  rt::PeriodicTimerConfig timer_config;
  timer_config.period_ns = std::llround(1e9 / setting.spec.rate_hz);
  rt::PeriodicTimer timer(timer_config);
  recording::Sample row;
  rt::Tick tick = timer.wait();
  double dt_s = 1 / setting.spec.rate_hz;
  while (!press.over()) {
    if (station.mode() == station::Mode::kEngaged) hand->start_motion();
    loop.tick(tick.woke_ns, dt_s, row);
    InvariantWatch::Around around = before(*hand);
    around.reply_ns = client.has_reply() ? client.reply_time_ns() : -1;
    around.time_s = row.time_s;
    const std::int64_t last_ns = tick.woke_ns;
    tick = timer.wait();
    around.periods = static_cast<int>(1 + tick.missed);
    for (int i = 0; i < around.periods; ++i) hand->advance(timer_config.period_ns);
    press.add(row, *hand, setting.ground.wall_m, around);
    dt_s = 1e-9 * static_cast<double>(tick.woke_ns - last_ns);
  }
  loop.say_bye(link::ByeReason::kDone);
  return press.metrics(*hand);
}

}  // namespace

int check_realtime(const std::string& scene_folder) {
  const Scenes scenes(scene_folder, {SceneKind::kWall});
  const Bounds bounds;
  std::printf(
      "method,rtt_ms,stiffness_virtual_n_m,stiffness_real_n_m,peak_virtual_n,peak_real_n,extracted_virtual_"
      "mj,"
      "extracted_real_mj,rtt_virtual_ms,rtt_real_ms,violated,longest_pause_ms,late_ticks,ticks,agrees\n");
  bool all = true;
  for (const control::Method method : {control::Method::kModel, control::Method::kKsClamp}) {
    for (const double rtt_ms : {0.0, 20.0, 100.0}) {
      RunSpec spec;
      spec.method = method;
      spec.rtt_ms = rtt_ms;
      spec.seconds = kSeconds;
      const Setting setting(spec, scenes);
      const Metrics v = in_virtual_time(setting);
      // A machine that keeps a station waiting for longer than a force may be held shows an outage, which the
      // virtual run does not have: once more, some times.
      Metrics r;
      for (int attempt = 0; attempt < kAttempts; ++attempt) {
        std::exception_ptr failure;
        std::thread([&] {
          try {
            rt::enter_realtime(realtime(80));
            r = in_real_time(setting);
          } catch (...) {
            failure = std::current_exception();
          }
        }).join();
        if (failure) std::rethrow_exception(failure);
        if (r.pause_ms < kPauseMs) break;
      }
      const bool decided = r.pause_ms < kPauseMs;
      // A method that yields over a delay shows what it can pay for, which the least difference in timing
      // moves: it is held to the bound where it shows the wall.
      const bool shows_wall = method == control::Method::kModel || rtt_ms <= 20;
      const bool agrees =
          (!shows_wall || std::fabs(r.stiffness_n_m() / v.stiffness_n_m() - 1) <= bounds.stiffness) &&
          std::fabs(r.peak_n / v.peak_n - 1) <= bounds.peak &&
          std::fabs(r.extracted_mj - v.extracted_mj) <= bounds.extracted_mj &&
          std::fabs(r.rtt_ms - v.rtt_ms) <= bounds.rtt_ms && r.violated == 0 && v.violated == 0;
      all = all && agrees && decided;
      std::printf("%s,%g,%.1f,%.1f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%s,%g,%lld,%lld,%s\n",
                  std::string(control::method_name(method)).c_str(), rtt_ms, v.stiffness_n_m(),
                  r.stiffness_n_m(), v.peak_n, r.peak_n, v.extracted_mj, r.extracted_mj, v.rtt_ms, r.rtt_ms,
                  invariant_names(v.violated | r.violated).c_str(), r.pause_ms,
                  static_cast<long long>(r.late), static_cast<long long>(r.ticks),
                  !decided ? "the machine was too busy"
                  : agrees ? "yes"
                           : "no");
      std::fflush(stdout);
    }
  }
  std::fprintf(stderr,
               "stress: bounds: stiffness %g %% where the wall is shown, peak force %g %%, extracted %g mJ, "
               "round trip %g "
               "ms, no invariant violated\n",
               100 * bounds.stiffness, 100 * bounds.peak, bounds.extracted_mj, bounds.rtt_ms);
  return all ? 0 : 1;
}

}  // namespace telenano::studies::stress

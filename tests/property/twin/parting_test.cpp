// Where twin and server part: an outage, a restart, a stop behind a gap, a server that steps beside the log
// or lies. The oracle is the server's slave, recorded at its own port, and the clock of the virtual session.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "telenano/master/twin/scene_twin.h"
#include "tests/property/twin/logged_slave.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using control::Method;
using station::TwinState;

std::shared_ptr<const scene::Scene> deployed(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

VirtualSessionConfig pressing(const std::shared_ptr<const scene::Scene>& scene, double rtt_ms) {
  VirtualSessionConfig config;
  config.scene = scene;
  config.station.method = Method::kTwin;
  config.twin = true;
  config.to_server.delay_ns = config.to_station.delay_ns = static_cast<std::int64_t>(0.5e6 * rtt_ms);
  const double z0 = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
  config.task = device::Task::kScript;
  config.script = {{0, {0, 0, z0}}, {0.8, {0, 0, -5}}, {20, {30, 0, -5}}};
  return config;
}

bool agrees(const VirtualSession& session) {
  const TwinState state = const_cast<VirtualSession&>(session).station().twin()->state();
  return state == TwinState::kBehind || state == TwinState::kConfirmed;
}

void steps(VirtualSession& session, int ticks) {
  for (int i = 0; i < ticks; ++i) session.step();
}

/// The hand's force never changes faster than the slew limit; where a state is taken up, 20 N/s, besides what
/// the hand's own motion does.
double steepest_n(VirtualSession& session, int ticks) {
  double steepest = 0;
  Vec3 last = session.loop().trace().commanded_force_h_n;
  for (int i = 0; i < ticks; ++i) {
    session.step();
    const Vec3 now = session.loop().trace().commanded_force_h_n;
    steepest = std::max(steepest, (now - last).norm());
    last = now;
  }
  return steepest;
}

TEST(Parting, AnOutageEndsInTheServersStateAgain) {
  for (const char* const name : {"flat_silicon_oxide", "flakes", "particle"}) {
    VirtualSession session(pressing(deployed(name), 40));
    steps(session, 1500);
    ASSERT_TRUE(agrees(session)) << name;
    session.link().path_a_to_b().down = true;
    steps(session, 1500);  // beyond the scene's time-out: the slave has withdrawn by itself
    EXPECT_EQ(session.station().mode(), station::Mode::kHeld) << name;
    session.link().path_a_to_b().down = false;
    steps(session, 1500);
    const station::TwinRun& twin = *session.station().twin();
    EXPECT_TRUE(agrees(session)) << name << ": " << station::twin_state_name(twin.state());
    EXPECT_EQ(twin.partings(), 1u) << name;
    EXPECT_EQ(twin.snapshots(), 1u) << name;
    EXPECT_EQ(twin.reason(), static_cast<std::uint32_t>(link::kBreakSilence)) << name;
    EXPECT_LT(twin.behind(), 100u) << name;
    EXPECT_EQ(session.station().method(), Method::kTwin) << name;
  }
}

// What was stepped during an outage comes at its end, up to 4 s of it: all of it is executed soon, and
// nothing is left to be worked off at the little by which the server may be faster than the wall. Two outages
// one after the other, since the bucket of Σdt is filled only slowly after the first.
TEST(Parting, AfterAnOutageOfAnyLengthTheServerCatchesUp) {
  for (const int outage_ms : {1000, 2500, 3500, 4500, 8000}) {
    VirtualSessionConfig config = pressing(deployed("flat_silicon_oxide"), 40);
    VirtualSession session(config);
    steps(session, 1500);
    for (int time = 1; time <= 2; ++time) {
      session.link().path_a_to_b().down = true;
      steps(session, outage_ms);
      session.link().path_a_to_b().down = false;
      steps(session, 3500);
      const station::TwinRun& twin = *session.station().twin();
      EXPECT_LT(twin.behind(), 100u) << outage_ms << " ms, time " << time;
      EXPECT_TRUE(agrees(session)) << outage_ms << " ms, time " << time << ": "
                                   << station::twin_state_name(twin.state());
      EXPECT_EQ(session.station().mode(), station::Mode::kEngaged) << outage_ms << " ms, time " << time;
    }
  }
}

TEST(Parting, ARestartedServerHasATwinFromTheBeginning) {
  VirtualSession session(pressing(deployed("flat_pdms"), 20));
  steps(session, 1500);
  session.restart_server();
  steps(session, 2500);
  EXPECT_TRUE(agrees(session));
  EXPECT_EQ(session.station().method(), Method::kTwin);
  EXPECT_EQ(session.station().twin()->partings(), 0u) << "a new slave is known from its first step";
  EXPECT_LT(session.station().twin()->behind(), 60u);
}

// What a window draws: ploughed through an outage, so that the second twin is the one in use, then with a new
// server. The oracle is the surface of the server's own slave, which the view rounds to single precision.
TEST(Parting, TheHeightsToLookAtAreThoseOfTheServersSample) {
  const auto scene = deployed("lithography");
  const slave::NveSlave* servers = nullptr;
  VirtualSessionConfig config = pressing(scene, 40);
  config.script.resize(1);
  for (const device::IntendedMotion::Waypoint& to :
       {device::IntendedMotion::Waypoint{0.8, {0, 0, -8}}, {5, {30, 0, -8}}, {5.5, {30, 0, 10}}})
    config.script.push_back(to);
  config.make_slave = [&] {
    auto slave = std::make_unique<slave::NveSlave>(scene);
    servers = slave.get();
    return slave;
  };
  VirtualSession session(config);
  const station::TwinRun& twin = *session.station().twin();
  const auto furthest_nm = [&](double& lowest_nm) {
    lowest_nm = 0;
    double most = 0;
    const surface::HeightGrid own = servers->marked_surface()->heights();
    const surface::HeightGrid seen = twin.heights()->heights();
    EXPECT_EQ(seen.columns, own.columns);
    EXPECT_EQ(seen.dx_nm, own.dx_nm);
    EXPECT_EQ(seen.x_first_nm, own.x_first_nm);
    for (std::size_t i = 0; i < own.z_nm.size(); ++i) {
      most = std::max(most, std::abs(own.z_nm[i] - seen.z_nm.at(i)));
      lowest_nm = std::min(lowest_nm, own.z_nm[i]);
    }
    return most;
  };
  steps(session, 3000);
  session.link().path_a_to_b().down = true;
  steps(session, 1500);
  session.link().path_a_to_b().down = false;
  steps(session, 4000);
  ASSERT_TRUE(agrees(session));
  ASSERT_EQ(twin.snapshots(), 1u);
  double lowest_nm = 0;
  EXPECT_LT(furthest_nm(lowest_nm), 1e-6);
  EXPECT_LT(lowest_nm, -0.5) << "there is a groove";
  const std::uint64_t before = twin.heights()->version();
  session.restart_server();
  steps(session, 2000);
  ASSERT_TRUE(agrees(session));
  EXPECT_LT(furthest_nm(lowest_nm), 1e-6);
  EXPECT_EQ(lowest_nm, 0) << "a new sample";
  EXPECT_NE(twin.heights()->version(), before) << "who looks hears of it";
}

/// The server's slave with a step of its own beside the log now and then: a bug, or a lie.
class StraySlave final : public slave::Slave {
 public:
  StraySlave(std::shared_ptr<const scene::Scene> scene, std::vector<int> strays, bool lies)
      : slave_(std::move(scene)), strays_(std::move(strays)), lies_(lies) {}
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    slave_.step(input, dt_s, output);
    if (std::find(strays_.begin(), strays_.end(), ++count_) == strays_.end()) return;
    slave::SlaveInput stray = input;
    stray.follow = true;
    stray.tip_target_pos_w_nm = output.commanded_pos_w_nm + Vec3(0.5, 0, 0.5);
    slave_.step(stray, dt_s, output);
  }
  const slave::SlaveLimits& limits() const noexcept override { return slave_.limits(); }
  std::uint64_t state_hash() const noexcept override { return slave_.state_hash() + (lies_ ? 1 : 0); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return slave_.save(out); }
  std::size_t snapshot_bytes_max() const noexcept override { return slave_.snapshot_bytes_max(); }

 private:
  slave::NveSlave slave_;
  std::vector<int> strays_;
  bool lies_;
  int count_ = 0;
};

TEST(Parting, AStepBesideTheLogIsFoundAndMended) {
  const auto scene = deployed("flakes");
  VirtualSessionConfig config = pressing(scene, 60);
  config.make_slave = [scene] { return std::make_unique<StraySlave>(scene, std::vector<int>{1600}, false); };
  VirtualSession session(config);
  steps(session, 1500);
  ASSERT_TRUE(agrees(session));
  // α_F times half a nanometre's force is what the state leaps by; the hand must feel none of that at once:
  // 20 N/s, and its own motion's part.
  const double steepest = steepest_n(session, 1500);
  const station::TwinRun& twin = *session.station().twin();
  EXPECT_TRUE(agrees(session)) << station::twin_state_name(twin.state());
  EXPECT_EQ(twin.partings(), 1u);
  EXPECT_EQ(twin.snapshots(), 1u);
  EXPECT_EQ(twin.reason(), static_cast<std::uint32_t>(link::kBreakNone));
  EXPECT_LT(steepest, 0.02 * 1.5);
}

TEST(Parting, ThreeWithoutAReasonEndTheTwin) {
  const auto scene = deployed("flakes");
  VirtualSessionConfig config = pressing(scene, 20);
  config.make_slave = [scene] {
    return std::make_unique<StraySlave>(scene, std::vector<int>{1500, 2500, 3500}, false);
  };
  VirtualSession session(config);
  steps(session, 5000);
  EXPECT_EQ(session.station().twin()->state(), TwinState::kGivenUp);
  EXPECT_EQ(session.station().method(), Method::kModel);
  EXPECT_EQ(session.station().mode(), station::Mode::kEngaged) << "the session goes on";
  EXPECT_EQ(session.station().twin()->heights(), nullptr) << "nobody knows the sample any more";
}

TEST(Parting, AServerThatLiesAboutItsStateGetsNoTwinAndNoEnergy) {
  const auto scene = deployed("flat_pdms");
  VirtualSessionConfig config = pressing(scene, 20);
  config.make_slave = [scene] { return std::make_unique<StraySlave>(scene, std::vector<int>{}, true); };
  VirtualSession session(config);
  steps(session, 5000);
  EXPECT_EQ(session.station().twin()->state(), TwinState::kGivenUp);
  EXPECT_EQ(session.station().method(), Method::kModel);
  const station::StationTrace& t = session.loop().trace();
  EXPECT_LT(t.energy_out_j - t.energy_in_j, session.station().config().allowance_j + 1e-3);
}

/// What a parting cost the hand: times from the tick in which the station heard of it.
struct Mended {
  double agree_s = -1;  ///< until twin and server are the same again, and the hand feels that state's force
  double fastest_n_s = 0;   ///< of what is felt beyond the twin's own force
  double beyond_m = 0;      ///< of the hand's place beside one whose server does not stray
  double most_apart_n = 0;  ///< between what is felt and the new state's force
  std::size_t bytes = 0;    ///< of the state
};

Mended mended(const std::string& name, double rtt_ms, double arm_n_m, double grip_n_m) {
  const auto scene = deployed(name);
  const auto session_of = [&](std::vector<int> strays) {
    VirtualSessionConfig config = pressing(scene, rtt_ms);
    config.plant.arm_stiffness_n_m = arm_n_m;
    config.plant.arm_damping_n_s_m =
        1.4 * std::sqrt(arm_n_m * config.plant.arm_mass_kg);  // as damped as by default
    config.plant.grip_stiffness_n_m = grip_n_m;
    config.make_slave = [scene, strays] { return std::make_unique<StraySlave>(scene, strays, false); };
    return std::make_unique<VirtualSession>(config);
  };
  const auto strayed = session_of({1600}), straight = session_of({});
  const control::Scaling scaling = strayed->station().config().scaling;
  Mended out;
  int heard = -1;
  Vec3 last_beyond_n = Vec3::Zero();
  for (int tick = 0; tick < 3500; ++tick) {
    strayed->step();
    straight->step();
    const station::StationTrace& t = strayed->loop().trace();
    const station::TwinRun& twin = *strayed->station().twin();
    out.beyond_m = std::max(out.beyond_m, (t.hand_pos_h_m - straight->loop().trace().hand_pos_h_m).norm());
    if (heard < 0 && twin.state() == TwinState::kApart) heard = tick;
    if (heard < 0) continue;
    // What is felt, less what the twin in use says: nothing, until the state is another one; then it goes away.
    const Vec3 beyond_n = t.rendered_force_h_n - scaling.hand_force_n(twin.answer().force_w_nn);
    out.most_apart_n = std::max(out.most_apart_n, beyond_n.norm());
    if (out.most_apart_n > beyond_n.norm())
      out.fastest_n_s = std::max(out.fastest_n_s, (last_beyond_n - beyond_n).norm() / 1e-3);
    last_beyond_n = beyond_n;
    if (agrees(*strayed) && twin.snapshots() == 1 && beyond_n.norm() < 1e-9) {
      if (out.agree_s < 0) out.agree_s = 1e-3 * (tick - heard);
    }
  }
  EXPECT_EQ(strayed->station().twin()->partings(), 1u) << name;
  EXPECT_EQ(strayed->station().mode(), station::Mode::kEngaged) << name;
  out.bytes = strayed->client().snapshot().data().size();
  return out;
}

// Asked: a round trip, the state's transfer and 50 ms; 20 N/s; 1 mm. Transfer: at 2000 pieces a second, and a
// second round trip where there are more of them than the first guess asks for. The force goes over at 20 N/s,
// so that what is further apart than 50 ms of that takes its time. Loose and firm hands.
TEST(Parting, ForcesAgreeAgainSoonAndTheHandIsNotMoved) {
  struct Hand {
    double arm_n_m, grip_n_m;
  };
  for (const char* const name : {"flat_pdms", "flakes", "humid_flakes", "lithography"}) {
    for (const double rtt_ms : {20.0, 200.0}) {
      for (const Hand& hand : {Hand{50, 300}, Hand{400, 3000}, Hand{1200, 6000}}) {
        const Mended m = mended(name, rtt_ms, hand.arm_n_m, hand.grip_n_m);
        const double pieces = std::ceil(static_cast<double>(m.bytes) / link::kSnapshotPieceBytes);
        const double transfer_s = pieces / link::SnapshotFetch::kPerSecond + (pieces > 2 ? 1e-3 * rtt_ms : 0);
        const double asked_s = 1e-3 * rtt_ms + transfer_s + 0.05;
        const std::string what = std::string(name) + ", " + std::to_string(rtt_ms) + " ms, arm of " +
                                 std::to_string(hand.arm_n_m) + " N/m";
        EXPECT_GE(m.agree_s, 1e-3 * rtt_ms) << what;
        EXPECT_LE(m.agree_s, asked_s + std::max(0.0, m.most_apart_n / control::Twin::kGoOver_n_s - 0.05))
            << what;
        EXPECT_LE(m.fastest_n_s, control::Twin::kGoOver_n_s * (1 + 1e-9)) << what;
        EXPECT_LE(m.beyond_m, 1e-3) << what;
        std::printf(
            "%s: forces agree after %.0f ms (%.0f asked), %.4f N apart, %.1f N/s, hand %.3f mm beyond\n",
            what.c_str(), 1e3 * m.agree_s, 1e3 * asked_s, m.most_apart_n, m.fastest_n_s, 1e3 * m.beyond_m);
      }
    }
  }
}

TEST(Parting, AStopDoesNotWaitForStepsThatAreMissing) {
  const auto scene = deployed("flat_silicon_oxide");
  const auto log = std::make_shared<ExecutedLog>();
  VirtualSessionConfig config = pressing(scene, 0);
  config.make_slave = [scene, log] { return std::make_unique<LoggedSlave>(scene, log); };
  VirtualSession session(config);
  steps(session, 1500);
  session.link().path_a_to_b().down = true;
  steps(session, 60);  // far more than a datagram repeats
  session.link().path_a_to_b().down = false;
  const std::size_t before = log->size();
  session.loop().set_buttons(device::kButtonStop);
  steps(session, 2);
  ASSERT_GT(log->size(), before) << "the stop was executed with the datagram that brought it";
  EXPECT_TRUE(log->back().input.retract);
  EXPECT_LT(log->size(), before + 40) << "and not after all that was missing";
  steps(session, 500);
  EXPECT_TRUE(log->back().input.retract);
  EXPECT_EQ(session.client().reply().steps.break_reason, static_cast<std::uint32_t>(link::kBreakStop));
  session.loop().set_buttons(0);
}

/// How long before this tick the last reply came, in which the station first said that it is blind, and in
/// which it first held; s, -1: never.
struct Blindness {
  double stale_s = -1;
  double held_s = -1;
  double felt_before_n = 0;  ///< the hand's force just before the first of these,
  double felt_held_n = -1;   ///< and in the tick of the second
};

/// Steps until the station holds, at most `ticks`; `since_ns`: the event from which times count.
Blindness until_held(VirtualSession& session, int ticks, const std::function<std::int64_t()>& since_ns) {
  Blindness out;
  for (int i = 0; i < ticks && out.held_s < 0; ++i) {
    const std::int64_t tick_ns = session.now_ns();
    const recording::Sample row = session.step();
    const double felt_n = session.loop().trace().commanded_force_h_n.norm();
    const double since_s = 1e-9 * static_cast<double>(tick_ns - since_ns());
    if (out.stale_s < 0 && (row.station_faults & station::kFaultStale) != 0) out.stale_s = since_s;
    if (out.stale_s < 0) out.felt_before_n = felt_n;
    if (session.station().mode() != station::Mode::kHeld) continue;
    out.held_s = since_s;
    out.felt_held_n = felt_n;
  }
  return out;
}

// Ticks last 1 ms and an arrival is seen in the next one, so that a time is known to 2 ms.
constexpr double kTicksS = 0.002;
// From full force to none: stale_zero_s - stale_hold_s of the station's defaults.
constexpr double kFadeS = 0.080;

// Without any reply 0.2 s, or half of the server's time-out if that is less.
TEST(Parting, SilenceIsBridgedForFifthOfASecondAndNoLongerThanHalfTheTimeOut) {
  struct Case {
    int timeout_ms;
    double limit_s;
  };
  for (const Case& c : {Case{500, 0.2}, Case{2000, 0.2}, Case{300, 0.15}}) {
    auto scene = std::make_shared<scene::Scene>(*deployed("flakes"));
    scene->session_timeout_ms = static_cast<std::uint32_t>(c.timeout_ms);
    VirtualSession session(pressing(scene, 40));
    steps(session, 1500);
    ASSERT_EQ(session.station().mode(), station::Mode::kEngaged);
    session.link().path_b_to_a().down = true;  // commands go on: the server does not withdraw
    const Blindness blind = until_held(session, 1000, [&] { return session.client().reply_time_ns(); });
    EXPECT_NEAR(blind.stale_s, c.limit_s, kTicksS) << c.timeout_ms;
    EXPECT_NEAR(blind.held_s, c.limit_s + kFadeS, kTicksS) << c.timeout_ms;
    EXPECT_GT(blind.felt_before_n, 0.1) << "in contact";
    EXPECT_EQ(blind.felt_held_n, 0.0) << c.timeout_ms;
    session.link().path_b_to_a().down = false;
    steps(session, 1500);
    EXPECT_EQ(session.station().mode(), station::Mode::kEngaged);
    EXPECT_GT(session.loop().trace().commanded_force_h_n.norm(), 0.1);
    EXPECT_TRUE(agrees(session));
    EXPECT_EQ(session.station().twin()->partings(), 0u) << "the server made every step meanwhile";
  }
}

// Replies that come and confirm nothing: for a second, or four round trips, but no more than half of the ring
// of 4 s.
TEST(Parting, WhatIsNotConfirmedIsShownForASecondOrFourRoundTrips) {
  struct Case {
    double rtt_ms, limit_s;
  };
  for (const Case& c : {Case{40, 1.0}, Case{300, 1.2}, Case{800, 2.0}}) {
    struct Freeze {
      bool on = false;
      link::StepReport last;
      link::Codec codec;
      link::Incoming in;
    };
    const auto freeze = std::make_shared<Freeze>();
    VirtualSessionConfig config = pressing(deployed("flakes"), c.rtt_ms);
    config.lie = [freeze](std::span<std::uint8_t> bytes, std::size_t n) {
      if (freeze->codec.decode(bytes.first(n), freeze->in) != link::DropCause::kNone ||
          freeze->in.type != link::MessageType::kReply)
        return n;
      if (!freeze->on) freeze->last = freeze->in.reply.steps;
      freeze->in.reply.steps = freeze->last;
      return freeze->codec.encode(freeze->in.reply, bytes);
    };
    VirtualSession session(config);
    std::vector<std::int64_t> made_ns(20'000);  // by the step's number
    const auto step = [&] {
      const std::int64_t tick_ns = session.now_ns();
      const std::uint64_t number = session.client().next_step();
      session.step();
      if (session.client().next_step() != number) made_ns.at(number) = tick_ns;
    };
    for (int i = 0; i < 2500; ++i) step();
    ASSERT_EQ(session.station().mode(), station::Mode::kEngaged) << c.rtt_ms;
    freeze->on = true;
    for (int i = 0; i < static_cast<int>(c.rtt_ms) + 5; ++i) step();  // what is on its way comes
    const std::int64_t oldest_ns = made_ns.at(freeze->last.executed + 1);
    ASSERT_GT(oldest_ns, 0);
    const Blindness blind = until_held(session, 3000, [&] { return oldest_ns; });
    // The round trip is measured to a tick or two each way, and counts four times.
    const double known_s = kTicksS + (c.limit_s > 1 && c.limit_s < 2 ? 4 * kTicksS : 0);
    EXPECT_NEAR(blind.stale_s, c.limit_s, known_s) << c.rtt_ms;
    EXPECT_NEAR(blind.held_s, c.limit_s + kFadeS, known_s) << c.rtt_ms;
    EXPECT_GT(blind.felt_before_n, 0.1) << "in contact";
    EXPECT_EQ(blind.felt_held_n, 0.0) << c.rtt_ms;
    freeze->on = false;
    steps(session, 1500 + 3 * static_cast<int>(c.rtt_ms));
    EXPECT_EQ(session.station().mode(), station::Mode::kEngaged) << c.rtt_ms;
    EXPECT_GT(session.loop().trace().commanded_force_h_n.norm(), 0.1) << c.rtt_ms;
    EXPECT_EQ(session.station().twin()->partings(), 0u) << c.rtt_ms;
  }
}

/// A server that says its state's hash wrong once, and then gives its state as it likes.
struct StateKeeper {
  enum class Gives { kNothing, kOnePieceASecond, kStaleReports } gives = Gives::kNothing;
  std::uint64_t from_step = UINT64_MAX;
  std::int64_t* now_ns = nullptr;
  std::int64_t gave_ns = 0;
  bool lied = false;
  link::StepReport last;
  link::Codec codec;
  link::Incoming in;
  std::size_t operator()(std::span<std::uint8_t> bytes, std::size_t n) {
    if (codec.decode(bytes.first(n), in) != link::DropCause::kNone) return n;
    if (in.type == link::MessageType::kReply) {
      link::StepReport& report = in.reply.steps;
      if (report.executed <= from_step) {
        last = report;
        return n;
      }
      if (gives == Gives::kStaleReports) report = last;
      if (gives != Gives::kStaleReports && !std::exchange(lied, true)) report.state_hash ^= 1;
      return codec.encode(in.reply, bytes);
    }
    if (in.type != link::MessageType::kSnapshotPiece || !lied) return n;
    if (gives == Gives::kNothing || *now_ns - gave_ns < 1'000'000'000) return 0;
    gave_ns = *now_ns;
    return n;
  }
};

// A hostile server, or an old one with a fault: it never gives the state that is asked for, or a piece a second,
// or never confirms a step again. The hand is not left without force for ever: the twin is given up in a stated
// time, `model` takes over without a bump, and the reason is told.
TEST(Parting, AServerThatNeverGivesItsStateEndsTheTwin) {
  using Gives = StateKeeper::Gives;
  for (const Gives gives : {Gives::kNothing, Gives::kOnePieceASecond, Gives::kStaleReports}) {
    SCOPED_TRACE(static_cast<int>(gives));
    std::int64_t now_ns = 0;
    const auto keeper = std::make_shared<StateKeeper>();
    keeper->gives = gives;
    keeper->now_ns = &now_ns;
    // Marks, so that the state has many pieces.
    VirtualSessionConfig config = pressing(deployed("lithography"), 100);
    config.lie = [keeper](std::span<std::uint8_t> bytes, std::size_t n) { return (*keeper)(bytes, n); };
    VirtualSession session(config);
    steps(session, 2500);
    ASSERT_TRUE(agrees(session));
    ASSERT_EQ(session.station().mode(), station::Mode::kEngaged);
    keeper->from_step = session.client().next_step();
    const station::TwinRun& twin = *session.station().twin();
    double steepest = 0;
    Vec3 last = session.loop().trace().commanded_force_h_n;
    int given_up_after = 0;
    while (!twin.given_up() && given_up_after < 20'000) {
      now_ns = session.now_ns();
      session.step();
      ++given_up_after;
      const Vec3 now = session.loop().trace().commanded_force_h_n;
      steepest = std::max(steepest, (now - last).norm());
      last = now;
    }
    EXPECT_EQ(twin.end(), station::TwinEnd::kUnconfirmed);
    // A round trip until it is heard, and a second or four round trips in which it is shown all the same.
    const double most_s = 0.1 + (gives == Gives::kStaleReports ? 1.0 : 0) + twin.unconfirmed_most_s(0.11);
    EXPECT_LE(1e-3 * given_up_after, most_s + 0.05);
    EXPECT_GE(1e-3 * given_up_after, 3.0) << "time for a slow way";
    EXPECT_LT(most_s, 6.0);
    steepest = std::max(steepest, steepest_n(session, 2000));
    EXPECT_LT(steepest, 0.03 + 0.02);
    EXPECT_EQ(session.station().method(), Method::kModel);
    EXPECT_EQ(session.station().mode(), station::Mode::kEngaged);
    EXPECT_GT(session.loop().trace().commanded_force_h_n.norm(), 0.05) << "felt again, by another method";
    const station::StationTrace& t = session.loop().trace();
    EXPECT_EQ(t.twin_end, station::TwinEnd::kUnconfirmed);
    EXPECT_LT(t.energy_out_j - t.energy_in_j, session.station().config().allowance_j + 1e-3);
  }
}

// How long the twin waits for the server's state follows the pace at which a thin link lets it be asked for. Pieces that
// come at more than a quarter of that are a transfer, however long it takes; of fewer, or none, the time is stated:
// t such that t − 4 · (pieces until t)/pace is what there is.
TEST(Parting, ThePatienceWithATransferFollowsItsPace) {
  constexpr double kTick_s = 1e-3, kRtt_s = 0.05, kLongest_s = 120;
  const auto scene = deployed("flat_silicon_oxide");
  for (const double pace_per_s : {20.0, 150.0, 2000.0}) {
    for (const double share : {1.0, 0.3, 0.2, 0.1, 0.0}) {
      SCOPED_TRACE(std::to_string(pace_per_s) + " a second, share " + std::to_string(share));
      station::TwinRun twin({}, std::make_unique<telenano::twin::SceneTwin>(scene),
                            std::make_unique<telenano::twin::SceneTwin>(scene));
      link::StepReport report;
      twin.begin(report, true, 0.5, 0);
      report.breaks = 1;
      report.break_reason = link::kBreakSilence;
      twin.on_reply(report, 0);
      ASSERT_EQ(twin.state(), station::TwinState::kApart);
      double time_s = 0;
      for (int tick = 0; time_s < kLongest_s && !twin.given_up(); ++tick) {
        time_s = kTick_s * tick;
        const auto pieces = static_cast<std::size_t>(share * pace_per_s * time_s);
        twin.watch(kTick_s, true, kRtt_s, pieces, pace_per_s, std::llround(1e9 * time_s));
      }
      if (share > 0.25) {
        EXPECT_FALSE(twin.given_up());
        continue;
      }
      EXPECT_EQ(twin.end(), station::TwinEnd::kUnconfirmed);
      const double stated_s = twin.unconfirmed_most_s(kRtt_s) / (1 - 4 * share);
      // A piece more or less, and what a piece is worth more than the time since the last one is not saved up.
      EXPECT_NEAR(time_s, stated_s, 0.01 + 5 * 4 / pace_per_s);
    }
  }
}

// The scale is changed while the hand presses and the twin is 200 ms ahead: what is felt goes to the new scale
// without a leap, the log goes on, and the twin is confirmed throughout.
TEST(Parting, AScaleChangedWhilePressingFarAheadIsNoParting) {
  VirtualSession session(pressing(deployed("flakes"), 200));
  steps(session, 2500);
  ASSERT_TRUE(agrees(session));
  ASSERT_EQ(session.station().mode(), station::Mode::kEngaged);
  const double before_n = session.loop().trace().commanded_force_h_n.norm();
  ASSERT_GT(before_n, 0.05);
  const control::Scaling old = session.station().config().scaling;
  ASSERT_GT(session.station().twin()->behind(), 150u);
  for (const double times : {0.5, 1.0}) {
    ASSERT_TRUE(session.station().change_scaling({old.velocity, times * old.force}));
    // Less force may be less at once; more comes by the ramp.
    double steepest = 0;
    double last_n = session.loop().trace().commanded_force_h_n.norm();
    for (int i = 0; i < 1500; ++i) {
      session.step();
      const double now_n = session.loop().trace().commanded_force_h_n.norm();
      steepest = std::max(steepest, now_n - last_n);
      last_n = now_n;
    }
    EXPECT_LT(steepest, 0.05) << times;
    EXPECT_NEAR(last_n, times * before_n, 0.25 * before_n) << times;
    EXPECT_TRUE(agrees(session)) << station::twin_state_name(session.station().twin()->state());
  }
  EXPECT_EQ(session.station().twin()->partings(), 0u);
  EXPECT_EQ(session.station().mode(), station::Mode::kEngaged);
  EXPECT_EQ(session.station().method(), Method::kTwin);
}

// A state that is larger than the server may keep for a station is not given: said at once, without a byte.
TEST(Parting, AStateBeyondTheServersBoundEndsTheTwinAtOnce) {
  const auto scene = deployed("lithography");
  VirtualSessionConfig config = pressing(scene, 40);
  config.snapshot_bytes_most = 2'000;
  const auto liar = std::make_shared<StateKeeper>();
  config.lie = [liar](std::span<std::uint8_t> bytes, std::size_t n) {
    if (liar->codec.decode(bytes.first(n), liar->in) != link::DropCause::kNone) return n;
    if (liar->in.type != link::MessageType::kReply || liar->in.reply.steps.executed <= liar->from_step)
      return n;
    if (std::exchange(liar->lied, true)) return n;
    liar->in.reply.steps.state_hash ^= 1;
    return liar->codec.encode(liar->in.reply, bytes);
  };
  VirtualSession session(config);
  steps(session, 4000);  // ploughs: more nodes than fit
  ASSERT_TRUE(agrees(session));
  liar->from_step = session.client().next_step();
  steps(session, 500);
  EXPECT_EQ(session.station().twin()->end(), station::TwinEnd::kRefused);
  EXPECT_EQ(session.station().method(), Method::kModel);
  EXPECT_EQ(session.station().mode(), station::Mode::kEngaged);
}

TEST(Parting, TicksDoNotAllocate) {
  if (!AllocGuard::active()) GTEST_SKIP() << "a sanitizer has its own malloc";
  const auto scene = deployed("flakes");
  VirtualSessionConfig config = pressing(scene, 40);
  config.make_slave = [scene] { return std::make_unique<StraySlave>(scene, std::vector<int>{1600}, false); };
  config.to_server.loss = config.to_station.loss = 0.05;
  VirtualSession session(config);
  steps(session, 1500);
  const AllocGuard guard;
  steps(session, 1000);  // in contact, with losses, and a snapshot
  const auto allocations = guard.allocations();
  EXPECT_EQ(allocations, 0u);
  EXPECT_EQ(session.station().twin()->snapshots(), 1u);
}

}  // namespace
}  // namespace telenano::support

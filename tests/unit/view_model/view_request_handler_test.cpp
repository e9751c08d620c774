#include "telenano/master/view_model/view_request_handler.h"

#include <gtest/gtest.h>

#include "telenano/common/control/scaling.h"
#include "telenano/master/view_model/scaling_region.h"
#include "tests/support/alloc_guard.h"

namespace telenano::view_model {
namespace {

using Kind = ViewRequest::Kind;

/// A station with a session, deadman held, ticked by hand.
struct Fixture {
  Fixture() : station(config(), device_info(), slave()), requests(port, bounds()) {
    link::Welcome welcome;
    welcome.workspace_min_w_nm = Vec3::Constant(-100);
    welcome.workspace_max_w_nm = Vec3::Constant(100);
    welcome.feature_bits = link::kKnownFeatures;
    welcome.coupling_stiffness_n_m = 13;
    station.begin_session(welcome);
  }
  static station::StationConfig config() {
    station::StationConfig c;
    c.scaling = {1e-6, 2e7};
    return c;
  }
  static device::DeviceInfo device_info() {
    device::DeviceInfo info;
    info.force_max_n = 12;
    info.damping_n_s_m = 2;
    info.mass_kg = 0.25;
    return info;
  }
  static station::SlavePort slave() { return {13, 0, 500}; }
  static std::array<double, 8> bounds() {
    std::array<double, 8> bound{};
    bound.fill(60);
    bound[static_cast<std::size_t>(control::Method::kNone)] = 5;
    bound[static_cast<std::size_t>(control::Method::kKs)] = 5;
    return bound;
  }
  void ask(Kind kind, control::Method method = control::Method::kNone, control::Scaling scaling = {}) {
    EXPECT_TRUE(port.requests.push({kind, method, scaling}));
  }
  ViewRequestHandler::Asked tick() {
    const ViewRequestHandler::Asked asked = requests.answer(station);
    station::StationInput input;
    input.time_ns = time_ns += 1'000'000;
    input.buttons = device::kButtonDeadman | asked.buttons;
    input.session_up = true;
    input.command_sequence = ++sequence;
    station.step(input, 1e-3, output);
    return asked;
  }
  ViewPort port;
  station::Station station;
  ViewRequestHandler requests;
  station::StationOutput output;
  std::int64_t time_ns = 0;
  std::uint64_t sequence = 0;
};

TEST(ViewRequestHandler, StopIsLatchedUntilAPersonClearsIt) {
  Fixture f;
  f.tick();
  f.port.stops.fetch_add(1);
  f.tick();
  EXPECT_EQ(f.station.mode(), station::Mode::kStopped);
  for (int i = 0; i < 100; ++i) f.tick();
  EXPECT_EQ(f.station.mode(), station::Mode::kStopped);
  f.ask(Kind::kClearStop);
  f.tick();
  EXPECT_NE(f.station.mode(), station::Mode::kStopped);
}

TEST(ViewRequestHandler, ButtonsHeldOnTheScreenAreHeldInEveryTick) {
  Fixture f;
  f.port.buttons.store(device::kButtonClutch);
  EXPECT_EQ(f.tick().buttons, static_cast<std::uint32_t>(device::kButtonClutch));
  EXPECT_EQ(f.tick().buttons, static_cast<std::uint32_t>(device::kButtonClutch));
  f.port.buttons.store(0);
  EXPECT_EQ(f.tick().buttons, 0u);
}

TEST(ViewRequestHandler, ChangesMethodAndScalingWithinTheRegionOnly) {
  Fixture f;
  f.ask(Kind::kMethod, control::Method::kTank);
  f.tick();
  EXPECT_EQ(f.station.method(), control::Method::kTank);
  f.ask(Kind::kMethod, control::Method::kNone);  // alpha_v alpha_F = 20, beyond 5
  f.tick();
  EXPECT_EQ(f.station.method(), control::Method::kTank);
  EXPECT_EQ(f.requests.refused(), 1u);
  // The screen's own order: first a scaling that is safe under the new method, then the method.
  f.ask(Kind::kScaling, {}, {1e-6, 4e6});
  f.ask(Kind::kMethod, control::Method::kNone);
  f.tick();
  EXPECT_EQ(f.station.method(), control::Method::kNone);
  EXPECT_EQ(f.station.config().scaling.force, 4e6);
  f.ask(Kind::kScaling, {}, {1e-6, 6e6});  // beyond 5 again
  f.ask(Kind::kScaling, {}, {1e-6, -1});
  f.ask(Kind::kScaling, {}, {0, 1});
  f.tick();
  EXPECT_EQ(f.station.config().scaling.force, 4e6);
  EXPECT_EQ(f.requests.refused(), 4u);
}

TEST(ViewRequestHandler, CountsMarksAndQuits) {
  Fixture f;
  f.ask(Kind::kMarker);
  f.ask(Kind::kMarker);
  EXPECT_EQ(f.tick().marks, 2);
  EXPECT_FALSE(f.tick().quit);
  f.port.quit.store(true);
  EXPECT_TRUE(f.tick().quit);
}

// The one that the station heard of last; a reply that does not know it yet takes nothing away.
TEST(ViewRequestHandler, PassesOnTheNewestPracticeLink) {
  Fixture rig;
  EXPECT_FALSE(rig.requests.answer(rig.station).practice);
  for (const double rtt_ms : {50.0, 120.0}) {
    ViewRequest request;
    request.kind = ViewRequest::Kind::kPractice;
    request.practice = {rtt_ms, 5, 0.02};
    rig.port.requests.push(request);
  }
  const auto asked = rig.requests.answer(rig.station);
  ASSERT_TRUE(asked.practice);
  EXPECT_EQ(asked.practice->rtt_ms, 120);
  EXPECT_EQ(asked.practice->jitter_ms, 5);
  EXPECT_EQ(asked.practice->loss, 0.02);
  EXPECT_FALSE(rig.requests.answer(rig.station).practice);
}

TEST(ViewRequestHandler, AScreenThatFloodsOrStandsStillCostsTheLoopNothing) {
  Fixture f;
  while (f.port.requests.push({Kind::kMarker, {}, {}})) {
  }
  recording::Sample sample;
  support::AllocGuard guard;
  const ViewRequestHandler::Asked asked = f.requests.answer(f.station);
  for (int i = 0; i < 20'000; ++i)
    f.requests.show(sample, device::ForceOffCause::kNone);  // nobody takes them
  f.ask(Kind::kScaling, {}, {1e-6, 3e6});
  f.ask(Kind::kMethod, control::Method::kWave);
  f.requests.answer(f.station);
  EXPECT_EQ(guard.allocations(), 0u);
  EXPECT_LE(asked.marks, 64);
  EXPECT_GT(f.port.samples.dropped(), 0u);
}

// A loop that stood still finds a queue that is full: of that something is lost, of a STOP and of the end nothing.
TEST(ViewRequestHandler, AStopIsHeardWhateverElseWasAsked) {
  Fixture f;
  f.tick();
  while (f.port.requests.push({Kind::kMarker, {}, {}})) {
  }
  EXPECT_FALSE(f.port.requests.push({Kind::kClearStop, {}, {}})) << "no room";
  f.port.stops.fetch_add(1);
  f.port.quit.store(true);
  EXPECT_TRUE(f.tick().quit);
  EXPECT_EQ(f.station.mode(), station::Mode::kStopped);
  // Stopped and cleared between two ticks: nobody knows which was last, and the stop is the safe one.
  f.ask(Kind::kClearStop);
  f.tick();
  ASSERT_NE(f.station.mode(), station::Mode::kStopped);
  f.port.stops.fetch_add(1);
  f.ask(Kind::kClearStop);
  f.tick();
  EXPECT_EQ(f.station.mode(), station::Mode::kStopped);
  for (int i = 0; i < 10; ++i) f.tick();
  f.ask(Kind::kClearStop);
  f.tick();
  EXPECT_NE(f.station.mode(), station::Mode::kStopped) << "a stop is heard once";
}

TEST(ScalingRegion, ClampsToTheBorderThatTheStationChecks) {
  ScalingRegion region;
  region.impedance_bound = Fixture::bounds();
  region.velocity_min = 1e-8;
  region.velocity_max = 1e-4;
  for (const double velocity : {1e-9, 1e-8, 3.3e-7, 1e-6, 7.7e-5, 1.0}) {
    for (const double force : {0.0, 1.0, 1e6, 1e9, 1e30}) {
      for (const control::Method method : control::kAllMethods) {
        const control::Scaling s = region.clamped(method, {velocity, force});
        EXPECT_LE(s.impedance(), region.bound(method));
        EXPECT_GE(s.velocity, region.velocity_min);
        EXPECT_LE(s.velocity, region.velocity_max);
        EXPECT_GT(s.force, 0);
      }
    }
  }
  const control::Scaling inside{1e-6, 1e6};
  EXPECT_EQ(region.clamped(control::Method::kModel, inside).force, inside.force);
  region.unsafe_allowed = true;
  EXPECT_EQ(region.clamped(control::Method::kNone, {1e-6, 1e9}).force, 1e9);
}

TEST(ScalingRegion, SlidersGoBothWays) {
  for (const double value : {1e-8, 2e-7, 1e-6, 1e-4})
    EXPECT_NEAR(value_of(slider_of(value, 1e-8, 1e-4), 1e-8, 1e-4), value, 1e-12 * value);
  EXPECT_EQ(slider_of(0, 1e-8, 1e-4), 0);
  EXPECT_EQ(slider_of(5, 1e-8, 1e-4), 1);
  EXPECT_EQ(value_of(7, 1, 10), 10);
}

}  // namespace
}  // namespace telenano::view_model

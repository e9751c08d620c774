// How long the twin's force is shown without a reply, and without a confirmation.
#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "tests/property/twin/parting_sessions.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

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

}  // namespace
}  // namespace telenano::support

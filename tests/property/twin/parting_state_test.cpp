// A server that does not give its state, or slowly, or one that is too large: how the twin ends, and when.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "telenano/master/twin/scene_twin.h"
#include "tests/property/twin/parting_sessions.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using control::Method;

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

}  // namespace
}  // namespace telenano::support

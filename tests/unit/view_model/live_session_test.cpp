#include "telenano/master/view_model/live_session.h"

#include <gtest/gtest.h>
#include <limits>

#include "telenano/common/link/messages.h"

namespace telenano::view_model {
namespace {

recording::Sample sample_at(std::int64_t tick, double z_nm, double force_nn) {
  recording::Sample s;
  s.tick = tick;
  s.time_s = 1e-3 * static_cast<double>(tick);
  s.reply_sequence = tick + 1;
  s.tip_pos_w_nm = {0.5 * static_cast<double>(tick), 0, z_nm};
  s.force_w_nn = {0, 0, force_nn};
  s.deflection_nm = 0.1 * force_nn;
  s.contact_state =
      static_cast<std::uint32_t>(force_nn > 0 ? link::ContactState::kContact : link::ContactState::kFree);
  s.rtt_us = 100;
  return s;
}

const Ground& plane() {
  static const Ground ground(2, Vec3(-50, -50, 0), Vec3(50, 50, 100));
  return ground;
}

TEST(LiveSession, MeasuresTheGapFromTheGround) {
  LiveSession live(0.25);
  live.take(sample_at(0, 12, 0), plane());
  EXPECT_DOUBLE_EQ(live.gap_nm(), 10);
  live.take(sample_at(1, 1.5, 3), plane());
  EXPECT_DOUBLE_EQ(live.gap_nm(), -0.5);
  EXPECT_TRUE(live.contact());
  EXPECT_EQ(live.touched().points_w_nm().size(), 1u);
  EXPECT_EQ(live.trail().size(), 2u);
}

// PROTOCOL.md: measurement_age_ns is 0 where the force was computed for the command.
TEST(LiveSession, OneMeasuredForceMakesItALiveOneForGood) {
  LiveSession live(0.25);
  EXPECT_EQ(live.origin(), Origin::kUnknown);
  recording::Sample none = sample_at(0, 10, 0);
  none.reply_sequence = 0;
  live.take(none, plane());
  EXPECT_EQ(live.origin(), Origin::kUnknown);
  live.take(sample_at(1, 10, 0), plane());
  EXPECT_EQ(live.origin(), Origin::kComputed);
  recording::Sample measured = sample_at(2, 10, 0);
  measured.measurement_age_ms = 3;
  live.take(measured, plane());
  live.take(sample_at(3, 10, 0), plane());
  EXPECT_EQ(live.origin(), Origin::kMeasured);
}

TEST(LiveSession, CountsARoundTripOnceHoweverManyTicksSeeIt) {
  LiveSession live(0.25);
  recording::Sample s = sample_at(0, 10, 0);
  for (int i = 0; i < 10; ++i) live.take(s, plane());
  EXPECT_EQ(live.round_trips().count(), 1);
}

TEST(LiveSession, ShowsTheParticleWhereItWasSeenLast) {
  LiveSession live(0.25);
  live.take(sample_at(0, 10, 0), plane());
  EXPECT_EQ(live.particle().radius_nm, 0);
  recording::Sample s = sample_at(1, 10, 0);
  s.particle_pos_w_nm = {60, -1.5, 30};
  s.particle_radius_nm = 30;
  s.particle_state = static_cast<std::int64_t>(link::ParticleStatus::kPushed);
  live.take(s, plane());
  const link::Particle there{{60, -1.5, 30}, 30, link::ParticleStatus::kPushed};
  EXPECT_EQ(live.particle(), there);
  live.take(sample_at(2, 10, 0), plane());  // a reply without it
  EXPECT_EQ(live.particle(), there);
  // What a file may hold.
  for (const std::int64_t state : {std::int64_t{4}, std::int64_t{-1}, std::int64_t{1} << 32}) {
    s.particle_pos_w_nm = {1, 2, 3};
    s.particle_state = state;
    live.take(s, plane());
  }
  s.particle_state = 0;
  s.particle_pos_w_nm[1] = std::numeric_limits<double>::quiet_NaN();
  live.take(s, plane());
  EXPECT_EQ(live.particle(), there);
}

TEST(LiveSession, ScaleOfTheConeCoversWhatWasFelt) {
  LiveSession live(0.25);
  EXPECT_EQ(live.force_full_nn(), 5);
  for (const double force : {3.0, 6.0, 19.9, 20.0, 20.1, 73.0, 260.0}) {
    live.take(sample_at(static_cast<std::int64_t>(10 * force), 0, force), plane());
    EXPECT_GE(live.force_full_nn(), force);
    EXPECT_LE(live.force_full_nn(), std::max(5.0, 2.5 * force));
  }
}

}  // namespace
}  // namespace telenano::view_model

// Replies that are left out, on any link, with any deadband: the books of both sides agree, nothing is taken for lost,
// the hand gets no more than was promised and no step of the force.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "bad_path.h"
#include "pressed_wall.h"

namespace telenano::support {
namespace {

using control::Method;

/// From a deadband that nothing is within to one that everything is.
void choose_deadband(Random& random, VirtualSessionConfig& config) {
  loop::ReplyDeadbandConfig& deadband = config.link_options.reply_deadband;
  deadband.permille = random.chance(0.2) ? 1000 : random.uniform(1, 400);
  deadband.floor_n = random.chance(0.2) ? 100 : random.chance(0.2) ? 0 : random.uniform(0, 0.1);
}

TEST(ReplyDeadband, TheBooksOfBothSidesAgreeWhateverIsLeftOutAndLost) {
  constexpr Method kMethods[] = {Method::kKs,   Method::kKsClamp, Method::kTdpa,
                                 Method::kWave, Method::kTank,    Method::kModel};
  std::uint64_t left_out = 0, lost = 0, pressed = 0, by_method[6] = {};
  for (std::uint64_t seed = 1; seed <= 48; ++seed) {
    Random random(1000 + seed);
    PressedWall wall(kMethods[seed % 6], seed);
    make_bad(random, wall.config);
    choose_deadband(random, wall.config);
    // The link heals before the end in every other run; in the rest the books are looked at on the bad one.
    const bool heals = random.chance(0.5);
    wall.start();
    VirtualSession& s = *wall.session;
    wall.steps(8000);
    if (heals) {
      heal(s.link().path_a_to_b());
      heal(s.link().path_b_to_a());
    }
    wall.steps(3000);
    SCOPED_TRACE(std::string(control::method_name(s.station().method())) + ", seed " + std::to_string(seed));
    const auto& known = s.client().slave_energy_aj();
    EXPECT_LE(known.in(), wall.watch->energy_in_aj) << "more than there is";
    EXPECT_LE(known.out(), wall.watch->energy_out_aj);
    const link::LinkQuality q = s.client().quality(s.now_ns());
    by_method[seed % 6] += q.replies_left_out;
    left_out += q.replies_left_out;
    lost += s.link().counts_a_to_b().lost + s.link().counts_b_to_a().lost;
    // With the clutch open the slave holds. A round trip later nothing is under way but what is left out: the force
    // stands still, so that all of it is within the deadband, and the next that must come brings the sums.
    heal(s.link().path_a_to_b());
    heal(s.link().path_b_to_a());
    s.loop().set_buttons(device::kButtonClutch);
    wall.steps(3000);
    EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
    ASSERT_EQ(s.client().state(), link::ClientState::kEstablished);
    EXPECT_EQ(known.in(), wall.watch->energy_in_aj);
    EXPECT_EQ(known.out(), wall.watch->energy_out_aj);
    pressed += wall.watch->energy_in_aj > 1;
    const control::EnergyObserver& observer = s.station().observer();
    const double rounding = 1e-12 * (observer.energy_in_j() + observer.energy_out_j()) + 1e-18;
    const link::Session& at_server = s.server().sessions()[s.client().welcome().session_id & 0xff];
    if (s.client().sessions() == 1) {
      EXPECT_NEAR(at_server.station_energy.in(), observer.energy_in_j(), rounding);
      EXPECT_NEAR(at_server.station_energy.out(), observer.energy_out_j(), rounding);
      // Counts are those of the link: what is neither accepted nor on its way was lost on it, duplicates are not more.
      const link::LinkQuality now = s.client().quality(s.now_ns());
      EXPECT_EQ(now.commands_lost, at_server.commands.lost() + at_server.commands.reordered());
      EXPECT_EQ(s.server().counters().exchanges - s.server().counters().left_out, at_server.reply_sequence);
      EXPECT_LE(now.replies_left_out, s.server().counters().left_out);
    }
    EXPECT_NEAR(observer.energy_j(), -wall.hand->account().given_j(), 1e3 * rounding);
    if (promises(s.station().method())) {
      EXPECT_LE(wall.hand->account().most_extracted_j(), wall.config.station.allowance_j + 1e-9);
    }
  }
  std::printf("left out:");
  for (std::size_t i = 0; i < 6; ++i)
    std::printf(" %s %llu", std::string(control::method_name(kMethods[i])).c_str(),
                static_cast<unsigned long long>(by_method[i]));
  std::printf("; lost %llu\n", static_cast<unsigned long long>(lost));
  EXPECT_GT(left_out, 50'000u) << "or there was nothing to be wrong";
  EXPECT_EQ(by_method[3], 0u) << "waves are always sent";
  EXPECT_GT(lost, 80'000u);
  EXPECT_GT(pressed, 40u);
}

TEST(ReplyDeadband, WhatIsShownIsNeverFurtherThanTheDeadbandFromWhatIsThere) {
  constexpr double kFloor_n = 0.02;
  for (const double permille : {50.0, 200.0}) {
    PressedWall wall(Method::kKsClamp, 3);
    wall.config.link_options.reply_deadband.permille = permille;
    wall.config.link_options.reply_deadband.floor_n = kFloor_n;
    wall.start();
    VirtualSession& s = *wall.session;
    const double n_per_nn = wall.config.station.scaling.hand_force_n(Vec3::UnitX()).x();
    std::int64_t worst_gap = 0, gap = 0, last = 0;
    double worst = 0;
    for (int i = 0; i < 5000; ++i) {
      // Of the command of the tick before; its reply, if there is one, is taken at the beginning of this one.
      const double there_nn = wall.watch->force_nn;
      const recording::Sample& row = wall.step();
      if (i < 10) continue;
      gap = row.reply_sequence == last ? gap + 1 : 0;
      last = row.reply_sequence;
      worst_gap = std::max(worst_gap, gap);
      const double shown_nn = s.client().reply().force_w_nn.z();
      const double most_nn = std::max(kFloor_n / n_per_nn, 1e-3 * permille * std::abs(shown_nn));
      worst = std::max(worst, std::abs(there_nn - shown_nn) / most_nn);
    }
    EXPECT_LE(worst, 1 + 1e-9) << permille;
    EXPECT_GT(worst, 0.3) << "or the deadband was never used";
    EXPECT_LE(worst_gap, 5) << "6 ms between two replies";
    EXPECT_GT(s.client().quality(s.now_ns()).replies_left_out, 2000u);
  }
}

}  // namespace
}  // namespace telenano::support

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "tests/unit/station/station_rig.h"

// Whatever comes in, the force that goes out is finite, within all its limits, and the commands make sense.
namespace telenano::station {
namespace {

double nasty(std::mt19937_64& random) {
  static constexpr double kValues[] = {0,
                                       -0.0,
                                       1e308,
                                       -1e308,
                                       5e-324,
                                       1e-30,
                                       std::numeric_limits<double>::infinity(),
                                       -std::numeric_limits<double>::infinity(),
                                       std::numeric_limits<double>::quiet_NaN()};
  return kValues[random() % std::size(kValues)];
}

TEST(StationFuzz, NothingMakesAnIllegalForce) {
  std::normal_distribution<double> normal;
  for (unsigned seed = 0; seed < 60; ++seed) {
    std::mt19937_64 random(seed);
    StationConfig config;
    config.method = static_cast<control::Method>(seed % 3);
    StationRig rig(config);
    Vec3 old_force_n = Vec3::Zero();
    double in_j = 0, out_j = 0;
    for (int k = 0; k < 5'000; ++k) {
      const auto dice = [&](int n) { return random() % static_cast<unsigned>(n) == 0; };
      for (int axis = 0; axis < 3; ++axis) {
        rig.input.hand_pos_h_m[axis] += 5e-5 * normal(random);
        rig.reply.force_w_nn[axis] = 100 * normal(random);
      }
      const Vec3 good_m = rig.input.hand_pos_h_m;
      const Vec3 applied_n = rig.input.applied_force_h_n;
      if (dice(500)) rig.reply.force_w_nn[static_cast<int>(random() % 3)] = nasty(random);
      if (dice(500)) rig.reply.energy_out_aj = nasty(random);
      if (dice(2000)) rig.input.hand_pos_h_m[static_cast<int>(random() % 3)] = nasty(random);
      if (dice(2000)) rig.input.applied_force_h_n[static_cast<int>(random() % 3)] = nasty(random);
      if (dice(300)) rig.input.buttons ^= device::kButtonClutch;
      if (dice(300)) rig.input.buttons ^= device::kButtonDeadman;
      if (dice(3000)) rig.input.buttons ^= device::kButtonStop;
      if (dice(400)) rig.input.session_up = !rig.input.session_up;
      if (dice(800)) {
        rig.station.begin_session(rig.welcome);
        rig.reply.sequence = 0;
      }
      if (dice(300)) rig.station.clear_stop();
      if (dice(300)) rig.input.time_ns += 150'000'000;
      if (dice(3000)) rig.input.time_ns -= 1'000'000'000;
      const StationOutput& out = rig.tick(!dice(3));
      rig.reply.energy_out_aj = 0;
      rig.input.hand_pos_h_m = good_m;

      ASSERT_TRUE(is_finite(out.hand_force_h_n)) << seed << ' ' << k;
      ASSERT_LE(out.hand_force_h_n.norm(), rig.station.force_limit_n());
      ASSERT_LE(out.hand_force_h_n.norm(), out.trace.force_bound_n);
      const Vec3 old_n =
          is_finite(rig.input.applied_force_h_n) && is_finite(applied_n) ? old_force_n : Vec3::Zero();
      const double norm_n = out.hand_force_h_n.norm();
      if (norm_n > 0 && applied_n == old_force_n && old_n == old_force_n) {
        const double along_n = std::fmax(0.0, old_n.dot(out.hand_force_h_n) / norm_n);
        ASSERT_LE(norm_n, along_n + config.slew_n_s * 1e-3 + 1e-9) << seed << ' ' << k;
      }
      if (out.trace.mode == Mode::kStopped || out.trace.mode == Mode::kIdle) {
        ASSERT_TRUE(out.trace.mode == Mode::kIdle || norm_n == 0);
        ASSERT_FALSE(out.command.flags & link::kFlagClutch);
      }
      ASSERT_TRUE(is_finite(out.command.tip_pos_w_nm));
      ASSERT_TRUE(is_finite(out.command.tip_vel_w_nm_s));
      ASSERT_TRUE(std::isfinite(out.command.energy_in_j) && std::isfinite(out.command.energy_out_j));
      ASSERT_GE(out.command.energy_in_j, in_j);
      ASSERT_GE(out.command.energy_out_j, out_j);
      in_j = out.command.energy_in_j;
      out_j = out.command.energy_out_j;
      old_force_n = out.hand_force_h_n;
    }
  }
}

}  // namespace
}  // namespace telenano::station

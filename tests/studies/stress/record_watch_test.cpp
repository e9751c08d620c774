#include "tests/studies/stress/record_watch.h"

#include <gtest/gtest.h>

namespace telenano::studies::stress {
namespace {

// A row is what was: a place, a force, a tick and a time, each a little off.
TEST(Invariants, ARowThatIsNotWhatWasIsFlagged) {
  const auto flagged = [](auto&& wrong, double quantum_m = 0) {
    RecordWatch watch(1e-3, quantum_m);
    bool right = true;
    for (int k = 0; k < 4; ++k) {
      recording::Sample row;
      row.tick = k;
      row.time_s = 1e-3 * k + (k > 2 ? 2e-3 : 0);
      row.hand_pos_h_m = {0.1 * k, 0.2, 0.3};
      row.hand_force_applied_h_n = {0, 1, 2.5};
      if (k == 3) wrong(row);
      right = watch.is_true(row, Vec3(0.1 * k, 0.2, 0.3), Vec3(0, 1, 2.5), k == 2 ? 3 : 1) && right;
      EXPECT_TRUE(k == 3 || right) << k;
    }
    return !right;
  };
  EXPECT_FALSE(flagged([](recording::Sample&) {})) << "a tick that comes three periods late is none";
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.hand_pos_h_m[1] += 1e-15; }));
  EXPECT_FALSE(flagged([](recording::Sample& row) { row.hand_pos_h_m[1] += 4e-6; }, 1e-5));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.hand_pos_h_m[1] += 6e-6; }, 1e-5));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.hand_force_applied_h_n[2] = 2.4; }));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.tick = 4; }));
  EXPECT_TRUE(flagged([](recording::Sample& row) { row.time_s -= 1e-3; }));
}

TEST(Invariants, ARowsEnergyIsThatOfTheTrueAccount) {
  recording::Sample row;
  row.energy_in_j = 0.3;
  row.energy_out_j = 0.1;
  row.energy_j = 0.2;
  EXPECT_TRUE(RecordWatch::has_energy(row, -0.2, 0));
  EXPECT_TRUE(RecordWatch::has_energy(row, -0.201, 1.1e-3)) << "what an encoder hides";
  EXPECT_FALSE(RecordWatch::has_energy(row, -0.201, 0.9e-3));
  row.energy_j = 0.4;
  EXPECT_FALSE(RecordWatch::has_energy(row, -0.4, 0)) << "in less out is another";
}

TEST(Invariants, ARowsForceIsOneThatTheSlaveHasSaidAndNoneFromBefore) {
  std::vector<RecordWatch::Said> said;
  for (const double force_nn : {1.0, 2.0, 2.0, 3.0}) said.push_back({{0, 0, force_nn}, {4, 5, 6}, 0.5});
  RecordWatch watch(1e-3, 0);
  recording::Sample row;
  EXPECT_TRUE(watch.has_force(row, said)) << "no reply yet";
  row.tip_pos_w_nm = {4, 5, 6};
  row.deflection_nm = 0.5;
  row.force_w_nn[2] = 2;
  EXPECT_TRUE(watch.has_force(row, said));
  EXPECT_TRUE(watch.has_force(row, said)) << "the same reply";
  row.force_w_nn[2] = 1;
  EXPECT_FALSE(watch.has_force(row, said)) << "from before";
  row.force_w_nn[2] = 3;
  EXPECT_TRUE(watch.has_force(row, said));
  row.tip_pos_w_nm = {5, 4, 6};
  EXPECT_FALSE(watch.has_force(row, said)) << "another's place";
  row.tip_pos_w_nm = {4, 5, 6};
  row.deflection_nm = -0.5;
  EXPECT_FALSE(watch.has_force(row, said)) << "bent the other way";
  row.deflection_nm = 0.5;
  row.force_w_nn[2] = 3.003;
  EXPECT_FALSE(watch.has_force(row, said));
  row.force_w_nn[2] = 0;
  EXPECT_FALSE(watch.has_force(row, said)) << "not after a first one";
}

}  // namespace
}  // namespace telenano::studies::stress

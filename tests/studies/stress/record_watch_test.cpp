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

}  // namespace
}  // namespace telenano::studies::stress

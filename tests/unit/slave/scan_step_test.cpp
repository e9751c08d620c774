// What a step over the scan with everything in it may take. Counts, not times: they repeat exactly.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano::slave {
namespace {

// To and fro under 5 nm of pressure, `move_nm` a step: every step finds its balance. Returns the median of
// Newton's iterations.
int median_iterations(double move_nm) {
  const auto scene = scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/humid_flakes.toml");
  NveSlave slave(scene);
  SlaveInput input;
  SlaveOutput output;
  Vec3 target = scene->start_apex_w_nm;
  for (const double bottom = scene->start_touch_w_nm - 5.0; target.z() != bottom;) {
    target.z() = std::max(bottom, target.z() - 1.0);
    input.tip_target_pos_w_nm = target;
    slave.step(input, 1e-3, output);
  }
  std::vector<int> iterations;
  double x = 0, direction = move_nm;
  for (int i = 0; i < 2000; ++i) {
    x += direction;
    if (std::abs(x) > 100.0) direction = -direction;
    input.tip_target_pos_w_nm = target + Vec3(x, 0.37 * x, 0.0);
    slave.step(input, 1e-3, output);
    EXPECT_EQ(output.fault_bits, 0u) << i;
    iterations.push_back(slave.trace().tip.iterations);
  }
  std::nth_element(iterations.begin(), iterations.begin() + 1000, iterations.end());
  return iterations[1000];
}

// As seen are 3 and 5; without the change of friction with the radius in Newton's matrix 5 and more.
TEST(ScanStep, TakesFewIterations) {
  EXPECT_LE(median_iterations(0.1), 4);
  EXPECT_LE(median_iterations(1.0), 5);
}

}  // namespace
}  // namespace telenano::slave

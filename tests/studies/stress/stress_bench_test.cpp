#include "tests/studies/stress/stress_bench.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <string>

#include "telenano/common/config/shared_files.h"
#include "telenano/common/control/methods.h"

namespace telenano::studies::stress {
namespace {

TEST(StressBench, MeasuresEachMethodAndTwoThreads) {
  StressBenchOptions options;
  options.scenes = config::shared_folder() / "scenes";
  options.rounds = 1;
  options.seconds = 0.5;
  const std::string csv = stress_bench_csv(options);
  // Every method, three scenes, two hands; scaling; head.
  const auto methods = static_cast<std::ptrdiff_t>(control::kAllMethods.size());
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), methods * 3 * 2 + 2) << csv;
  EXPECT_NE(csv.find("\nsteps_per_s,oxide,greedy,model,1,"), std::string::npos) << csv;
  EXPECT_NE(csv.find("\nscaling,all,all,all,2,"), std::string::npos) << csv;
}

}  // namespace
}  // namespace telenano::studies::stress

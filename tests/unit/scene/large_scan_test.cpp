// A scan of 4096 × 4096 samples, made up: is it touched at once, in how much memory? Asked: 2 s on one core and
// 1 GB. Bounds of time are three times that and of processor time, since others use the machine.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/scene/scene_summary.h"
#include "telenano/nve_server/scene/tiles_ahead.h"

namespace telenano::scene {
namespace {

constexpr int kSamples = 4096;

double cpu_s() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double most_resident_mb() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return 1e-3 * static_cast<double>(usage.ru_maxrss);
}

class LargeScan : public ::testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/telenano_scan_XXXXXX";
    ASSERT_NE(::mkdtemp(name), nullptr);
    folder_ = name;
    // Row by row, so that the test itself takes no memory.
    std::ofstream file(folder_ + "/large.gsf", std::ios::binary);
    std::string head =
        "Gwyddion Simple Field 1.0\nXRes = 4096\nYRes = 4096\nXReal = 1e-05\nYReal = 1e-05\n"
        "XYUnits = m\nZUnits = m\n";
    head.append(4 - head.size() % 4, '\0');
    file << head;
    // Waves of all lengths, sums of products of one axis' values.
    constexpr int kWaves = 24;
    std::vector<float> along(static_cast<std::size_t>(kWaves) * kSamples);
    for (int w = 0; w < kWaves; ++w) {
      for (int i = 0; i < kSamples; ++i)
        along[static_cast<std::size_t>(w * kSamples + i)] = static_cast<float>(std::sin(wave(w) * i + w));
    }
    std::vector<float> row(kSamples);
    for (int j = 0; j < kSamples; ++j) {
      std::fill(row.begin(), row.end(), 0.0f);
      for (int w = 0; w < kWaves; ++w) {
        const auto height =
            static_cast<float>(1e-8 * 0.004 / wave(w) * std::cos(0.83 * wave(w) * j + 2.1 * w));
        const float* const of = &along[static_cast<std::size_t>(w) * kSamples];
        for (int i = 0; i < kSamples; ++i) row[static_cast<std::size_t>(i)] += height * of[i];
      }
      file.write(reinterpret_cast<const char*>(row.data()), kSamples * sizeof(float));
    }
    std::ofstream(folder_ + "/large.toml") << R"(name = "large"
[sample]
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "scan"
file = "large.gsf"
[forces]
van_der_waals = true
[probe]
tip_radius_nm = 20.0
stiffness_n_m = 40.0
[probe.tip]
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 500.0
margin_nm = 50.0
[start]
x_nm = 4321.0
y_nm = 5432.0
height_nm = 20.0
)";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  static double wave(int w) { return 0.004 * std::pow(1.29, w); }

  std::string folder_;
};

TEST_F(LargeScan, IsTouchedAtOnce) {
  const double before_s = cpu_s();
  SceneLoading loading;
  loading.fields_cache = folder_ + "/cache";
  const auto scene = load_scene(folder_ + "/large.toml", loading);
  const double loaded_s = cpu_s() - before_s;
  physics::PotentialState state;
  Vec3 free_end = scene->start_apex_w_nm;
  double force_nn = 0;
  for (; free_end.z() > scene->start_touch_w_nm - 5.0; free_end.z() -= 0.05)
    force_nn = scene->potential->advance(free_end, scene->port_compliance_nm_nn(), state).force_w_nn.z();
  const double touched_s = cpu_s() - before_s;
  EXPECT_GT(force_nn, 10.0);
  ASSERT_EQ(scene->tiles_ahead.size(), 1u);
  const physics::ScanFields& fields = scene->tiles_ahead[0]->fields();
  const auto touched_mb = 1e-6 * static_cast<double>(fields.bytes());
  std::printf(
      "loaded in %.2f s, touched in %.2f s of processor time (with what is ahead), tiles %.1f MB, at most "
      "%.0f MB resident\n",
      loaded_s, touched_s, touched_mb, most_resident_mb());
  EXPECT_LT(touched_s, 6.0);
  EXPECT_LT(most_resident_mb(), 1000.0);
  EXPECT_LT(touched_mb, 40.0);
  EXPECT_FALSE(std::filesystem::exists(folder_ + "/cache"));  // by tiles: nothing to keep
  // What `check` looks at all over the scan.
  const SceneSummary summary = summarise(*scene);
  EXPECT_GT(summary.pull_off_places, 50);
  EXPECT_GT(summary.radius_low_nm, 1.0);
  EXPECT_LT(summary.radius_high_nm, 400.0);
  std::printf("after `check`: tiles %.1f MB, at most %.0f MB resident, %.2f s\n",
              1e-6 * static_cast<double>(fields.bytes()), most_resident_mb(), cpu_s() - before_s);
  EXPECT_LT(most_resident_mb(), 1000.0);
}

}  // namespace
}  // namespace telenano::scene

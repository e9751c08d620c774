#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <ostream>
#include <random>
#include <string>

#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano::slave {
namespace {

constexpr double kPeriod_s = 1e-3;
constexpr int kSteps = 6000;
constexpr int kHarmonics = 5;

/// A smooth random closed path around a point over which the tip comes and goes.
class ClosedPath {
 public:
  ClosedPath(std::mt19937_64& random, const Vec3& middle, double wide_nm, double high_nm)
      : middle_(middle), size_(wide_nm, wide_nm, high_nm) {
    std::normal_distribution<double> normal;
    for (int i = 0; i < kHarmonics; ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        cosine_[i][axis] = normal(random) / (1 + i);
        sine_[i][axis] = normal(random) / (1 + i);
      }
    }
  }
  /// 0 and 1 are the same place.
  Vec3 at(double part) const {
    Vec3 sum = Vec3::Zero();
    for (int i = 0; i < kHarmonics; ++i) {
      const double angle = 2 * M_PI * (i + 1) * part;
      sum += std::cos(angle) * cosine_[i] + std::sin(angle) * sine_[i];
    }
    return middle_ + 0.5 * size_.cwiseProduct(sum);
  }

 private:
  Vec3 middle_;
  Vec3 size_;
  Vec3 cosine_[kHarmonics], sine_[kHarmonics];
};

struct Loop {
  double work_aj = 0;      // of the port, from forces and displacements alone
  double turnover_aj = 0;  // ∫|F·dx|
  double charged_aj = 0;   // by the slave's account
  double stored_aj = 0;    // change of it
  double dissipated_aj = 0;
  double lost_backwards_aj = 0;  // any step that "dissipated" less than nothing
  int touched = 0;
  int held = 0;
  int most_iterations = 0;
  double ahead_aj = 0;  // charged since the slave began less worked, in all of it
  double least_ahead_aj = 0;
};

/// Goes to the path's begin, once around (so that memory is that of the path), and measures the second round.
Loop go_round(const std::shared_ptr<const scene::Scene>& scene, const ClosedPath& path) {
  NveSlave slave(scene);
  SlaveInput input;
  SlaveOutput out;
  Vec3 target = slave.limits().start_pos_w_nm;
  const Vec3 way = path.at(0) - target;
  Loop loop;
  double before_charged = 0;
  Vec3 before_force = Vec3::Zero(), before_end = target;
  const auto step = [&](const Vec3& to) {
    input.tip_target_pos_w_nm = to;
    slave.step(input, kPeriod_s, out);
    const Vec3 now = slave.trace().commanded_end_w_nm;
    const double charged = out.energy_in_aj - out.energy_out_aj;
    loop.ahead_aj += charged - before_charged + 0.5 * (before_force + out.force_w_nn).dot(now - before_end);
    loop.least_ahead_aj = std::min(loop.least_ahead_aj, loop.ahead_aj);
    loop.most_iterations = std::max(loop.most_iterations, slave.trace().tip.iterations);
    loop.held += out.fault_bits & link::kFaultNoEquilibrium ? 1 : 0;
    before_charged = charged;
    before_force = out.force_w_nn;
    before_end = now;
  };
  step(target);
  loop.ahead_aj = loop.least_ahead_aj = 0;
  for (int i = 1; i <= 500; ++i) step(target + way * (i / 500.0));
  double stored_0 = 0, dissipated_0 = 0, charged_0 = 0;
  Vec3 force = Vec3::Zero(), end = Vec3::Zero();
  for (int round = 0; round < 2; ++round) {
    for (int i = 1; i <= kSteps; ++i) {
      const double lost = slave.trace().dissipated_aj;
      step(path.at(static_cast<double>(i) / kSteps));
      if (round == 0) continue;
      const Vec3 moved = slave.trace().commanded_end_w_nm - end;
      const double work = -0.5 * (force + out.force_w_nn).dot(moved);
      loop.work_aj += work;
      loop.turnover_aj += std::abs(work);
      loop.lost_backwards_aj = std::min(loop.lost_backwards_aj, slave.trace().dissipated_aj - lost);
      loop.touched += out.contact_state == link::ContactState::kContact ? 1 : 0;
      force = out.force_w_nn;
      end = slave.trace().commanded_end_w_nm;
    }
    if (round == 0) {
      stored_0 = slave.trace().stored_aj;
      dissipated_0 = slave.trace().dissipated_aj;
      charged_0 = out.energy_in_aj - out.energy_out_aj;
      force = out.force_w_nn;
      end = slave.trace().commanded_end_w_nm;
    }
  }
  loop.charged_aj = out.energy_in_aj - out.energy_out_aj - charged_0;
  loop.stored_aj = slave.trace().stored_aj - stored_0;
  loop.dissipated_aj = slave.trace().dissipated_aj - dissipated_0;
  return loop;
}

struct Case {
  const char* scene;
  double wide_nm;
  double high_nm;
  /// How far the account may be from the port's work, of the turnover. A jump's step has no trapezium: its size
  /// over the loop's many steps is most of it. Over relief the
  /// account is never behind the trapezia, and this is what it may be ahead.
  double tolerance;
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.scene;
}

class SceneEnergy : public ::testing::TestWithParam<Case> {};

TEST_P(SceneEnergy, WorkIsStoredOrDissipatedOnClosedPaths) {
  const Case& c = GetParam();
  const auto scene = scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/" + c.scene);
  std::mt19937_64 random(11);
  int touched = 0;
  for (int trial = 0; trial < 3; ++trial) {
    Vec3 middle = scene->start_apex_w_nm;
    middle.z() = scene->start_touch_w_nm;
    const ClosedPath path(random, middle, c.wide_nm, c.high_nm);
    const Loop loop = go_round(scene, path);
    // The account itself, to rounding of its sums.
    EXPECT_NEAR(loop.charged_aj, loop.stored_aj + loop.dissipated_aj, 1e-9 * loop.turnover_aj + 1e-9);
    EXPECT_GE(loop.lost_backwards_aj, 0);
    EXPECT_GE(loop.dissipated_aj, 0);
    // And against what the port really did.
    EXPECT_NEAR(loop.charged_aj, loop.work_aj, c.tolerance * loop.turnover_aj) << trial;
    EXPECT_EQ(loop.held, 0);
    touched += loop.touched;
    RecordProperty("difference_of_turnover_" + std::to_string(trial),
                   std::to_string((loop.charged_aj - loop.work_aj) / loop.turnover_aj));
    std::printf("%-42s charged %12.5g aJ, work %12.5g aJ, of turnover %9.2e, in contact %d of %d\n", c.scene,
                loop.charged_aj, loop.work_aj, (loop.charged_aj - loop.work_aj) / loop.turnover_aj,
                loop.touched, kSteps);
  }
  EXPECT_GT(touched, 100);
}

INSTANTIATE_TEST_SUITE_P(Deployed, SceneEnergy,
                         ::testing::Values(Case{"deploy/scenes/flat_silicon_oxide.toml", 10, 12, 1e-3},
                                           Case{"deploy/scenes/flat_polystyrene.toml", 10, 12, 1e-3},
                                           Case{"deploy/scenes/flat_pdms.toml", 10, 60, 1e-6},
                                           Case{"deploy/scenes/flakes.toml", 40, 12, 5e-3},
                                           Case{"deploy/scenes/humid_flakes.toml", 40, 12, 5e-3},
                                           Case{"deploy/scenes/lithography.toml", 20, 12, 1e-3},
                                           Case{"deploy/scenes/particle.toml", 60, 12, 1e-3}),
                         [](const auto& each) {
                           return std::filesystem::path(each.param.scene).stem().string();
                         });

// All over a scan: every step ends with a balance or on the way to one, within its iterations; and whatever
// the way, all that the port has worked since the slave began has been charged, so that no credit is without
// payment. 1e-12: rounding of the sums.
TEST(SceneAccount, IsNeverBehindThePortsWork) {
  for (const char* name : {"flakes", "humid_flakes", "lithography"}) {
    const auto scene =
        scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
    const bool scan = scene->start_apex_w_nm.x() > 100;
    std::mt19937_64 random(77);
    std::uniform_real_distribution<double> uniform(0, 1);
    double ahead = 0;
    for (int trial = 0; trial < 5; ++trial) {
      Vec3 middle = scene->start_apex_w_nm;
      if (scan) {
        middle.x() = 60 + 480 * uniform(random);
        middle.y() = 60 + 480 * uniform(random);
      }
      middle.z() = scene->touch_height_nm(middle.x(), middle.y());
      const Loop loop = go_round(scene, ClosedPath(random, middle, 40, 12));
      EXPECT_EQ(loop.held, 0) << name << " " << trial;
      EXPECT_LE(loop.most_iterations, 54 + 15) << name << " " << trial;
      EXPECT_GE(loop.least_ahead_aj, -1e-12 * loop.turnover_aj - 1e-9) << name << " " << trial;
      ahead = std::max(ahead, loop.ahead_aj / loop.turnover_aj);
    }
    EXPECT_LT(ahead, 0.1) << name;
    RecordProperty(std::string("ahead_of_turnover_") + name, std::to_string(ahead));
  }
}

}  // namespace
}  // namespace telenano::slave

// Companding of the scenes' own attraction: closed paths in three dimensions before contact, over real ground,
// with the slave that a twin is. The oracle is the sum of the force shown over the path.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "telenano/common/control/companding.h"
#include "telenano/common/link/messages.h"
#include "telenano/master/twin/scene_twin.h"
#include "tests/property/twin/felt_run.h"

namespace telenano::support {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// Goes where it is told, slowly enough that the coupling's damper takes next to nothing.
class Tip {
 public:
  explicit Tip(const std::shared_ptr<const scene::Scene>& scene, const control::CompandingConfig& config)
      : slave_(scene), at_w_nm_(scene->start_apex_w_nm) {
    companding_.configure(config);
  }
  void to(const Vec3& target_w_nm) {
    control::LocalStep step;
    step.target_w_nm = target_w_nm;
    step.dt_s = 1e-2;
    step.vel_w_nm_s = (target_w_nm - at_w_nm_) / step.dt_s;
    step.flags = link::kFlagClutch | link::kFlagDeadman;
    const Vec3 last_shown = shown_w_nn, last_force = answer.force_w_nn;
    const Vec3 last_commanded = answer.commanded_pos_w_nm;
    slave_.step(step, answer);
    touches = answer.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact);
    const double net_aj = answer.energy_in_aj - answer.energy_out_aj;
    companded_aj += companding_.step(answer.stored_aj, net_aj - net_aj_, touches);
    net_aj_ = net_aj;
    shown_w_nn = companding_.gain() * answer.force_w_nn;
    const Vec3 moved = answer.commanded_pos_w_nm - last_commanded;
    work_aj -= 0.5 * (last_shown + shown_w_nn).dot(moved);
    plain_aj -= 0.5 * (last_force + answer.force_w_nn).dot(moved);
    turnover_aj += std::fabs(0.5 * (last_shown + shown_w_nn).dot(moved));
    at_w_nm_ = target_w_nm;
  }
  const Vec3& at() const { return at_w_nm_; }
  void begin_sums() { work_aj = plain_aj = turnover_aj = companded_aj = 0; }

  control::LocalAnswer answer;
  Vec3 shown_w_nn = Vec3::Zero();
  bool touches = false;
  double work_aj = 0, plain_aj = 0, turnover_aj = 0, companded_aj = 0;  ///< put in at the port

 private:
  twin::SceneTwin slave_;
  control::Companding companding_;
  Vec3 at_w_nm_;
  double net_aj_ = 0;
};

class CompandingPaths : public ::testing::TestWithParam<std::string> {};

// The height at which it snaps in is found first; the loops then stay just above it.
TEST_P(CompandingPaths, ClosedOnesBeforeContactGiveNothing) {
  const auto scene = deployed(GetParam());
  const control::CompandingConfig config{5, 1};
  const Vec3 start = scene->start_apex_w_nm;
  double snap_nm = 0, most_far_nn = 0;
  {
    Tip tip(scene, config);
    for (double z = start.z(); !tip.touches && z > start.z() - 200; z -= 0.01) {
      tip.to({start.x(), start.y(), z});
      snap_nm = z;
    }
    ASSERT_TRUE(tip.touches);
  }
  const double low_nm = snap_nm + 0.4;
  Tip tip(scene, config);
  const auto at = [&](double turn) {
    const double a = 2 * kPi * turn;
    return Vec3(start.x() + 1.5 * std::sin(a), start.y() + std::sin(2 * a),
                low_nm + 2.5 * (1 - std::cos(a)) + (turn < 0 ? -5 * turn : 0));
  };
  for (double turn = -1; turn < 0; turn += 1e-3) tip.to(Vec3(start.x(), start.y(), low_nm - 8 * turn));
  // Rough ground may snap in elsewhere on the way: then the loop is nobody's of this test.
  constexpr int kSteps = 8000;
  tip.begin_sums();
  bool touched = false;
  for (int i = 0; i <= kSteps; ++i) {
    tip.to(at(static_cast<double>(i) / kSteps));
    if (i == 0) tip.begin_sums();
    touched = touched || tip.touches;
    most_far_nn = std::max(most_far_nn, -tip.answer.force_w_nn.z());
  }
  ASSERT_FALSE(touched) << "choose another loop";
  std::printf(
      "%-20s snaps in at %.2f nm; loop to %.3g nN: companded %.3g aJ of %.3g turned over, plain %.3g\n",
      GetParam().c_str(), snap_nm - scene->start_touch_w_nm, most_far_nn, tip.work_aj, tip.turnover_aj,
      tip.plain_aj);
  EXPECT_GT(tip.turnover_aj, 0.1);
  // Trapezia of 8000 steps, and the damper of the coupling, which only takes.
  EXPECT_GT(tip.work_aj, -1e-4 * tip.turnover_aj);
  EXPECT_LT(std::fabs(tip.work_aj), 2e-3 * tip.turnover_aj);
  // The account is what the sum says.
  EXPECT_NEAR(tip.companded_aj, tip.work_aj, 2e-3 * tip.turnover_aj);
}

// Down, snap-in, along, up, pull-off, up again: what comes back is less than what was put in, and the account is
// never below the well by more than (g - 1) U0.
TEST_P(CompandingPaths, LoopsThroughContactAreDissipative) {
  const auto scene = deployed(GetParam());
  const control::CompandingConfig config{10, 1};
  const Vec3 start = scene->start_apex_w_nm;
  Tip tip(scene, config);
  twin::SceneTwin other(scene);
  double least_aj = 0;
  const double deep_nm = scene->start_touch_w_nm - 2;
  const auto go = [&](const Vec3& to) {
    const Vec3 from = tip.at();
    const int steps = static_cast<int>(std::ceil((to - from).norm() / 0.02));
    for (int i = 1; i <= steps; ++i) {
      tip.to(from + (to - from) * (static_cast<double>(i) / steps));
      least_aj = std::min(least_aj, tip.companded_aj);
    }
  };
  go(start);
  for (int round = 0; round < 3; ++round) {
    tip.begin_sums();
    go({start.x(), start.y(), deep_nm});
    go({start.x() + 6, start.y() - 3, deep_nm});
    go({start.x() + 6, start.y() - 3, start.z()});
    go(start);
    EXPECT_GT(tip.companded_aj, -1e-6) << round;
  }
  EXPECT_GE(least_aj, -other.well_aj() - config.most_aj());
}

INSTANTIATE_TEST_SUITE_P(Scenes, CompandingPaths,
                         ::testing::Values("flat_silicon_oxide", "flat_polystyrene", "flat_pdms", "flakes",
                                           "humid_flakes", "lithography"),
                         [](const auto& scene) { return scene.param; });

}  // namespace
}  // namespace telenano::support

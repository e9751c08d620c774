// What samples give of their own, over scenes that a station goes to and comes back to. Oracle: the account of a hand
// that does not move is what it was granted; it may never hold more than each scene's well once, at the price of its
// time, and the station's own limit.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>

#include "telenano/common/base/random.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

using control::Method;

constexpr std::array<double, 4> kWell_aj = {300, 50, 800, 0};
constexpr std::uint64_t kFeatures = link::kFeaturePortControl | link::kFeatureLocalModel | link::kFeatureWell;

/// A server that says, in each session, that its sample gives without end.
class Greedy {
 public:
  explicit Greedy(Method method) : rig(config(method)) {
    rig.welcome.feature_bits = kFeatures;
    go(0, 0);
    rig.station.clear_stop();  // the rig's own scene was another one
    rig.tick();
  }
  static StationConfig config(Method method) {
    StationConfig config;
    config.method = method;
    config.leak_time_s = 0;
    return config;
  }

  /// To this scene, at a scale that is so much times the first one's price.
  void go(std::size_t scene, double price) {
    StationConfig next = rig.station.config();
    if (price > 0) {
      next.scaling.velocity = 1e-6 / price;
      next.scaling.force = 2e7;
      rig.station.go_to_scene(next, {10, 0, 500}, nullptr, 100 + scene);
    }
    rig.welcome.scene_hash = 100 + scene;
    rig.welcome.epoch += 1;
    rig.welcome.session_id += 1;
    rig.welcome.well_aj = kWell_aj[scene];
    rig.station.begin_session(rig.welcome);
    rig.reply = {};
    const double now_j = kWell_aj[scene] * rig.station.config().scaling.hand_energy_j(1);
    most_j_[scene] = std::max(most_j_[scene], now_j);
    rig.tick(false);
  }
  void give(double aj) {
    rig.reply.energy_out_aj += aj;
    rig.reply.port.energy_sent_aj += aj;
    rig.tick();
  }
  double account_j() const { return rig.output.trace.account_j; }
  /// Of each scene that it was in, the well at the dearest price so far.
  double bound_j() const {
    double sum_j = 0;
    for (const auto& [scene, most_j] : most_j_) sum_j += most_j;
    return std::min(sum_j, rig.station.config().well_max_j);
  }

  StationRig rig;

 private:
  std::map<std::size_t, double> most_j_;
};

/// What the tank was granted to send to the slave comes back, and is no sample's.
double grant_j(Method method) {
  return method == Method::kTank ? StationConfig{}.allowance_j : 0;
}

TEST(SceneAccount, ThereAndBackGrantsNoWellTwice) {
  for (const Method method : {Method::kModel, Method::kTank}) {
    Greedy s(method);
    const double j = s.rig.station.config().scaling.hand_energy_j(1);
    const double grant = grant_j(method);
    s.give(1e6);
    const double first_j = s.account_j();
    EXPECT_GE(first_j, 300 * j * 0.999);
    EXPECT_LE(first_j, 300 * j + grant + 1e-12);
    s.go(1, 1);
    s.give(1e6);
    const double both_j = s.account_j();
    EXPECT_LE(both_j, 350 * j + grant + 1e-12);
    if (method == Method::kModel) {
      EXPECT_NEAR(both_j, 350 * j, 1e-12) << "a sample that was not touched yet has its own";
    }
    for (int k = 0; k < 50; ++k) {
      s.go(0, 1);
      s.give(1e6);
      s.go(1, 1);
      s.give(1e6);
    }
    EXPECT_LE(s.account_j(), 350 * j + grant + 1e-12);
    EXPECT_EQ(s.rig.station.latched_faults(), 0u) << "each was asked for";
  }
}

TEST(SceneAccount, AnyWayThroughAnyScenesAtAnyPriceIsWithinTheWellsOnce) {
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    Random random(seed);
    const Method method = random.chance(0.5) ? Method::kModel : Method::kTank;
    Greedy s(method);
    for (int k = 0; k < 60; ++k) {
      if (random.chance(0.3)) s.go(random.below(kWell_aj.size()), 0.25 + 4 * random.uniform());
      s.give(random.chance(0.2) ? 1e9 : 100 * random.uniform());
      ASSERT_LE(s.account_j(), s.bound_j() + grant_j(method) + 1e-12) << "seed " << seed << ", step " << k;
    }
  }
}

TEST(SceneAccount, ManyScenesOfAServerThatLiesAreWithinTheStationsOwnLimit) {
  Greedy s(Method::kModel);
  for (std::size_t k = 0; k < 200; ++k) {
    StationConfig config = s.rig.station.config();
    s.rig.station.go_to_scene(config, {10, 0, 500}, nullptr, 1000 + k);
    s.rig.welcome.scene_hash = 1000 + k;
    s.rig.welcome.epoch += 1;
    s.rig.welcome.well_aj = 1e300;
    s.rig.station.begin_session(s.rig.welcome);
    s.rig.reply = {};
    s.give(1e300);
    ASSERT_LE(s.account_j(), config.well_max_j + 1e-12);
  }
}

TEST(SceneAccount, ASceneThatNobodyHasAskedForIsStillAStop) {
  Greedy s(Method::kModel);
  s.rig.station.go_to_scene(s.rig.station.config(), {10, 0, 500}, nullptr, 101);
  s.rig.welcome.scene_hash = 102;
  s.rig.station.begin_session(s.rig.welcome);
  EXPECT_EQ(s.rig.station.latched_faults(), kFaultOtherScene);
  s.rig.station.clear_stop();
  // What was expected is so for one session only.
  s.rig.welcome.scene_hash = 101;
  s.rig.station.begin_session(s.rig.welcome);
  EXPECT_EQ(s.rig.station.latched_faults(), kFaultOtherScene);
}

TEST(SceneAccount, AStifferSlaveThanWasPlannedForIsStillAStop) {
  Greedy s(Method::kModel);
  s.rig.station.go_to_scene(s.rig.station.config(), {20, 0, 500}, nullptr, 101);
  s.rig.welcome.scene_hash = 101;
  s.rig.welcome.coupling_stiffness_n_m = 20;
  s.rig.station.begin_session(s.rig.welcome);
  EXPECT_EQ(s.rig.station.latched_faults(), 0u) << "the new plan counts";
  s.rig.station.go_to_scene(s.rig.station.config(), {10, 0, 500}, nullptr, 100);
  s.rig.welcome.scene_hash = 100;
  s.rig.station.begin_session(s.rig.welcome);
  EXPECT_EQ(s.rig.station.latched_faults(), kFaultSlaveStiffer);
}

// The hand may be anywhere when the loop goes on: no step of it is measured over the gap, and no force leaps.
TEST(SceneAccount, TheHandMayHaveMovedMeanwhile) {
  Greedy s(Method::kModel);
  s.rig.engage({0, 0, 50});
  ASSERT_GT(s.rig.force_n(), 0.1);
  s.rig.input.applied_force_h_n.setZero();  // the loop ends, the device shows nothing
  s.rig.input.hand_pos_h_m = {0.05, 0, 0};
  s.go(1, 1);
  const double before_j = s.account_j();
  double last_n = 0;
  s.rig.reply.force_w_nn = {0, 0, 50};
  for (int k = 0; k < 400; ++k) {
    s.rig.tick();
    EXPECT_LE(s.rig.force_n(), last_n + StationConfig{}.slew_n_s * 1e-3 + 1e-12);
    if (k == 0) {
      EXPECT_LE(s.rig.force_n(), 0.01) << "by the ramp";
    }
    last_n = s.rig.force_n();
  }
  EXPECT_EQ(s.rig.station.latched_faults(), 0u) << "no velocity trip";
  EXPECT_EQ(s.rig.station.mode(), Mode::kEngaged);
  EXPECT_LE(s.account_j(), before_j + 1e-12) << "nothing is granted by it";
}

}  // namespace
}  // namespace telenano::station

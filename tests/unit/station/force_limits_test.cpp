#include "telenano/master/station/force_limits.h"

#include <gtest/gtest.h>

#include "telenano/master/station/station.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::station {
namespace {

TEST(Station, ForceIsLimitedAndSlewed) {
  StationConfig config;
  config.method = control::Method::kNone;
  StationRig rig(config);
  rig.engage(Vec3(0, 0, 0));
  rig.reply.force_w_nn = Vec3(0, 0, 5000);  // 100 N
  rig.tick();
  EXPECT_NEAR(rig.force_n(), 4, 1e-9);  // 4000 N/s
  EXPECT_TRUE(rig.output.trace.slewed);
  rig.ticks(2);
  EXPECT_NEAR(rig.force_n(), 9.6, 1e-9);  // ε f̂_a
  EXPECT_TRUE(rig.output.trace.limited);
  EXPECT_LE(rig.force_n(), 9.6);
  rig.reply.force_w_nn = Vec3(0, 0, -5000);
  rig.tick();
  EXPECT_NEAR(rig.output.hand_force_h_n.z(), -4, 1e-9);  // a reversal grows from zero
  rig.reply.force_w_nn.setZero();
  rig.tick();
  EXPECT_EQ(rig.force_n(), 0);  // a decrease is never delayed
}

TEST(Station, HugeButFiniteForcesStayFiniteAndLimited) {
  StationRig rig;
  rig.engage(Vec3(1e300, -1e300, 1e300));
  EXPECT_TRUE(is_finite(rig.output.hand_force_h_n));
  EXPECT_LE(rig.force_n(), 9.6);
}

TEST(ForceLimits, SlewIsRotationFriendly) {
  bool cut = false;
  const Vec3 turned = limit_slew(Vec3(0, 3, 0), Vec3(3, 0, 0), 0.5, cut);
  EXPECT_TRUE(cut);
  EXPECT_NEAR(turned.norm(), 0.5, 1e-12);  // nothing of the old force acts in the new direction
  EXPECT_EQ(limit_slew(Vec3(2, 0, 0), Vec3(3, 0, 0), 0, cut), Vec3(2, 0, 0));
  EXPECT_FALSE(cut);
}

TEST(ForceLimits, NormNeverExceedsTheBound) {
  for (double bound : {1e-300, 1e-9, 0.1, 9.6, 1e9}) {
    for (double scale : {1.0000001, 3.0, 1e12}) {
      bool cut = false;
      const Vec3 f = limit_norm(bound * scale * Vec3(0.3, -0.5, 0.812), bound, cut);
      EXPECT_LE(f.norm(), bound);
    }
  }
}

}  // namespace
}  // namespace telenano::station

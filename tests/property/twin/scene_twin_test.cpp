// What a twin says at once when it has taken up a state: all that the slave says that made the state.
#include "telenano/master/twin/scene_twin.h"

#include <gtest/gtest.h>

#include <span>
#include <vector>

#include "telenano/nve_server/slave/logged_step.h"
#include "tests/property/twin/felt_run.h"

namespace telenano::support {
namespace {

TEST(SceneTwin, SaysTheContactOfAStateThatItTakesUp) {
  const auto scene = deployed("flakes");
  slave::NveSlave server(scene);
  slave::SlaveOutput output;
  const double deep_nm = scene->start_apex_w_nm.z() - scene->start_touch_w_nm + 2;
  for (int i = 1; i <= 400; ++i) {
    const Vec3 target = scene->start_apex_w_nm - Vec3(0, 0, deep_nm * i / 400);
    server.step(slave::input_of(target, Vec3(0, 0, -deep_nm / 0.4), link::kFlagClutch | link::kFlagDeadman,
                                true, false),
                1e-3, output);
  }
  ASSERT_GT(server.contact_radius_nm(), 1) << "it does not touch";
  std::vector<std::uint8_t> state(server.snapshot_bytes_max());
  const std::size_t size = server.save(state);

  twin::SceneTwin twin(scene);
  control::LocalAnswer answer;
  ASSERT_TRUE(twin.load(std::span(state).first(size), answer));
  EXPECT_EQ(answer.contact_radius_nm, server.contact_radius_nm());
  EXPECT_EQ(answer.adhesion_nn, server.adhesion_nn());
  EXPECT_EQ(answer.stored_aj, server.stored_aj());
  EXPECT_EQ(answer.force_w_nn, output.force_w_nn);
}

}  // namespace
}  // namespace telenano::support

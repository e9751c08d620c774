// Marks taken back by a station. The oracle is the surface of the server's own slave, copied before the stroke.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using control::Method;

/// Two grooves beside each other, 2.5 s each, the tip high above the sample at the ends and between them.
struct Grooves {
  explicit Grooves(Method method, double rtt_ms, double loss = 0) {
    scene = scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/lithography.toml");
    config.scene = scene;
    config.station.method = method;
    config.twin = method == Method::kTwin;
    config.to_server.delay_ns = config.to_station.delay_ns = static_cast<std::int64_t>(0.5e6 * rtt_ms);
    config.to_server.loss = config.to_station.loss = loss;
    config.task = device::Task::kScript;
    const double z0 = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
    config.script = {{0, {0, 0, z0}},      {0.8, {0, 0, -10}},  {1.6, {12, 0, -10}},
                     {2.0, {12, 0, z0}},   {3.0, {0, 10, z0}},  {3.8, {0, 10, -10}},
                     {4.6, {12, 10, -10}}, {5.0, {12, 10, z0}}, {60.0, {12, 10, z0}}};
    config.make_slave = [this] {
      auto slave = std::make_unique<slave::NveSlave>(scene);
      servers = slave.get();
      return slave;
    };
  }
  void start() { session = std::make_unique<VirtualSession>(config); }
  void steps(int n) {
    for (int i = 0; i < n; ++i) session->step();
  }
  std::vector<double> heights() const { return servers->marked_surface()->heights().z_nm; }
  std::shared_ptr<const scene::Scene> scene;
  VirtualSessionConfig config;
  const slave::NveSlave* servers = nullptr;
  std::unique_ptr<VirtualSession> session;
};

TEST(UndoSession, OneWishTakesOneStrokeBackWhateverIsLost) {
  for (const double loss : {0.0, 0.3}) {
    Grooves g(Method::kKsClamp, 40, loss);
    g.start();
    const auto bare = g.heights();
    g.steps(2900);
    const auto first = g.heights();
    ASSERT_NE(first, bare) << loss;
    ASSERT_TRUE(g.session->loop().undo_marks(g.session->now_ns()));
    g.steps(600);
    EXPECT_EQ(g.session->loop().undo_answer(), loop::UndoAnswer::kDone) << loss;
    EXPECT_EQ(g.heights(), bare) << loss;
    g.steps(2400);  // the second groove
    const auto second = g.heights();
    ASSERT_NE(second, bare) << loss;
    ASSERT_TRUE(g.session->loop().undo_marks(g.session->now_ns())) << loss;
    g.steps(600);
    EXPECT_EQ(g.heights(), bare) << loss;
    ASSERT_TRUE(g.session->loop().undo_marks(g.session->now_ns())) << loss;
    g.steps(600);
    EXPECT_EQ(g.session->loop().undo_answer(), loop::UndoAnswer::kRefused) << loss << ": there is none left";
    EXPECT_EQ(g.session->server().counters().undone, 2u) << loss;
  }
}

TEST(UndoSession, RefusedInContactAndWithoutTheRight) {
  Grooves g(Method::kKsClamp, 20);
  g.start();
  g.steps(1700);
  ASSERT_EQ(g.session->station().reply().contact_state, link::ContactState::kContact);
  ASSERT_TRUE(g.session->loop().undo_marks(g.session->now_ns()));
  g.steps(100);
  EXPECT_EQ(g.session->loop().undo_answer(), loop::UndoAnswer::kRefused);
  g.steps(1100);
  const auto marked = g.heights();
  net::Standing observes;
  observes.rights = net::Rights::kObserve;
  g.session->set_standing(observes);
  ASSERT_TRUE(g.session->loop().undo_marks(g.session->now_ns()));
  g.steps(100);
  EXPECT_EQ(g.session->loop().undo_answer(), loop::UndoAnswer::kRefused);
  EXPECT_EQ(g.heights(), marked);
}

TEST(UndoSession, ATwinTakesTheStateUpAndAgreesAgain) {
  Grooves g(Method::kTwin, 60);
  g.start();
  const auto bare = g.heights();
  g.steps(2900);
  ASSERT_NE(g.heights(), bare);
  const station::TwinRun& twin = *g.session->station().twin();
  ASSERT_TRUE(g.session->loop().undo_marks(g.session->now_ns()));
  double felt = 0;
  for (int i = 0; i < 600; ++i) {
    g.session->step();
    felt = std::max(felt, g.session->loop().trace().commanded_force_h_n.norm());
  }
  EXPECT_EQ(g.session->loop().undo_answer(), loop::UndoAnswer::kDone);
  EXPECT_EQ(g.heights(), bare);
  EXPECT_EQ(twin.reason(), std::uint32_t{link::kBreakUndo});
  EXPECT_EQ(twin.partings(), 1u);
  EXPECT_TRUE(twin.state() == station::TwinState::kBehind || twin.state() == station::TwinState::kConfirmed);
  const surface::HeightGrid seen = twin.heights()->heights();
  for (std::size_t i = 0; i < bare.size(); ++i) ASSERT_NEAR(seen.z_nm[i], bare[i], 1e-6) << i;
  EXPECT_LT(felt, 0.1) << "the tip is off the sample: nothing is felt of it";
  g.steps(2400);
  EXPECT_EQ(twin.partings(), 1u) << "the second groove is the same at both ends";
  EXPECT_NE(g.heights(), bare);
}

TEST(UndoSession, AServerOrASampleThatCannotIsNotAsked) {
  VirtualSessionConfig config;
  config.scene =
      scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flat_silicon_oxide.toml");
  VirtualSession session(config);
  for (int i = 0; i < 200; ++i) session.step();
  EXPECT_EQ(session.client().welcome().feature_bits & link::kFeatureUndo, 0u);
  EXPECT_FALSE(session.loop().undo_marks(session.now_ns()));
}

}  // namespace
}  // namespace telenano::support

// Marks taken back at a tip that several stations share. Who may take back what; what the others see. The oracle is the
// surface of the server's one slave, copied before each stroke.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using control::Method;
using link::ContactState;
using loop::UndoAnswer;
using net::Rights;

using Script = std::vector<device::IntendedMotion::Waypoint>;

/// One server with one tip on the lithography scene, and stations that come one after the other.
struct Shared {
  Shared() : scene(scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/lithography.toml")) {}

  /// Index of the new station. Its hand moves from where it takes the tip up.
  std::size_t join(Rights rights, Method method, const Script& script) {
    VirtualSessionConfig config;
    config.scene = scene;
    config.make_slave = [this] {
      auto slave = std::make_unique<slave::NveSlave>(scene);
      servers = slave.get();
      return slave;
    };
    config.share = server::Share::kOneTip;
    config.station.method = method;
    config.twin = method == Method::kTwin;
    config.twin_look_s = 0.5;
    config.to_server.delay_ns = config.to_station.delay_ns = 10'000'000;
    config.port = static_cast<std::uint16_t>(1001 + all.size());
    config.seed = config.port;
    config.standing.rights = rights;
    config.task = device::Task::kScript;
    config.script = script;
    if (!all.empty()) {
      config.server = all[0]->shared_server();
      config.start_ns = all[0]->now_ns();
    }
    all.push_back(std::make_unique<VirtualSession>(config));
    while (all[0]->now_ns() < all.back()->now_ns())
      for (std::size_t i = 0; i + 1 < all.size(); ++i) all[i]->step();
    return all.size() - 1;
  }
  void steps(int n) {
    for (int i = 0; i < n; ++i)
      for (auto& one : all) one->step();
  }
  bool holds(std::size_t i) const { return all[i]->station().holds_tip() && all[i]->client().has_reply(); }
  /// The tip goes from one to the other, and is taken up there.
  void hand_over(std::size_t from, std::size_t to) {
    all[from]->loop().set_tip_wish(link::kFlagHandOver);
    all[to]->loop().set_tip_wish(link::kFlagTakeOver);
    steps(300);
    all[to]->loop().set_tip_wish(0);
    steps(100);
    ASSERT_TRUE(holds(to));
    ASSERT_FALSE(holds(from));
  }
  UndoAnswer undo(std::size_t i) {
    EXPECT_TRUE(all[i]->loop().undo_marks(all[i]->now_ns()));
    steps(150);
    return all[i]->loop().undo_answer();
  }
  std::vector<double> heights() const { return servers->marked_surface()->heights().z_nm; }
  std::uint64_t undone() const { return all[0]->server().counters().undone; }
  double z0() const { return scene->start_apex_w_nm.z() - scene->start_touch_w_nm; }
  ContactState contact() const { return all[0]->station().reply().contact_state; }

  std::shared_ptr<const scene::Scene> scene;
  const slave::NveSlave* servers = nullptr;
  std::vector<std::unique_ptr<VirtualSession>> all;
};

/// Down, along and up again within 2 s after `from_s` of the hand's own time, which begins when it engages.
void groove(Script& script, double from_s, double z0, double x_nm, double y_nm) {
  script.insert(script.end(), {{from_s, {x_nm, y_nm, z0}},
                               {from_s + 0.7, {x_nm, y_nm, -10}},
                               {from_s + 1.4, {x_nm + 10, y_nm, -10}},
                               {from_s + 2.0, {x_nm + 10, y_nm, z0}}});
}

class SharedUndo : public ::testing::TestWithParam<Method> {};

TEST_P(SharedUndo, EachTakesBackItsOwnStrokesAndNobodyAnothers) {
  Shared s;
  Script first, second;
  groove(first, 0, s.z0(), 0, 0);
  first.push_back({60, {10, 0, s.z0()}});
  groove(second, 0, s.z0(), 0, 12);
  second.push_back({60, {10, 12, s.z0()}});
  const std::size_t a = s.join(Rights::kOperate, GetParam(), first);
  const auto bare = s.heights();
  s.steps(2600);
  ASSERT_TRUE(s.holds(a));
  ASSERT_LE(s.contact(), ContactState::kVanDerWaals) << "off the sample";
  const auto of_a = s.heights();
  ASSERT_NE(of_a, bare);

  const std::size_t b = s.join(Rights::kOperate, GetParam(), second);
  s.steps(200);
  EXPECT_EQ(s.undo(b), UndoAnswer::kRefused) << "who observes takes nothing back";
  EXPECT_EQ(s.heights(), of_a);
  s.hand_over(a, b);
  // Before its hand has gone down: all that is there is another's.
  EXPECT_EQ(s.undo(b), UndoAnswer::kAnothers);
  EXPECT_EQ(s.heights(), of_a);
  s.steps(4000);  // first across from where it has taken the tip, then the groove
  const auto of_both = s.heights();
  ASSERT_NE(of_both, of_a) << "the second groove";
  EXPECT_EQ(s.undo(a), UndoAnswer::kRefused) << "who handed over observes";
  EXPECT_EQ(s.undo(b), UndoAnswer::kDone);
  EXPECT_EQ(s.heights(), of_a);
  EXPECT_EQ(s.undo(b), UndoAnswer::kAnothers) << "and no more than its own";
  EXPECT_EQ(s.heights(), of_a);

  s.hand_over(b, a);
  EXPECT_EQ(s.undo(a), UndoAnswer::kDone) << "its own, of an earlier holding";
  EXPECT_EQ(s.heights(), bare);
  EXPECT_EQ(s.undo(a), UndoAnswer::kRefused) << "there is none left";
  EXPECT_EQ(s.undone(), 2u);
  if (GetParam() != Method::kTwin) return;
  const station::TwinRun& twin = *s.all[a]->station().twin();
  EXPECT_TRUE(twin.state() == station::TwinState::kBehind || twin.state() == station::TwinState::kConfirmed)
      << station::twin_state_name(twin.state());
}

// A groove that one begins and another goes on with, without parting: two strokes, each of who made it.
TEST_P(SharedUndo, WhoTakesTheTipInContactMakesAStrokeOfItsOwn) {
  Shared s;
  const Script down{{0, {0, 0, s.z0()}}, {0.7, {0, 0, -10}}, {1.7, {10, 0, -10}}, {60, {10, 0, -10}}};
  // From where it takes the tip up: deeper, along, up.
  const Script on{{0, {0, 0, -10}},
                  {0.6, {0, 0, -15}},
                  {1.6, {10, 0, -15}},
                  {2.6, {10, 0, s.z0()}},
                  {60, {10, 0, s.z0()}}};
  const std::size_t a = s.join(Rights::kOperate, GetParam(), down);
  s.steps(2600);
  ASSERT_EQ(s.contact(), ContactState::kContact);
  const std::size_t b = s.join(Rights::kOperate, GetParam(), on);
  s.steps(200);
  const auto of_a = s.heights();
  s.hand_over(a, b);
  s.steps(6000);
  ASSERT_LE(s.contact(), ContactState::kVanDerWaals) << "off the sample";
  ASSERT_NE(s.heights(), of_a);
  EXPECT_EQ(s.undo(b), UndoAnswer::kDone);
  const auto after = s.heights();
  double off = 0;
  for (std::size_t i = 0; i < after.size(); ++i) off = std::max(off, std::abs(after[i] - of_a[i]));
  EXPECT_EQ(off, 0) << "nm: what the first had made is as it was when the tip changed hands";
  EXPECT_EQ(s.undo(b), UndoAnswer::kAnothers);
}

TEST_P(SharedUndo, WhoAdministersTakesBackWhoeverMarkedLast) {
  Shared s;
  Script first;
  groove(first, 0, s.z0(), 0, 0);
  first.push_back({60, {10, 0, s.z0()}});
  const std::size_t a = s.join(Rights::kOperate, GetParam(), first);
  const auto bare = s.heights();
  s.steps(2600);
  ASSERT_NE(s.heights(), bare);
  const std::size_t c = s.join(Rights::kAdminister, GetParam(), {{0, {0, 0, s.z0()}}, {60, {0, 0, s.z0()}}});
  s.steps(200);
  EXPECT_EQ(s.undo(c), UndoAnswer::kRefused) << "without the tip nobody takes back";
  s.hand_over(a, c);
  EXPECT_EQ(s.undo(c), UndoAnswer::kDone);
  EXPECT_EQ(s.heights(), bare);
}

INSTANTIATE_TEST_SUITE_P(Methods, SharedUndo, ::testing::Values(Method::kKsClamp, Method::kTwin),
                         [](const auto& method) {
                           return std::string(method.param == Method::kTwin ? "twin" : "ks_clamp");
                         });

// Who looks on has the sample as it now is within a second, for the window and for the recording.
TEST(SharedUndoSeen, WhoOnlyObservesSeesTheSampleWithoutTheStroke) {
  Shared s;
  Script first;
  groove(first, 0, s.z0(), 0, 0);
  first.push_back({60, {10, 0, s.z0()}});
  const std::size_t a = s.join(Rights::kOperate, Method::kTwin, first);
  const std::size_t b = s.join(Rights::kObserve, Method::kTwin, {{0, {0, 0, 0}}, {60, {0, 0, 0}}});
  const auto bare = s.heights();
  s.steps(3600);
  const auto lowest = [&] {
    const surface::HeightView* const seen = s.all[b]->station().twin()->heights();
    if (seen == nullptr) return 1e9;
    const std::vector<double> z = seen->heights().z_nm;
    return *std::min_element(z.begin(), z.end());
  };
  ASSERT_LT(lowest(), -1) << "nm: the groove";
  EXPECT_EQ(s.undo(a), UndoAnswer::kDone);
  ASSERT_EQ(s.heights(), bare);
  int ms = 150;
  while (lowest() < -0.01 && ms < 3000) {
    s.steps(10);
    ms += 10;
  }
  EXPECT_LE(ms, 1000);
  std::printf("seen by who observes %d ms after the wish\n", ms);
}

}  // namespace
}  // namespace telenano::support

// The last stroke of marks taken back. Oracles: a slave that never made the stroke, the surface as it was copied before
// it, and the sums of the account, which may never give more than they have been given.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "telenano/nve_server/physics/surface/stroke_history.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"

namespace telenano::slave {
namespace {

std::shared_ptr<const scene::Scene> lithography() {
  static const auto scene =
      scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/lithography.toml");
  return scene;
}

struct Led {
  Led() : slave(lithography()) { go(slave.limits().start_pos_w_nm); }
  void go(const Vec3& target) {
    SlaveInput input;
    input.tip_target_pos_w_nm = end = target;
    slave.step(input, 1e-3, output);
  }
  void lead(const Vec3& to, double step_nm = 0.4) {
    const Vec3 from = end;
    const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / step_nm)));
    for (int i = 1; i <= steps; ++i) go(from + (to - from) * (1.0 * i / steps));
  }
  /// From above down to `depth`, `along`, and up again.
  void stroke(const Vec3& at, const Vec3& along, double depth_nm) {
    lead({at.x(), at.y(), kAbove_nm}, 0.9);
    lead({at.x(), at.y(), -depth_nm});
    lead(Vec3(at.x(), at.y(), -depth_nm) + along);
    lead({end.x(), end.y(), kAbove_nm});
  }
  std::vector<double> heights() const { return slave.marked_surface()->heights().z_nm; }
  double given_aj() const { return output.energy_out_aj - output.energy_in_aj; }
  static constexpr double kAbove_nm = 25;
  NveSlave slave;
  SlaveOutput output;
  Vec3 end;
};

TEST(UndoMarks, TheSampleIsAsItWasBeforeTheStrokeToTheBit) {
  Led led, other;
  const auto bare = led.heights();
  for (Led* const both : {&led, &other}) both->stroke({0, 0, 0}, {8, 3, 0}, 6);
  const auto first = led.heights();
  const std::uint64_t fields = led.slave.sample().marks_digest();
  ASSERT_NE(first, bare);
  led.stroke({4, 2, 0}, {-6, 5, 0}, 9);
  ASSERT_NE(led.heights(), first);
  EXPECT_EQ(led.slave.undo_marks(0, led.output), UndoResult::kDone);
  EXPECT_EQ(led.heights(), first);
  EXPECT_EQ(led.slave.sample().marks_digest(), fields);
  const auto seen = led.slave.heights()->heights();
  for (std::size_t i = 0; i < first.size(); ++i) ASSERT_EQ(seen.z_nm[i], static_cast<float>(first[i])) << i;

  // It is felt as by who never made it: what is left is the balance's own tolerance.
  for (Led* const both : {&led, &other}) both->lead({2, 1, Led::kAbove_nm}, 0.9);
  for (int i = 0; i < 100; ++i) {
    for (Led* const both : {&led, &other}) both->go({2, 1, Led::kAbove_nm - 0.45 * i});
    ASSERT_NEAR(led.output.force_w_nn.z(), other.output.force_w_nn.z(), 1e-6) << i;
  }
  for (Led* const both : {&led, &other}) both->lead({2, 1, Led::kAbove_nm});
  EXPECT_EQ(led.slave.undo_marks(0, led.output), UndoResult::kDone) << "that press was a stroke";
  EXPECT_EQ(led.heights(), first);
  EXPECT_EQ(led.slave.undo_marks(0, led.output), UndoResult::kDone);
  EXPECT_EQ(led.heights(), bare);
  EXPECT_FALSE(led.slave.marked_surface()->marked());
  EXPECT_EQ(led.slave.sample().marks_digest(), 0u);
  EXPECT_EQ(led.slave.undo_marks(0, led.output), UndoResult::kNothing);
}

TEST(UndoMarks, RefusedWhileTheTipTouchesOrWouldWhereTheGroundComesUp) {
  Led led;
  led.stroke({0, 0, 0}, {0, 0, 0}, 30);
  const double depth = -led.slave.marked_surface()->height_nm(0, 0);
  ASSERT_GT(depth, 8);
  led.lead({0, 0, -5});
  while (led.output.contact_state == link::ContactState::kContact) led.go(led.end + Vec3(0, 0, 0.2));
  ASSERT_LT(led.output.tip_pos_w_nm.z(), -1) << "in the dent, off its ground";
  std::uint64_t before = led.slave.state_hash();
  auto heights = led.heights();
  EXPECT_EQ(led.slave.undo_marks(0, led.output), UndoResult::kTouches) << "the ground would come up to it";
  EXPECT_EQ(led.slave.state_hash(), before);
  EXPECT_EQ(led.heights(), heights);
  led.lead({0, 0, -40});
  ASSERT_EQ(led.output.contact_state, link::ContactState::kContact);
  before = led.slave.state_hash();
  heights = led.heights();
  EXPECT_EQ(led.slave.undo_marks(0, led.output), UndoResult::kTouches);
  EXPECT_EQ(led.slave.state_hash(), before);
  EXPECT_EQ(led.heights(), heights);
}

// Marked, lifted, taken back, over and over, hovering as near as is allowed: the tip is never given more than it
// brought and the well of the sample.
TEST(UndoMarks, NobodyIsGivenEnergy) {
  Led led;
  double most = 0;
  const double out_before = led.output.energy_out_aj;
  for (int round = 0; round < 12; ++round) {
    led.lead({0, 0, -8});
    led.lead({0, 0, 4.0 + round});
    const double out = led.output.energy_out_aj, in = led.output.energy_in_aj;
    if (led.slave.undo_marks(0, led.output) == UndoResult::kDone) {
      EXPECT_EQ(led.output.energy_out_aj, out);
      EXPECT_GE(led.output.energy_in_aj, in);
    }
    most = std::max(most, led.given_aj());
    led.lead({0, 0, 30});
    most = std::max(most, led.given_aj());
    // All that is stored was paid for.
    EXPECT_GE(-led.given_aj(), led.slave.stored_aj() - 1e-9);
  }
  EXPECT_GT(led.output.energy_out_aj, out_before);
  EXPECT_LE(most, led.slave.limits().well_aj);
}

TEST(UndoMarks, AllocatesNothing) {
  Led led;
  led.stroke({0, 0, 0}, {8, 0, 0}, 6);
  const support::AllocGuard guard;
  EXPECT_EQ(led.slave.undo_marks(0, led.output), UndoResult::kDone);
  EXPECT_EQ(guard.allocations(), 0u);
}

TEST(UndoMarks, AStateThatWasTakenUpHasNoStrokesToTakeBack) {
  Led led, other;
  led.stroke({0, 0, 0}, {8, 0, 0}, 6);
  std::vector<std::uint8_t> bytes(led.slave.snapshot_bytes_max());
  bytes.resize(led.slave.save(bytes));
  ASSERT_TRUE(other.slave.load(bytes));
  EXPECT_EQ(other.slave.undo_marks(0, other.output), UndoResult::kNothing);
  EXPECT_EQ(other.heights(), led.heights());
}

TEST(StrokeHistory, ForgetsTheOldestWholeStrokesAndOneThatIsTooLarge) {
  physics::StrokeHistory history({1000});
  const auto put = [&](std::size_t tile, double value) {
    if (double* const to = history.keep(0, tile)) *to = value;
  };
  const auto last = [&] {
    std::vector<double> values;
    history.each_of_last([&](std::size_t, std::size_t, const double* v) { values.push_back(*v); });
    return values;
  };
  EXPECT_EQ(history.keep(0, 3), nullptr) << "no stroke has begun";
  for (int stroke = 0; stroke < 3; ++stroke) {
    history.begin(stroke > 0);
    for (std::size_t tile = 0; tile < 150; ++tile) put(tile, stroke);
    put(7, 99);  // of a tile that is kept already
  }
  EXPECT_EQ(last(), std::vector<double>(150, 2));
  EXPECT_TRUE(history.marked_before());
  history.drop_last();
  EXPECT_EQ(last(), std::vector<double>(150, 1));
  history.drop_last();
  EXPECT_TRUE(history.empty()) << "the first had to go for the third";
  history.begin(false);
  for (std::size_t tile = 0; tile < 1000; ++tile) put(tile, 5);
  EXPECT_TRUE(history.empty()) << "larger than there is room for";
  history.begin(true);
  put(1, 6);
  EXPECT_EQ(last(), std::vector<double>(1, 6));
}

}  // namespace
}  // namespace telenano::slave

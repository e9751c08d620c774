#include "telenano/master/device/hid/puck_reports.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/master/device/hid/hid_products.h"
#include "tests/support/puck_bytes.h"

namespace telenano::device {
namespace {

using Axes = std::array<std::int16_t, 6>;

TEST(PuckReports, SplitForm) {
  PuckState state;
  EXPECT_EQ(parse_puck_report(support::kSplitRight, state), PuckReport::kTranslation);
  EXPECT_EQ(state.axes, (Axes{350, 0, 0, 0, 0, 0}));
  EXPECT_EQ(parse_puck_report(support::kSplitTurned, state), PuckReport::kRotation);
  EXPECT_EQ(state.axes, (Axes{350, 0, 0, 10, -10, 300}));
  EXPECT_EQ(parse_puck_report(support::kSplitForwards, state), PuckReport::kTranslation);
  EXPECT_EQ(state.axes, (Axes{0, -350, 0, 10, -10, 300}));
}

TEST(PuckReports, CombinedForm) {
  PuckState state;
  EXPECT_EQ(parse_puck_report(support::kCombined, state), PuckReport::kMotion);
  EXPECT_EQ(state.axes, (Axes{350, -350, -175, 10, -10, 300}));
  EXPECT_EQ(parse_puck_report(support::kCombinedRest, state), PuckReport::kMotion);
  EXPECT_EQ(state.axes, Axes{});
}

TEST(PuckReports, Buttons) {
  PuckState state;
  EXPECT_EQ(parse_puck_report(support::kBothPressed, state), PuckReport::kButtons);
  EXPECT_EQ(state.buttons, 3u);
  EXPECT_EQ(parse_puck_report(support::kManyButtons, state), PuckReport::kButtons);
  EXPECT_EQ(state.buttons, 1u | 1u << 12 | 1u << 26);
  EXPECT_EQ(parse_puck_report(support::kNonePressed, state), PuckReport::kButtons);
  EXPECT_EQ(state.buttons, 0u);
}

TEST(PuckReports, WhatIsNotKnownChangesNothing) {
  PuckState state;
  parse_puck_report(support::kCombined, state);
  parse_puck_report(support::kManyButtons, state);
  const PuckState before = state;
  EXPECT_EQ(parse_puck_report(support::kBattery, state), PuckReport::kUnknown);
  EXPECT_EQ(parse_puck_report({}, state), PuckReport::kUnknown);
  EXPECT_EQ(state.axes, before.axes);
  EXPECT_EQ(state.buttons, before.buttons);
}

/// Every id with every length, of random bytes: known exactly where the formats say so; what a report of the
/// one kind says touches nothing of the other; axes are the bytes, by another arithmetic than the parser's.
TEST(PuckReports, EveryIdAndLength) {
  Random random(3);
  const std::set<std::pair<int, std::size_t>> known = {{1, 7}, {2, 7}, {1, 13}, {3, 3}, {3, 7}};
  for (int id = 0; id < 256; ++id) {
    for (std::size_t size = 1; size <= 70; ++size) {
      std::vector<std::uint8_t> report(size);
      for (auto& byte : report) byte = static_cast<std::uint8_t>(random.bits());
      report[0] = static_cast<std::uint8_t>(id);
      PuckState state;
      for (auto& axis : state.axes) axis = static_cast<std::int16_t>(random.bits());
      state.buttons = static_cast<std::uint32_t>(random.bits());
      const PuckState before = state;
      const PuckReport kind = parse_puck_report(report, state);
      EXPECT_EQ(kind != PuckReport::kUnknown, known.contains({id, size})) << id << " " << size;
      if (kind != PuckReport::kButtons) {
        EXPECT_EQ(state.buttons, before.buttons);
      }
      std::size_t first = 6;
      std::size_t last = 6;
      if (kind == PuckReport::kTranslation) first = 0, last = 3;
      if (kind == PuckReport::kRotation) first = 3;
      if (kind == PuckReport::kMotion) first = 0;
      for (std::size_t i = 0; i < 6; ++i) {
        if (i < first || i >= last) {
          EXPECT_EQ(state.axes[i], before.axes[i]);
          continue;
        }
        const std::size_t at = 1 + 2 * (i - first);
        const int high = report[at + 1] >= 128 ? report[at + 1] - 256 : report[at + 1];
        EXPECT_EQ(int{state.axes[i]}, high * 256 + report[at]);
      }
    }
  }
}

TEST(PuckProducts, FamilyOnly) {
  for (const int product : {0xc623, 0xc625, 0xc626, 0xc627, 0xc628, 0xc629, 0xc62b})
    EXPECT_TRUE(is_puck(0x046d, static_cast<std::uint16_t>(product), 0, 0));
  for (const int product : {0xc635, 0xc62e, 0xc63a, 0xc632, 0xc638, 0xc633, 0xc652})
    EXPECT_TRUE(is_puck(0x256f, static_cast<std::uint16_t>(product), 0, 0));
  EXPECT_TRUE(is_puck(0x256f, 0xc6ff, 1, 8)) << "a new one that says what it is";
  EXPECT_FALSE(is_puck(0x046d, 0xc077, 1, 2)) << "an ordinary mouse";
  EXPECT_FALSE(is_puck(0x046d, 0xc077, 0, 0));
  EXPECT_FALSE(is_puck(0x256f, 0xc652, 1, 6)) << "a receiver's keyboard interface";
  EXPECT_FALSE(is_puck(0x1234, 0xc652, 1, 8)) << "a joystick";
}

}  // namespace
}  // namespace telenano::device

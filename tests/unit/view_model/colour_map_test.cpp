#include "telenano/master/view_model/colour_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace telenano::view_model {
namespace {

// CIE lightness from sRGB by the definitions of IEC 61966-2-1 and CIE 1976: another colour space than the one
// that the map is made in.
double cie_lightness(const Rgb& c) {
  const auto linear = [](double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); };
  const double y = 0.2126 * linear(c.r) + 0.7152 * linear(c.g) + 0.0722 * linear(c.b);
  return y > 216.0 / 24389 ? 116 * std::cbrt(y) - 16 : y * 24389.0 / 27;
}

TEST(ColourMap, GetsLighterAllTheWayUp) {
  double before = cie_lightness(height_colour(0));
  for (int i = 1; i <= 200; ++i) {
    const double now = cie_lightness(height_colour(i / 200.0));
    EXPECT_GT(now, before) << i;
    before = now;
  }
  EXPECT_LT(cie_lightness(height_colour(0)), 25);
  EXPECT_GT(cie_lightness(height_colour(1)), 90);
}

// Even steps of height look about even: no step of lightness is more than twice the mean one.
TEST(ColourMap, HasNoFalseEdge) {
  const double mean = (cie_lightness(height_colour(1)) - cie_lightness(height_colour(0))) / 50;
  for (int i = 0; i < 50; ++i) {
    const double step = cie_lightness(height_colour((i + 1) / 50.0)) - cie_lightness(height_colour(i / 50.0));
    EXPECT_LT(step, 2 * mean) << i;
  }
}

TEST(ColourMap, OklabAndBackIsTheSameColour) {
  for (const Rgb c : {Rgb{0, 0, 0}, Rgb{1, 1, 1}, Rgb{1, 0, 0}, Rgb{0.2f, 0.5f, 0.9f}}) {
    const Rgb again = to_srgb(to_oklab(c));
    EXPECT_NEAR(again.r, c.r, 1e-4);  // the published matrices have ten digits, floats seven
    EXPECT_NEAR(again.g, c.g, 1e-4);
    EXPECT_NEAR(again.b, c.b, 1e-4);
  }
  // Published by its author: white has lightness 1 and no colour.
  EXPECT_NEAR(to_oklab({1, 1, 1}).lightness, 1, 1e-4);
  EXPECT_NEAR(to_oklab({1, 1, 1}).a, 0, 1e-4);
  EXPECT_NEAR(to_oklab({1, 1, 1}).b, 0, 1e-4);
}

TEST(ColourMap, WhatIsNoHeightIsGreyAndWhatIsOutsideIsTheEnd) {
  const Rgb none = height_colour(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(none.r, none.g);
  EXPECT_EQ(none.g, none.b);
  EXPECT_EQ(height_colour(-5).b, height_colour(0).b);
  EXPECT_EQ(height_colour(7).r, height_colour(1).r);
}

}  // namespace
}  // namespace telenano::view_model

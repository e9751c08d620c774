#include "telenano/nve_server/fit/parameter_map.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>

namespace telenano::fit {
namespace {

/// The format's own rule, written down apart: text, 1 to 4 zeros up to a multiple of four bytes, float32.
float pixel(const std::string& bytes, std::size_t number) {
  const std::size_t text = bytes.find('\0');
  const std::size_t first = (text / 4 + 1) * 4;
  std::uint32_t bits = 0;
  for (int i = 3; i >= 0; --i)
    bits = bits << 8 | static_cast<unsigned char>(bytes.at(first + 4 * number + static_cast<std::size_t>(i)));
  return std::bit_cast<float>(bits);
}

TEST(ParameterMap, IsAFieldThatBeginsAtTheTop) {
  std::size_t filled = 99;
  const std::string bytes = format_map({3, 2, 600, 400, "Young's modulus", "Pa", {1, 2, 3, 4, 5, 6}}, filled);
  EXPECT_EQ(filled, 0u);
  EXPECT_EQ(bytes.rfind("Gwyddion Simple Field 1.0\nXRes = 3\nYRes = 2\nXReal = 6e-07\nYReal = 4e-07\n", 0),
            0u);
  EXPECT_NE(bytes.find("ZUnits = Pa\n"), std::string::npos);
  EXPECT_EQ(bytes.size() % 4, 0u);
  const float expected[] = {4, 5, 6, 1, 2, 3};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(pixel(bytes, i), expected[i]) << i;
}

TEST(ParameterMap, APlaceWithoutANumberHasTheMedian) {
  std::size_t filled = 0;
  const std::string bytes = format_map({2, 2, 1, 1, "w", "J/m2", {1, std::nan(""), 3, 8}}, filled);
  EXPECT_EQ(filled, 1u);
  EXPECT_EQ(pixel(bytes, 3), 3.0f);  // the lower right
}

}  // namespace
}  // namespace telenano::fit

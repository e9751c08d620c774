#include "telenano/master/view_model/colour_map.h"

#include <algorithm>
#include <cmath>

namespace telenano::view_model {
namespace {

// The sRGB transfer function (IEC 61966-2-1).
double encode(double linear) noexcept {
  if (linear <= 0.0031308) return 12.92 * std::max(linear, 0.0);
  return 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}
double decode(double encoded) noexcept {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

struct Tint {
  double height;
  double a;
  double b;
};
// Hue and chroma on the way up; the lightness between is a straight line of its own.
constexpr std::array<Tint, 6> kTints = {{{0.0, 0.010, -0.115},
                                         {0.2, -0.030, -0.090},
                                         {0.4, -0.065, -0.020},
                                         {0.6, -0.040, 0.060},
                                         {0.8, 0.020, 0.085},
                                         {1.0, 0.005, 0.040}}};
constexpr double kDarkest = 0.30;
constexpr double kLightest = 0.95;

}  // namespace

Rgb to_srgb(const Oklab& c) noexcept {
  const double l = std::pow(c.lightness + 0.3963377774 * c.a + 0.2158037573 * c.b, 3);
  const double m = std::pow(c.lightness - 0.1055613458 * c.a - 0.0638541728 * c.b, 3);
  const double s = std::pow(c.lightness - 0.0894841775 * c.a - 1.2914855480 * c.b, 3);
  const auto channel = [](double linear) { return static_cast<float>(std::clamp(encode(linear), 0.0, 1.0)); };
  return {channel(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
          channel(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
          channel(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s)};
}

Oklab to_oklab(const Rgb& colour) noexcept {
  const double r = decode(colour.r);
  const double g = decode(colour.g);
  const double b = decode(colour.b);
  const double l = std::cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const double m = std::cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const double s = std::cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return {0.2104542553 * l + 0.7936177850 * m - 0.0040720468 * s,
          1.9779984951 * l - 2.4285922050 * m + 0.4505937099 * s,
          0.0259040371 * l + 0.7827717662 * m - 0.8086757660 * s};
}

Rgb height_colour(double height) noexcept {
  if (std::isnan(height)) return {0.5f, 0.5f, 0.5f};
  const double t = std::clamp(height, 0.0, 1.0);
  std::size_t i = 1;
  while (i + 1 < kTints.size() && t > kTints[i].height) ++i;
  const Tint& low = kTints[i - 1];
  const Tint& high = kTints[i];
  const double u = (t - low.height) / (high.height - low.height);
  return to_srgb(
      {kDarkest + (kLightest - kDarkest) * t, low.a + u * (high.a - low.a), low.b + u * (high.b - low.b)});
}

std::array<unsigned char, 3 * kHeightColours> height_colour_table() noexcept {
  std::array<unsigned char, 3 * kHeightColours> table{};
  for (int i = 0; i < kHeightColours; ++i) {
    const Rgb c = height_colour((i + 0.5) / kHeightColours);
    const auto byte = [](float v) { return static_cast<unsigned char>(std::lround(255 * v)); };
    const auto at = static_cast<std::size_t>(3 * i);
    table[at] = byte(c.r);
    table[at + 1] = byte(c.g);
    table[at + 2] = byte(c.b);
  }
  return table;
}

}  // namespace telenano::view_model

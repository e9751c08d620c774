#pragma once

#include <array>

namespace telenano::view_model {

/// Display colour, sRGB, 0 … 1.
struct Rgb {
  float r = 0;
  float g = 0;
  float b = 0;
};

/// Perceptual colour space in which a straight line looks even: OKLab, after B. Ottosson, "A perceptual color
/// space for image processing" (2020), with its published matrices.
struct Oklab {
  double lightness = 0;  ///< 0 black … 1 white
  double a = 0;          ///< green − red
  double b = 0;          ///< blue − yellow
};
Rgb to_srgb(const Oklab& colour) noexcept;  ///< out of gamut: clipped a channel
Oklab to_oklab(const Rgb& colour) noexcept;

/// Colour of a height, 0 lowest … 1 highest (others are clamped, no number is grey): deep blue over teal and
/// sand to cream. Lightness rises along a straight line from 0.30 to 0.95, so that it reads in grey and for
/// every kind of colour vision; hue only helps.
Rgb height_colour(double height) noexcept;

inline constexpr int kHeightColours = 256;
/// height_colour() at the middles of equal steps, as 8-bit RGB, for a texture.
std::array<unsigned char, 3 * kHeightColours> height_colour_table() noexcept;

}  // namespace telenano::view_model

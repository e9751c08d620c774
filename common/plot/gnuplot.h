#pragma once

#include <string>

/// What every figure of the project has in common, and the program that draws it.
namespace telenano::plot {

// Okabe and Ito's colours: told apart by everybody, also in grey.
inline constexpr const char* kBlue = "#0072B2";
inline constexpr const char* kRed = "#D55E00";
inline constexpr const char* kGreen = "#009E73";
inline constexpr const char* kInk = "#222222";
inline constexpr const char* kPurple = "#AA4488";
inline constexpr const char* kPale = "#9BB8CC";
inline constexpr const char* kGrey = "#B5B5B5";

/// Fonts, grid, axes: gnuplot commands to follow the terminal's.
std::string common_style();

/// A text inside gnuplot's single quotes.
std::string quoted(const std::string& text);

/// Can figures be drawn here?
bool has_gnuplot();

/// Checks, before anything is computed for it, that a figure can be drawn into `file` (.svg or .png): throws
/// UserError for another name or a place that cannot be written, RunError without gnuplot. `flag` is what the
/// person gave it with.
void require_drawable(const std::string& file, const std::string& flag);

/// Draws `script`, which sets neither terminal nor output, into `file` (.svg or .png). Throws RunError.
void draw(const std::string& file, int width, int height, const std::string& script);

}  // namespace telenano::plot

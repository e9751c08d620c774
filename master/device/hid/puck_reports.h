#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace telenano::device {

/// What the reports of a SpaceMouse have said so far.
struct PuckState {
  std::array<std::int16_t, 6> axes{};  ///< x y z rx ry rz, about ±350 at the stops
  std::uint32_t buttons = 0;           ///< bit i: button i is pressed
};

enum class PuckReport : std::uint8_t { kUnknown, kTranslation, kRotation, kMotion, kButtons };

/// Pure parser of one report of the SpaceMouse family, the report's id in byte 0. Axes are little-endian
/// 16-bit two's complement.
///
///   id 1,  7 bytes   x y z                 (older, wired: a report each for ...
///   id 2,  7 bytes   rx ry rz               ... translation and rotation)
///   id 1, 13 bytes   x y z rx ry rz        (newer, wireless)
///   id 3,  3 or 7 bytes   mask of the buttons pressed
///
/// Decided by id and length, never by the product: one receiver stands for many products. Anything else
/// (battery levels, other interfaces, noise) is kUnknown and changes nothing.
PuckReport parse_puck_report(std::span<const std::uint8_t> report, PuckState& state) noexcept;

}  // namespace telenano::device

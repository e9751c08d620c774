#pragma once

#include <cstdint>
#include <type_traits>

namespace telenano::recording {

/// One word of how the sample changed under the tip, in the order in which it did: first where its nodes are
/// (kPlace rows, one for each MarkPlace, which begin all anew), then each node that has another height. Before
/// them the sample is the scene's own.
struct MarkRow {
  static constexpr std::uint32_t kPlace = UINT32_MAX;  ///< `column` of a row that says where nodes are

  double time_s = 0;         ///< of the newest sample when it was seen: up to some tenths late
  std::uint32_t column = 0;  ///< of the node, along x; or kPlace
  std::uint32_t row = 0;     ///< along y; or a MarkPlace
  double value = 0;          ///< height, frame W, nm; or the place's
};

/// kFlat comes last: height of the nodes where the scene itself has no heights at these places (a plane).
enum class MarkPlace : std::uint32_t { kColumns, kRows, kDx, kDy, kXFirst, kYFirst, kFlat };
inline constexpr std::uint32_t kMarkPlaces = 7;

static_assert(std::is_trivially_copyable_v<MarkRow> && sizeof(MarkRow) == 24);

}  // namespace telenano::recording

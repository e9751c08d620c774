#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace telenano::fit {

/// No curve has more points; what claims more is refused before memory is taken for it.
inline constexpr std::size_t kPointsMax = 1'000'000;

enum class DeflectionUnit { kNanometre, kVolt, kNanonewton };

/// One way of a force curve, in the order in which it was measured.
struct RawSegment {
  std::vector<double> z_nm;        ///< of the lever's base or the piezo, up or down as the file has it
  std::vector<double> deflection;  ///< in the curve's unit; as many
};

/// A force curve as a file has it: finite numbers, at least kPointsMin a segment, unless `error` says why not.
struct RawCurve {
  RawSegment approach;
  RawSegment retract;
  DeflectionUnit unit = DeflectionUnit::kNanometre;
  std::optional<double> stiffness_n_m;  ///< of the lever, where the file says it
  std::string stiffness_unread;         ///< what the file says of it, where that cannot be read
  std::optional<double> invols_nm_v;    ///< where the file says it
  std::string what;                     ///< for a person: format and channels
  std::string error;                    ///< not empty: what is wrong, one line without the file's name
};

inline constexpr std::size_t kPointsMin = 20;

}  // namespace telenano::fit

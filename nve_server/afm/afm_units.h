#pragma once

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>

/// What the parts of AfmLogic share.
namespace telenano::afm {

inline constexpr std::int64_t kMs = 1'000'000;  ///< ns
inline constexpr std::int64_t kLookPeriodNs =
    20 * kMs;  ///< between two looks at an engaged or withdrawing tip

// "Up" is a place: where the tip stood withdrawn at the start, or further from the sample. A withdrawn tip
// that reports less height by up to this part of the range along Z, and a nanometre, is still there.
inline constexpr double kUpPart = 0.01;
inline constexpr double kUpSlack_nm = 1;
inline constexpr std::int64_t kSayNotUpNs = 10'000 * kMs;  ///< between two lines that say that it is not up

inline std::int64_t ns(double seconds) {
  return static_cast<std::int64_t>(std::llround(seconds * 1e9));
}

/// printf into a string; what is longer than a line is cut.
template <class... Values>
std::string text(const char* format, Values... values) {
  char line[256];
  std::snprintf(line, sizeof line, format, values...);
  return line;
}

}  // namespace telenano::afm

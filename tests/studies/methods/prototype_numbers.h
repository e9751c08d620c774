#pragma once

#include <array>
#include <string_view>

#include "telenano/common/control/method.h"

namespace telenano::studies {

/// What a prototype of this architecture showed of a wall of 1000 N/m (b = 2 N s/m, T = 1 ms, firm hand,
/// ideal channel), N/m: the numbers that this system was set to beat. Not measured by this program.
struct PrototypeNumbers {
  double rtt_ms = 0;
  std::string_view none;   ///< raw
  std::string_view wave;   ///< b_w = b
  std::string_view tdpa;   ///< reactive two-port
  std::string_view tank;   ///< two-layer with clamp
  std::string_view model;  ///< local model
};

inline constexpr std::array<PrototypeNumbers, 5> kPrototype{{
    {10, "1313, active", "182", "520", "1000", "949"},
    {20, "1578, active", "125", "6", "490", "911"},
    {50, "limit cycle, ~50 N", "65", "0", "749", "832"},
    {100, "limit cycle, ~50 N", "36", "0", "167", "761"},
    {200, "diverges", "19", "0", "28", "699"},
}};

/// The most that an adversarial hand took from the prototype at a round trip of 100 ms.
struct PrototypeExtraction {
  control::Method method;
  std::string_view energy;
};
inline constexpr std::array<PrototypeExtraction, 5> kPrototypeExtraction{{
    {control::Method::kNone, "24 J"},
    {control::Method::kWave, "0"},
    {control::Method::kTdpa, "6 J"},
    {control::Method::kTank, "18 mJ (allowance 20 mJ)"},
    {control::Method::kModel, "0"},
}};

}  // namespace telenano::studies

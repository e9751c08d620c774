#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "telenano/common/base/random.h"

/// For tests of what a live change of scale grants.
namespace telenano::support {

/// When the operator moves the sliders of the two scales, always against each other: the impedance α_v α_F,
/// which the planner watches, stays. A joule at the tip is worth 25 times as much at 5 as at 1.
enum class Sliders {
  kNever,
  kPressLow,   ///< α_v/5, α_F·5 for the way out
  kPressHigh,  ///< the other way round
  kOnTheWay,   ///< in the middle of each press, back in the middle of each withdrawal
  kEachTick,   ///< to and fro with every tick
  kSpite,      ///< with every tick so that what the hand takes is worth most, and what it gives least
  kWalk        ///< a random walk over a range of 625 for the energy
};
inline const char* name_of(Sliders sliders) {
  constexpr const char* kNames[] = {
      "never", "low in, high out", "high in, low out", "on the way", "each tick", "spite", "walk"};
  return kNames[static_cast<int>(sliders)];
}

/// What the operator does at a tick.
struct SliderView {
  std::int64_t tick = 0;
  bool down = false;   ///< the hand presses, rather than withdraws
  bool deep = false;   ///< beyond the middle of the way
  double force_n = 0;  ///< on the hand, up
  double moved_m = 0;  ///< of the hand since the last tick, up
};

/// The factor that the sliders are at next: `by` where they stay.
inline double next_scale(Sliders sliders, double by, const SliderView& view, Random& random) {
  switch (sliders) {
    case Sliders::kNever:
      return by;
    case Sliders::kPressLow:
      return view.down ? 1 : 5;
    case Sliders::kPressHigh:
      return view.down ? 5 : 1;
    case Sliders::kOnTheWay:
      return view.deep ? 5 : 1;
    case Sliders::kEachTick:
      return view.tick % 2 == 0 ? 1 : 5;
    case Sliders::kSpite:
      return view.force_n * view.moved_m > 0 || !view.down ? 5 : 0.2;
    case Sliders::kWalk:
      return view.tick % 250 == 0 ? std::clamp(by * std::exp(random.uniform(-2, 2)), 0.2, 5.0) : by;
  }
  return by;
}

}  // namespace telenano::support

#include "telenano/master/station/station.h"

#include <cstdint>
#include <iterator>

namespace telenano::station {

const char* mode_name(Mode mode) noexcept {
  switch (mode) {
    case Mode::kIdle:
      return "idle";
    case Mode::kReady:
      return "ready";
    case Mode::kEngaged:
      return "engaged";
    case Mode::kHeld:
      return "held";
    case Mode::kStopped:
      return "stopped";
    case Mode::kHoming:
      return "homing";
  }
  return "unknown";
}

const char* fault_name(std::uint32_t faults) noexcept {
  static constexpr const char* kNames[] = {"stop pressed",
                                           "hand faster than the velocity trip",
                                           "hand position not finite or not believable",
                                           "applied force not finite or not believable",
                                           "device failed",
                                           "reply not finite",
                                           "computed force not finite",
                                           "no new reply",
                                           "bad tick length",
                                           "slave stiffer than planned",
                                           "another scene than before",
                                           "round trip too long for the method",
                                           "stiffness was the twin's alone"};
  for (std::size_t bit = 0; bit < std::size(kNames); ++bit) {
    if (faults & (1u << bit)) return kNames[bit];
  }
  return "none";
}

}  // namespace telenano::station

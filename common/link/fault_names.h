#pragma once

#include <array>
#include <cstddef>

#include "common/link/messages.h"

namespace telenano::link {

/// FaultBits in words, the lowest bit first.
inline constexpr std::array<const char*, 7> kFaultNames = {
    "force limit", "border of the workspace", "value not finite", "retracted", "no equilibrium", "too fast",
    "approaching"};
static_assert(kFaultApproaching == 1u << (kFaultNames.size() - 1));

}  // namespace telenano::link

#pragma once

#include <array>
#include <cstddef>

#include "telenano/common/link/messages.h"

namespace telenano::link {

/// FaultBits in words, the lowest bit first.
inline constexpr std::array<const char*, 10> kFaultNames = {
    "force limit",          "border of the workspace",
    "value not finite",     "retracted",
    "no equilibrium",       "too fast",
    "approaching",          "share of the server used up",
    "marks not taken back", "the last marks are another's"};
static_assert(kFaultUndoAnothers == 1u << (kFaultNames.size() - 1));

}  // namespace telenano::link

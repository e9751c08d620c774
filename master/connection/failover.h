#pragma once

#include <cstdint>

#include "telenano/common/link/client_session.h"

namespace telenano::connection {

/// Why a station goes on to the next server of its list.
enum class LeaveCause : std::uint8_t { kNone, kShutDown, kNobodyListens, kSilent, kRefused };

const char* text(LeaveCause cause) noexcept;

/// A server that says nothing may come back, and has kept the session: its tip, its sample, its account. So long
/// one waits for it; a link that fails for a moment must not cost them.
inline constexpr std::int64_t kLeavePatienceNs = 1'500'000'000;
/// One that has answered with a challenge is there, and may be looking for the session: who left meanwhile would lose it.
inline constexpr std::int64_t kSearchPatienceNs = 3'000'000'000;
/// So long at least each server has to answer, whatever the network says: that may be of an earlier attempt.
inline constexpr std::int64_t kLeaveLeastNs = 200'000'000;

/// Must the session's next attempt go to another server? Pure; ask in every tick.
LeaveCause leaves(const link::ClientSession& session, bool nobody_listens, std::int64_t now_ns) noexcept;

}  // namespace telenano::connection

#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "telenano/common/link/drop_cause.h"
#include "telenano/nve_server/server/server.h"

namespace telenano::server {

/// A session as a monitor sees it.
struct SessionRow {
  std::uint32_t slot = 0;
  std::uint32_t rate_hz = 0;
  std::uint64_t commands = 0;  ///< accepted, of this session id, as the next three
  std::uint64_t lost = 0;
  std::uint64_t reordered = 0;
  std::uint64_t duplicates = 0;
  double rtt_s = 0;  ///< smoothed, the station's tick in it
  double jitter_s = 0;
  double silent_s = 0;  ///< since the last command
};

/// The server at one moment, for other threads: copied off the loop a few times a second.
struct ServerSnapshot {
  ServerCounters counters;
  std::array<std::uint64_t, link::kDropCauseCount> drops{};
  ServiceTimes service;
  std::uint32_t active = 0;
  std::uint32_t occupied = 0;
  std::uint32_t rows = 0;  ///< of `session`: the active ones
  std::array<SessionRow, 256> session{};
};

/// Fills `out`, without allocating.
inline void take_snapshot(const Server& server, std::int64_t now_ns, ServerSnapshot& out) noexcept {
  out.counters = server.counters();
  for (std::size_t i = 0; i < out.drops.size(); ++i)
    out.drops[i] = server.drops()[static_cast<link::DropCause>(i)];
  out.service = server.service_times();
  const link::SessionTable& table = server.sessions();
  out.active = static_cast<std::uint32_t>(table.active());
  out.occupied = static_cast<std::uint32_t>(table.occupied());
  out.rows = 0;
  for (std::size_t slot = 0; slot < std::min(table.capacity(), out.session.size()); ++slot) {
    const link::Session& s = table[slot];
    if (s.state != link::SlotState::kActive) continue;
    SessionRow& row = out.session[out.rows++];
    row.slot = static_cast<std::uint32_t>(slot);
    row.rate_hz = s.rate_hz;
    row.commands = s.commands.received() - s.commands.reordered();
    row.lost = s.commands.lost();
    row.reordered = s.commands.reordered();
    row.duplicates = s.commands.duplicate();
    row.rtt_s = 1e-9 * s.peer_stats.rtt_ns();
    row.jitter_s = 1e-9 * s.peer_stats.jitter_ns();
    row.silent_s = 1e-9 * static_cast<double>(now_ns - s.last_heard_ns);
  }
}

}  // namespace telenano::server

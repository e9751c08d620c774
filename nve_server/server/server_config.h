#pragma once

#include <cstddef>
#include <cstdint>

#include "telenano/common/link/messages.h"
#include "telenano/common/link/session_table.h"
#include "telenano/common/link/siphash.h"
#include "telenano/nve_server/server/audit.h"
#include "telenano/nve_server/server/work_budget.h"

namespace telenano::server {

/// private: every session has a slave of its own, with its own state. one-tip: one slave; one session moves
/// it (TipHolder says which), the others observe.
enum class Share : std::uint8_t { kPrivate, kOneTip };

struct ServerConfig {
  link::SipKey secret;  ///< 128 fresh random bits at each start: cookies, session ids, tokens and epochs
                        ///< follow from it
  link::SessionTableConfig table;
  Share share = Share::kPrivate;
  std::uint64_t feature_bits = link::kKnownFeatures;  ///< granted to a station that asks for them
  double challenges_per_s = 20000;
  double openings_per_s = 64;
  /// Of the loop's time, for making the slaves of new sessions; where there is a clock.
  double openings_share = 0.25;
  double openings_per_party_s = 1e9;  ///< of one key, or in the clear of one IP address
  double step_gap_s = 2;  ///< a step may be missing in a log; then it is left out, and the log says so
  /// Of a slave's state, for its station: what is larger cannot be had. With marks a state has 20 bytes for each
  /// node that they have changed; each session that logs its steps has room for one.
  std::size_t snapshot_bytes_most = std::size_t{16} << 20;
  std::size_t steps_at_once = 64;  ///< of a log, by one datagram; what more has come is for catch_up()
  double step_ring_s = 4;  ///< of logged steps that may wait for their turn, in each session that logs
  /// Pieces of the scene that are sent, to one session and to all: beside commands, which they must not
  /// delay. One takes about a microsecond.
  double scene_chunks_per_s = 2000;
  /// Of pieces of a slave's state to one session. A station asks for 2000 at most.
  double snapshot_pieces_per_s = 2500;
  double scene_chunks_all_per_s = 10000;
  WorkBounds work;
  /// A session's commands come at the rate of its Hello: what comes faster in the long run is dropped. Times that
  /// rate, so that no clock's drift matters; 0: not looked at.
  double rate_slack = 0;
  /// Of the loop's time, for the exchanges of all sessions at their rates: a session that would bring them beyond is
  /// refused (LoadEstimate). 0: not looked at.
  double load_most = 0;
  double step_max_s = 0.1;  ///< longest time step given to a slave, whatever the command's times say

  AuditQueue* audit = nullptr;  ///< outlives the server; null: nobody asks
};

}  // namespace telenano::server

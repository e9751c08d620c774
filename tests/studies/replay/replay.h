#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "telenano/nve_server/scene/scene.h"
#include "tests/studies/replay/recorded_session.h"

namespace telenano::studies {

/// How far a replay agrees with its recording.
struct ReplayResult {
  std::int64_t recorded_ticks = 0;
  std::int64_t replayed_ticks = 0;
  std::int64_t equal_ticks = 0;        ///< every column that is compared, bit for bit
  std::int64_t first_difference = -1;  ///< tick; -1: none
  std::string column;                  ///< that differs there
  double recorded = 0, replayed = 0;   ///< its values
  std::int64_t steps = 0;              ///< of the slave
  std::int64_t told_ticks = 0;         ///< in which a reply said what was recorded (see below)
  std::string ended;                   ///< why before the recording's end; empty: it went to the end
  double largest_force_error_n = 0;    ///< at the hand, over all ticks
  bool exact() const { return equal_ticks == replayed_ticks; }
};

/// Runs the whole session again, in virtual time: the same station, session, server and slave objects. The
/// hand is where it was, the device applied what it did; datagrams are lost, late or doubled as they were.
/// Nothing of the slave comes from the recording: its forces are computed anew, and compared.
///
/// With one exception. Where the server declared a break of the log (an outage, a stop, a tip withdrawn by
/// its own clock), nobody knows which steps it made. From then on replies say what the recording says, until
/// the server's state that the twin took up, which the recording holds: the replayed slave goes on from it.
///
/// It goes on to the end of the recording, or to where the recording does not hold what comes next: rows that
/// were not written, a state that was not written, and without a log of steps also a session that was resumed,
/// a slave that withdrew by its own clock, an unknown order of steps (StepOrder).
ReplayResult replay(const RecordedSession& recorded, const std::shared_ptr<const scene::Scene>& scene);

}  // namespace telenano::studies

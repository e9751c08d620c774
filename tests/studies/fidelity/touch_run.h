#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "telenano/common/control/companding.h"
#include "telenano/nve_server/slave/slave.h"
#include "tests/studies/fidelity/felt_metrics.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies::fidelity {

struct TouchRun {
  support::VirtualSessionConfig session{};
  /// Never the server's own object: built again, from the scene's file.
  std::function<std::unique_ptr<slave::Slave>()> make_truth;
  /// True is the log that the server executed, replayed by the slave of make_truth; for methods that log
  /// their steps. Else the path that the station commanded.
  bool by_executed_log = false;
  std::int64_t ticks_max = 60'000;
  control::CompandingConfig companding{};  ///< that the station shows: what is true is companded likewise
  double after_s = 0;  ///< goes on for so long once the task is over: what is on its way arrives
};

struct TouchOutcome {
  TouchTrace trace;
  double clamped_share = 0;       ///< of the ticks of contact: the energy clamp cut the force
  double stopped_s = -1;          ///< of the trace; negative: the station never stopped
  std::uint32_t stop_faults = 0;  ///< why, station::StationFaults
  /// With the executed log: steps in it, and ticks whose own step is not, which are judged by the last that
  /// is.
  std::int64_t unexecuted = 0, executed = 0;
  double left_out_share = 0;  ///< of the replies to accepted commands: not sent, within the deadband
};

/// A session in virtual time with the objects of the programs, beside the truth: the same slave, built
/// independently, stepped without link and delay once a tick along the path that this station commanded, or,
/// of a method that logs its steps, by the steps that the server really executed. Rows begin where the motion
/// does.
TouchOutcome run_touch(const TouchRun& run);

}  // namespace telenano::studies::fidelity

#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/control/station_method.h"
#include "tests/studies/fidelity/felt_metrics.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/scenes.h"

namespace telenano::studies::stress {

/// What came of a run. NaN: does not apply to it.
struct Outcome {
  std::uint32_t violated = 0;  ///< Invariant bits, promised or not
  double violated_s = -1;      ///< the first; −1 none
  double margin_mj = 0;        ///< least, of the energy invariant
  double extracted_mj = 0;     ///< most ever
  double given_mj = 0;         ///< most ever that the port had given, net
  double generated_mj = 0;     ///< most ever that hand and slave had got together
  double quantum_mj = 0;       ///< Q
  double late_mj = 0;          ///< what late ticks may overdraw
  double peak_n = 0;           ///< force on the hand
  double force_step_n = 0;     ///< RMS of its steps from tick to tick
  double force_error_n = 0;  ///< RMS against the same sample felt locally, tasks on ground that is not rough
  double shown_ratio = 0;    ///< shown over local force, least squares, likewise
  double drift_mm = 0;       ///< at the end, of the hand: where the slave stands less where it should; tasks
  double swing_mm = 0;       ///< of the hand in the last quarter of a press, peak to peak
  double tip_nn = 0;         ///< most at the slave
  double over_force = 0;     ///< the same over what the hand would have met locally, tasks
  double duty = 0;           ///< share of touching ticks in which damper or clamp acted
  double recover_s = 0;      ///< longest time to get back after an outage or restart
  double stopped_s = -1;     ///< the station latched a stop; −1 never
  double too_fast_s = -1;    ///< the hand was faster than v_max; −1 never
  std::uint32_t faults = 0;  ///< station::StationFaults of the stop
  std::int64_t clamp_ticks = 0, limit_ticks = 0, stop_ticks = 0;
  std::int64_t sessions = 0;
  std::int64_t refused = 0;      ///< changes of scale that the station refused
  std::int64_t handed_over = 0;  ///< of a shared tip: to another operator or back
  std::int64_t ticks = 0;        ///< all that were computed, of climbs those of every try
  std::uint64_t hash = 0;        ///< of force and position at every tick
  /// Beside the same sample felt locally, where felt_limits() asks for it; not kept in tables.
  fidelity::FeltMetrics felt{};

  /// Went through without a violation of any invariant, promised or not, and without a stop.
  bool survived() const noexcept { return violated == 0 && stopped_s < 0; }
};

/// One tick, for traces.
struct TraceRow {
  double time_s = 0, depth_mm = 0, force_n = 0, extracted_mj = 0, account_mj = 0, slave_mj = 0;
  bool link_down = false;
};

struct RunExtras {
  std::vector<TraceRow>* trace = nullptr;  ///< every tick of it
  std::vector<double>* path_m = nullptr;   ///< the hand's, over the ground
  double* most_extracted_at_s = nullptr;   ///< when the most had been extracted
  /// A method of the caller's own in place of the run's, whose promises it is held to.
  std::function<std::unique_ptr<control::StationMethod>()> make_method{};
};

/// One session in virtual time with the station, session and server objects of the programs. Climbs are
/// carried out: their outcome is the worst path's.
Outcome run(const RunSpec& spec, const Scenes& scenes, const RunExtras& extras = {});

/// The α_F planned for a run at scale 1: 1 % within the smaller of what is passive and what the device can
/// show (the rule of `telenano-master plan`, one tick of delay).
double planned_force_scale(const RunSpec& spec, const slave::SlaveLimits& limits);

}  // namespace telenano::studies::stress

#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/control/method.h"
#include "telenano/common/control/station_method.h"
#include "tests/studies/fidelity/felt_metrics.h"
#include "tests/studies/fidelity/haptic_metrics.h"
#include "tests/studies/fidelity/motions.h"
#include "tests/studies/fidelity/touch_run.h"

namespace telenano::studies::fidelity {

/// Each scene twice: as the server has it, and built again from its file for the truth.
class ScenePairs {
 public:
  /// Reads the scenes of these motions; on all cores, for some take seconds.
  explicit ScenePairs(const std::vector<const SceneMotion*>& motions);
  struct Pair {
    std::shared_ptr<const scene::Scene> served;
    std::function<std::unique_ptr<slave::Slave>()> make_served;
    std::function<std::unique_ptr<slave::Slave>()> make_truth;
  };
  const Pair& of(const std::string& scene) const { return pairs_.at(scene); }

 private:
  std::map<std::string, Pair> pairs_;
};

/// One run of the table.
struct Cell {
  const SceneMotion* motion = nullptr;
  control::Method method = control::Method::kModel;
  double rtt_ms = 0;
  double loss = 0;  ///< of datagrams, each way, independent
  std::uint64_t seed = 1;
  bool keep_trace = false;
  double compand = 1;         ///< `twin`: attraction before contact, up to so many times as strong
  double reply_permille = 0;  ///< deadband of replies; not with `twin`
};

struct CellResult {
  Cell cell;
  FeltMetrics metrics;
  HapticMetrics haptic;
  TouchOutcome run;  ///< its trace only where it was asked for
};

/// The force scale of every method: planned for a method that pays for the way's delay itself
/// (control::plan_scaling of `model`), so that all methods show the same touch.
control::Scaling planned_scaling(const slave::SlaveLimits& limits, const device::PlantConfig& plant,
                                 double rate_hz, double velocity_scale);

using MakeMethod = std::function<std::unique_ptr<control::StationMethod>(const control::Scaling&)>;

/// `stand_in`: a method of the caller's own.
CellResult run_cell(const Cell& cell, const ScenePairs& scenes, const MakeMethod& stand_in = {});

std::string cells_csv(const std::vector<CellResult>& results);

/// What a deadband of replies saves and costs: a row for each of `sparing`, beside the same cell of `results`, which has
/// every reply.
std::string replies_csv(const std::vector<CellResult>& results, const std::vector<CellResult>& sparing);

}  // namespace telenano::studies::fidelity

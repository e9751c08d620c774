#pragma once

#include <functional>

#include "tests/studies/stress/stress_run.h"

namespace telenano::studies::stress {

/// Hill climbing over what the hand does: a path of points, of which some are changed; the change stays if it
/// got more out. Begins with the path of a hand that goes with the force.
struct Climbed {
  RunSpec spec;  ///< HandKind::kPath: the worst that was found
  Outcome outcome;
  std::int64_t ticks = 0;  ///< of all tries
};
Climbed climb(const RunSpec& spec, const Scenes& scenes);

/// Something that a shrunk run must still do.
using StillBad = std::function<bool(const Outcome&)>;
/// The run with as little in it as still is `bad`: shorter, fewer troubles, shorter delay, fewer and rounder
/// points of the path. `spec` itself must be. A driven hand is written down as a path first.
RunSpec shrink(const RunSpec& spec, const Scenes& scenes, const StillBad& bad);

}  // namespace telenano::studies::stress

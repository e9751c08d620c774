#pragma once

#include <string>
#include <vector>

#include "tests/studies/stress/stress_run.h"

namespace telenano::studies::stress {

/// What it took to find a wrong controller out.
struct Hunt {
  Mutant mutant = Mutant::kNone;
  std::uint32_t caught_by = 0;  ///< invariants that it violates and the right one does not, in the same run
  RunSpec spec;                 ///< that run
  Outcome outcome;              ///< of the mutant
  int runs = 0;                 ///< until then

  bool survived() const noexcept { return caught_by == 0; }
};

/// Runs every mutant until an invariant that its method keeps is violated.
std::vector<Hunt> hunt_mutants(const Scenes& scenes, std::uint64_t seed, unsigned threads);

/// As a table for people and programs: CSV.
std::string hunt_csv(const std::vector<Hunt>& hunts);

}  // namespace telenano::studies::stress

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/studies/fidelity/fidelity_grid.h"
#include "tests/studies/fidelity/renderer_mutants.h"

namespace telenano::studies::fidelity {

/// What is asked of a method that shows the sample itself. A metric that is not defined for a motion asks
/// nothing of it.
struct Asked {
  double nrmse = 0.02;
  double event = 0.02;        ///< of pull-off and snap-in, relative
  double correlation = 0.99;  ///< of the lateral force, at least
  double lag_ms = 5;
  double work = 0.05;  ///< of the larger of the true work and 1 mJ
};
/// The rules that are broken, in words with their figures; empty: none.
std::vector<std::string> broken_rules(const FeltMetrics& metrics, const Asked& asked = {});

/// The motions that show every wrong renderer: level ground with adhesion, a scan, a groove.
std::vector<std::string> telling_motions();

struct SensitivityRow {
  WrongRenderer wrong = WrongRenderer::kNone;
  std::string motion;              ///< in which it shows most, by the NRMSE
  std::vector<std::string> rules;  ///< broken there
  double nrmse = 0;
  /// What the stress laboratory finds broken where the product's `model` is made wrong likewise, and is not
  /// where it is right: stress::Invariant bits.
  std::uint32_t stress = 0;
};
/// The right renderer first, then each wrong one: the worst of the telling motions.
std::vector<SensitivityRow> check_sensitivity(const ScenePairs& scenes);

/// As CSV: renderer, motion, nrmse, stress, broken.
std::string sensitivity_csv(const std::vector<SensitivityRow>& rows);

}  // namespace telenano::studies::fidelity

#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "telenano/common/control/z_width.h"

namespace telenano::studies {

/// What `telenano-lab zwidth` is asked for.
struct ZWidthOptions {
  control::HapticDisplay display;
  std::vector<double> virtual_damping_n_s_m{0.0};
  double filter_hz = 0;  ///< of the wall's velocity; 0: none
  int delay_samples = 0;
  double encoder_counts_per_m = 0;  ///< 0: not quantised
  double force_bits = 0;            ///< of the force command over ±20 N; 0: not quantised
  double coulomb_friction_n = 0;
  double outside_damping_n_s_m = 0;  ///< virtual damper outside the wall

  /// Throws UserError naming the flag, its value and the range.
  void validate() const;
};

/// Stiffness limits of one virtual damping, N/m; NaN where nothing is stable, where the damper alone is not
/// passive, or where no closed form exists.
struct ZWidthRow {
  double virtual_damping_n_s_m = 0;
  double passive = 0;    ///< CB's theorem, numerically
  double closed = 0;     ///< its closed form
  double coupled = 0;    ///< worst of the free device and of heavy hands with a resonance in (0, 2.5/T]
  double free = 0;       ///< the device alone, never leaving the wall
  double simulated = 0;  ///< one-sided wall, encoder, hands that lean on it
};

inline constexpr const char* kZWidthHeader =
    "virtual_damping,k_passive,k_passive_closed,k_coupled,k_free,k_simulated";

ZWidthRow zwidth_row(const ZWidthOptions& options, double virtual_damping_n_s_m);
std::string csv(const ZWidthRow& row);

/// All rows, on all cores, in order, as CSV.
std::vector<ZWidthRow> run_zwidth(const ZWidthOptions& options, std::FILE* out);

}  // namespace telenano::studies

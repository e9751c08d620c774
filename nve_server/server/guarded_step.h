#pragma once

#include <cmath>

#include "telenano/nve_server/slave/slave.h"

namespace telenano::server {

/// The shortest step that a slave is given: two commands of a station that catches up may lie that close
/// together.
constexpr double kStepMinS = 1e-6;

inline bool is_finite(const slave::SlaveOutput& o) noexcept {
  return telenano::is_finite(o.force_w_nn) && telenano::is_finite(o.tip_pos_w_nm) &&
         telenano::is_finite(o.commanded_pos_w_nm) && std::isfinite(o.deflection_nm) &&
         std::isfinite(o.energy_in_aj) && std::isfinite(o.energy_out_aj);
}

/// A slave that goes wrong must not be felt: zero force, a named fault, everything else as it was `last`,
/// which `output` is before. (In this order: what was written just now is slow to copy.)
inline void step_guarded(slave::Slave& slave, const slave::SlaveInput& input, double dt_s,
                         const slave::SlaveOutput& last, slave::SlaveOutput& output) noexcept {
  slave.step(input, dt_s, output);
  if (!link::is_finite(output.model)) output.model = {};        // the force may be right all the same
  if (!link::is_finite(output.particle)) output.particle = {};  // it is only to be looked at
  if (is_finite(output)) return;
  output = last;
  output.force_w_nn.setZero();
  output.fault_bits |= link::kFaultNonFinite;
}

}  // namespace telenano::server

#pragma once

#include <string>
#include <vector>

#include "telenano/nve_server/physics/probe/probe_mode.h"

namespace telenano::studies {

/// A mode that falls onto a spring contact, by one of the three methods of physics::ProbeMode: error against
/// run time.
struct ModeRow {
  physics::ModeIntegrator method = physics::ModeIntegrator::kMeanForce;
  double omega_dt = 0;         ///< ω0 h
  double stiffness_ratio = 0;  ///< contact over lever
  double error = 0;      ///< largest deviation of the deflection over two periods, of the largest deflection
  double ns_a_step = 0;  ///< least of several runs; 0 if it was not timed
};

/// k = 1 N/m, f0 = 10 kHz, Q = 50, released at rest 1 nm into a two-sided spring of `stiffness_ratio`; the
/// reference is the closed form of the oscillator with both springs.
ModeRow mode_row(physics::ModeIntegrator method, double omega_dt, double stiffness_ratio, bool timed);

/// All three, ω0 h = 1/2, 1/4 … 1/256, ratios 0, 1, 10, 100.
std::vector<ModeRow> mode_table(bool timed);
std::string mode_csv_header();
std::string mode_csv(const ModeRow& row);

}  // namespace telenano::studies

#include "tests/studies/coupling/mode_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "telenano/common/base/constants.h"

namespace telenano::studies {
namespace {

using physics::ModeIntegrator;
using physics::ModePropagator;
using physics::ModeState;
using physics::ModeStep;
using physics::ProbeMode;

constexpr double kLever_n_m = 1.0;
constexpr double kFrequency_hz = 1e4;
constexpr double kQuality = 50.0;
constexpr double kPeriods = 2.0;
constexpr double kRest_nm = 1.0;  // where the contact's spring has no force

void step(const ProbeMode& mode, const ModePropagator& over, double contact, ModeState& state) {
  const ModeStep s = mode.begin(over, state, contact);
  const double force = -contact * (s.shift_nm - kRest_nm) / (1.0 + contact * s.compliance_nm_nn);
  mode.finish(s, force, state);
}

ModeState at_start(double contact) {
  // Without a contact, 1 nm of deflection rings down instead.
  return {contact > 0 ? 0.0 : kRest_nm, 0.0, contact * kRest_nm};
}

double exact(double contact, double t) {
  const double w0 = 2 * kPi * kFrequency_hz, gamma = w0 / (2 * kQuality);
  const double w = std::sqrt(w0 * w0 * (kLever_n_m + contact) / kLever_n_m - gamma * gamma);
  const double rest = contact * kRest_nm / (kLever_n_m + contact);
  const double from = at_start(contact).deflection_nm - rest;
  return rest + from * std::exp(-gamma * t) * (std::cos(w * t) + gamma / w * std::sin(w * t));
}

}  // namespace

ModeRow mode_row(ModeIntegrator method, double omega_dt, double stiffness_ratio, bool timed) {
  const double h = omega_dt / (2 * kPi * kFrequency_hz), contact = stiffness_ratio * kLever_n_m;
  const int steps = static_cast<int>(std::ceil(kPeriods / (kFrequency_hz * h)));
  const ProbeMode mode(kLever_n_m, kFrequency_hz, kQuality);
  const ModePropagator over = mode.over(h, method);
  ModeRow row{method, omega_dt, stiffness_ratio, 0, 0};
  ModeState state = at_start(contact);
  double largest = std::abs(state.deflection_nm);
  for (int i = 1; i <= steps; ++i) {
    step(mode, over, contact, state);
    const double truth = exact(contact, i * h);
    row.error = std::max(row.error, std::abs(state.deflection_nm - truth));
    largest = std::max(largest, std::abs(truth));
  }
  row.error /= largest;
  if (!timed) return row;
  row.ns_a_step = 1e9;
  for (int run = 0; run < 9; ++run) {
    constexpr int kSteps = 20000;
    ModeState s = at_start(contact);
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < kSteps; ++i) step(mode, over, contact, s);
    const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - start;
    // The state decides something, so that the loop is not left out.
    if (std::isfinite(s.deflection_nm)) row.ns_a_step = std::min(row.ns_a_step, took.count() / kSteps);
  }
  return row;
}

std::vector<ModeRow> mode_table(bool timed) {
  std::vector<ModeRow> rows;
  for (const auto method :
       {ModeIntegrator::kBackwardEuler, ModeIntegrator::kHeldForce, ModeIntegrator::kMeanForce}) {
    for (const double ratio : {0.0, 1.0, 10.0, 100.0}) {
      for (double omega_dt = 0.5; omega_dt > 1.0 / 300; omega_dt /= 2) {
        rows.push_back(mode_row(method, omega_dt, ratio, timed));
      }
    }
  }
  return rows;
}

std::string mode_csv_header() {
  return "method,omega_dt,stiffness_ratio,error,ns_a_step";
}

std::string mode_csv(const ModeRow& r) {
  const char* method = r.method == ModeIntegrator::kBackwardEuler ? "backward-euler"
                       : r.method == ModeIntegrator::kHeldForce   ? "held-force"
                                                                  : "mean-force";
  return fmt::format("{},{:.9g},{:.9g},{:.6g},{:.4g}", method, r.omega_dt, r.stiffness_ratio, r.error,
                     r.ns_a_step);
}

}  // namespace telenano::studies

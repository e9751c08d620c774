#include "tests/studies/coupling/coupling_study.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"

namespace telenano::studies {
namespace {

constexpr double kContactDistance_nm = 0.165;
constexpr int kPressSamples = 20;
constexpr double kReferenceStep =
    0.5;  // (k_c + K) h/b_c: Runge–Kutta's error is then (1/2)⁵/120 of a transient
constexpr int kPiecesMax = 200000;

void check(const CouplingSetup& s) {
  const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
  if (!positive(s.stiffness_n_m)) throw UserError("coupling: stiffness must be positive and finite (N/m)");
  if (!positive(s.dt_s)) throw UserError("coupling: time step must be positive and finite (s)");
  if (!std::isfinite(s.damping_n_s_m) || s.damping_n_s_m < 0) {
    throw UserError("coupling: damping must be finite and not negative (N s/m)");
  }
  if (s.method == CouplingMethod::kExplicit && s.damping_n_s_m == 0) {
    throw UserError("coupling: the explicit method needs a damper");
  }
  if (s.method == CouplingMethod::kImplicit && s.iterations < 1) {
    throw UserError("coupling: the implicit method needs at least one iteration");
  }
}

double step(const CouplingSetup& s, const CouplingLaw& law, double extension, double end) {
  const double k_c = s.stiffness_n_m, b_over_dt = s.damping_n_s_m / s.dt_s;
  const double k_total = k_c + b_over_dt;
  const LawPoint old = law.at(extension - end);
  switch (s.method) {
    case CouplingMethod::kExplicit:
      return extension - (k_c * extension + old.force_nn) / b_over_dt;
    case CouplingMethod::kSemiImplicit:
      return (b_over_dt * extension - old.force_nn) / k_total;
    case CouplingMethod::kImplicit:
      break;
  }
  double e = extension;
  for (int i = 0; i < s.iterations; ++i) {
    const LawPoint p = law.at(e - end);
    const double residual = k_c * e + b_over_dt * (e - extension) + p.force_nn;
    e -= residual / (k_total + std::max(p.stiffness_n_m, -0.5 * k_total));
  }
  return e;
}

// The extension at rest: k_c e + F(e − X) = 0 for the largest e, where one comes from when pressing (e = 0
// and F = 0 far above).
double static_extension(const CouplingSetup& s, const CouplingLaw& law, double end) {
  const auto residual = [&](double e) { return s.stiffness_n_m * e + law.at(e - end).force_nn; };
  // From extensions where the springs win on either side.
  double high = 0;
  while (residual(high) < 0) high = 2 * high + 1;
  double low = -1;
  while (residual(low) > 0) low *= 2;
  for (int i = 0; i < 200; ++i) {
    const double mid = 0.5 * (low + high);
    (residual(mid) > 0 ? high : low) = mid;
  }
  return 0.5 * (low + high);
}

std::vector<double> press(double depth_nm, int hold) {
  std::vector<double> end;
  for (int i = 0; i <= kPressSamples; ++i) end.push_back(1.0 - (depth_nm + 1.0) * i / kPressSamples);
  end.insert(end.end(), static_cast<std::size_t>(hold), -depth_nm);
  return end;
}

}  // namespace

CouplingLaw linear_law(double k) {
  return {"linear", [k](double delta) { return LawPoint{k * delta, k}; }};
}

CouplingLaw wall_law(double k) {
  return {"wall", [k](double delta) { return delta <= 0 ? LawPoint{} : LawPoint{k * delta, k}; }};
}

CouplingLaw hertz_law(double contact_modulus_gpa, double radius_nm) {
  const double factor = contact_modulus_gpa * std::sqrt(radius_nm);
  return {"hertz", [factor](double delta) {
            if (delta <= 0) return LawPoint{};  // what is not a number stays so
            const double root = std::sqrt(delta);
            return LawPoint{factor * delta * root, 1.5 * factor * root};
          }};
}

CouplingLaw dmt_law(double contact_modulus_gpa, double radius_nm, double w_n_m) {
  const double factor = contact_modulus_gpa * std::sqrt(radius_nm);
  const double pull = 2 * kPi * w_n_m * radius_nm;
  return {"dmt", [factor, pull](double delta) {
            if (delta > 0) {
              const double root = std::sqrt(delta);
              return LawPoint{factor * delta * root - pull, 1.5 * factor * root};
            }
            const double d = kContactDistance_nm - delta, ratio = kContactDistance_nm / d;
            return LawPoint{-pull * ratio * ratio, -2 * pull * ratio * ratio / d};
          }};
}

std::vector<double> coupling_history(const CouplingSetup& setup, const CouplingLaw& law,
                                     std::span<const double> end_nm) {
  check(setup);
  std::vector<double> force;
  if (end_nm.empty()) return force;
  double e = static_extension(setup, law, end_nm[0]);
  force.push_back(law.at(e - end_nm[0]).force_nn);
  for (std::size_t i = 1; i < end_nm.size(); ++i) {
    e = step(setup, law, e, end_nm[i]);
    force.push_back(law.at(e - end_nm[i]).force_nn);
  }
  return force;
}

std::vector<double> coupling_reference(const CouplingSetup& setup, const CouplingLaw& law,
                                       std::span<const double> end_nm, int pieces) {
  check(setup);
  std::vector<double> force;
  if (end_nm.empty()) return force;
  double e = static_extension(setup, law, end_nm[0]);
  force.push_back(law.at(e - end_nm[0]).force_nn);
  const double k_c = setup.stiffness_n_m, b = setup.damping_n_s_m;
  for (std::size_t i = 1; i < end_nm.size(); ++i) {
    const double from = end_nm[i - 1], move = end_nm[i] - from;
    if (b == 0) {
      e = static_extension(setup, law, end_nm[i]);
    } else {
      // The steepest place that this sample can reach is where the end drives the tip in with no yield.
      const double deepest = std::max(e - from, e - end_nm[i]);
      const double steepest =
          k_c + std::max(std::abs(law.at(deepest).stiffness_n_m), std::abs(law.at(e - from).stiffness_n_m));
      const double wanted = std::ceil(steepest * setup.dt_s / (b * kReferenceStep));
      const int n = std::max(pieces, static_cast<int>(std::min(wanted, 1.0 * kPiecesMax)));
      const double h = setup.dt_s / n;
      const auto rate = [&](double x, double s) {
        return -(k_c * x + law.at(x - from - move * s / n).force_nn) / b;
      };
      for (int j = 0; j < n; ++j) {
        const double r1 = rate(e, j), r2 = rate(e + 0.5 * h * r1, j + 0.5);
        const double r3 = rate(e + 0.5 * h * r2, j + 0.5), r4 = rate(e + h * r3, j + 1.0);
        e += h / 6 * (r1 + 2 * r2 + 2 * r3 + r4);
      }
    }
    force.push_back(law.at(e - end_nm[i]).force_nn);
  }
  return force;
}

double static_force_nn(const CouplingSetup& setup, const CouplingLaw& law, double end_nm) {
  check(setup);
  return law.at(static_extension(setup, law, end_nm) - end_nm).force_nn;
}

bool is_stable(const CouplingSetup& setup, const CouplingLaw& law, double depth_nm) {
  check(setup);
  // Long enough for the slowest way to rest, b_c/k_c, to halve several times.
  const double slow = setup.damping_n_s_m / (setup.stiffness_n_m * setup.dt_s);
  const int hold = static_cast<int>(std::clamp(10 * slow, 400.0, 20000.0));
  const std::vector<double> end = press(depth_nm, hold);
  const std::vector<double> force = coupling_history(setup, law, end);
  const double rest = static_force_nn(setup, law, -depth_nm);
  const auto largest = [&](std::size_t from, std::size_t to) {
    double worst = 0;
    for (std::size_t i = from; i < to; ++i) {
      if (!std::isfinite(force[i])) return std::numeric_limits<double>::infinity();
      worst = std::max(worst, std::abs(force[i] - rest));
    }
    return worst;
  };
  const std::size_t held = force.size() - static_cast<std::size_t>(hold);
  const auto quarter = static_cast<std::size_t>(hold / 4);
  const double last = largest(force.size() - quarter, force.size());
  return last < 0.5 * largest(held, held + quarter) || last < 1e-9 * std::abs(rest);
}

CouplingRow coupling_row(const CouplingSetup& setup, const CouplingLaw& law, double depth_nm) {
  CouplingRow row;
  row.setup = setup;
  row.law = law.name;
  const double rest = static_extension(setup, law, -depth_nm);
  row.contact_stiffness_n_m = law.at(rest + depth_nm).stiffness_n_m;
  row.stiffness_ratio = row.contact_stiffness_n_m / setup.stiffness_n_m;
  row.damping_ratio = setup.damping_n_s_m / (setup.stiffness_n_m * setup.dt_s);
  row.step_number = row.stiffness_ratio / row.damping_ratio;
  row.stable = is_stable(setup, law, depth_nm);
  // Down, hold, up again, over 3 × 20 samples.
  std::vector<double> end = press(depth_nm, kPressSamples);
  for (int i = kPressSamples; i >= 0; --i) end.push_back(end[static_cast<std::size_t>(i)]);
  const std::vector<double> force = coupling_history(setup, law, end);
  const std::vector<double> exact = coupling_reference(setup, law, end, 50);
  double sum = 0, largest = 0;
  for (std::size_t i = 0; i < force.size(); ++i) {
    sum += (force[i] - exact[i]) * (force[i] - exact[i]);
    largest = std::max(largest, std::abs(exact[i]));
  }
  row.error = std::sqrt(sum / static_cast<double>(force.size())) / largest;
  if (!std::isfinite(row.error)) row.error = std::numeric_limits<double>::infinity();
  return row;
}

std::vector<CouplingRow> coupling_table(int steps_a_decade, std::span<const CouplingLaw> laws) {
  std::vector<CouplingSetup> setups;
  for (const double damping_ratio : {0.0, 0.1, 1.0, 10.0}) {
    CouplingSetup setup;
    setup.damping_n_s_m = damping_ratio * setup.stiffness_n_m * setup.dt_s;
    setup.method = CouplingMethod::kExplicit;
    if (damping_ratio > 0) setups.push_back(setup);
    setup.method = CouplingMethod::kSemiImplicit;
    setups.push_back(setup);
    setup.method = CouplingMethod::kImplicit;
    for (const int n : {1, 2, 4, 8}) {
      setup.iterations = n;
      setups.push_back(setup);
    }
  }
  std::vector<CouplingRow> rows;
  for (const CouplingSetup& setup : setups) {
    for (int i = 0; i <= 5 * steps_a_decade; ++i) {
      const double ratio = 0.01 * std::pow(10.0, static_cast<double>(i) / steps_a_decade);
      rows.push_back(coupling_row(setup, wall_law(ratio * setup.stiffness_n_m), 10.0));
    }
    for (const CouplingLaw& law : laws) rows.push_back(coupling_row(setup, law, 10.0));
  }
  return rows;
}

std::string coupling_csv_header() {
  return "method,iterations,law,coupling_n_m,damping_n_s_m,dt_s,contact_n_m,stiffness_ratio,damping_ratio,"
         "step_number,stable,error";
}

std::string coupling_csv(const CouplingRow& r) {
  const CouplingSetup& s = r.setup;
  const char* method = s.method == CouplingMethod::kExplicit       ? "explicit"
                       : s.method == CouplingMethod::kSemiImplicit ? "semi-implicit"
                                                                   : "implicit";
  return fmt::format("{},{},{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{},{:.6g}", method,
                     s.method == CouplingMethod::kImplicit ? s.iterations : 0, r.law, s.stiffness_n_m,
                     s.damping_n_s_m, s.dt_s, r.contact_stiffness_n_m, r.stiffness_ratio, r.damping_ratio,
                     r.step_number, r.stable ? 1 : 0, r.error);
}

}  // namespace telenano::studies

#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace telenano::studies {

/// How far other ways to step a virtual coupling carry: the reference against which the product's implicit
/// balance (nve_server/slave) is weighed.
///
/// One axis, no mass: the commanded end X moves, the base follows through spring and damper, the apex is the
/// base, the sample is at 0. e = X − base, overlap δ = e − X:
///
///   k_c e + b_c e' + F(e − X) = 0,     nm, nN, N/m, N·s/m
///
/// Sampled at dt, X known at the new sample (X₁), e₀ from the one before:
///   explicit        e₁ = e₀ − (dt/b_c)(k_c e₀ + F(e₀ − X₁)); stable for dt (k_c + K)/b_c < 2
///   semi-implicit   (k_c + b_c/dt) e₁ = (b_c/dt) e₀ − F(e₀ − X₁): coupling now, contact one sample late;
///                   stable for K < k_c + 2 b_c/dt
///   implicit, n     k_c e₁ + (b_c/dt)(e₁ − e₀) + F(e₁ − X₁) = 0 by n steps of Newton's method from e₀;
///                   stable for every K >= 0 (the limits are those of a linear contact of stiffness K, where
///                   n = 1 is exact already). Where the law is steeper in attraction than half of the springs
///                   the slope is cut there.
enum class CouplingMethod { kExplicit, kSemiImplicit, kImplicit };

/// Force and its slope at an overlap; repulsive positive, single-valued.
struct LawPoint {
  double force_nn = 0;
  double stiffness_n_m = 0;
};
struct CouplingLaw {
  std::string name;
  std::function<LawPoint(double overlap_nm)> at;
};

CouplingLaw linear_law(double stiffness_n_m);  ///< on both sides of 0, so that theory applies as it stands
CouplingLaw wall_law(double stiffness_n_m);    ///< from 0 on
/// F = K √R δ^1.5, K = 4E*/3.
CouplingLaw hertz_law(double contact_modulus_gpa, double radius_nm);
/// Hertz less 2πwR in contact, −2πwR (a₀/d)², d = a₀ − δ, outside: DMT with van der Waals, continuous.
CouplingLaw dmt_law(double contact_modulus_gpa, double radius_nm, double work_of_adhesion_n_m);

struct CouplingSetup {
  CouplingMethod method = CouplingMethod::kImplicit;
  int iterations = 1;  ///< of Newton's method, implicit only
  double stiffness_n_m = 20;
  double damping_n_s_m = 0;
  double dt_s = 1e-3;
};

/// Force on the tip after each sample; `end_nm[0]` is where everything rests at the start. Throws UserError
/// for a setup that makes no sense (explicit without damper among them).
std::vector<double> coupling_history(const CouplingSetup& setup, const CouplingLaw& law,
                                     std::span<const double> end_nm);

/// The same motion with the end moving evenly between samples, by Runge–Kutta of fourth order with `pieces`
/// steps a sample, at least as many as keep (k_c + K) h/b_c below 0.5 on the way; without damper the balance
/// by bisection.
std::vector<double> coupling_reference(const CouplingSetup& setup, const CouplingLaw& law,
                                       std::span<const double> end_nm, int pieces);

/// Balance of the end at rest, by bisection; where springs softer than the attraction leave several, one of
/// them.
double static_force_nn(const CouplingSetup& setup, const CouplingLaw& law, double end_nm);

/// Presses the end to `depth_nm` below 0 within 20 samples and holds it there. Stable if the force then draws
/// nearer to the static one: the largest deviation in the last quarter of the hold is below half of that in
/// the first, or below 1e-9 of the force.
bool is_stable(const CouplingSetup& setup, const CouplingLaw& law, double depth_nm);

/// One line of the table "stable, and how accurate, up to where".
struct CouplingRow {
  CouplingSetup setup;
  std::string law;
  double contact_stiffness_n_m = 0;  ///< of the law at rest at the depth
  double stiffness_ratio = 0;        ///< K/k_c
  double damping_ratio = 0;          ///< b_c/(k_c dt)
  double step_number = 0;            ///< K dt/b_c; inf without damper
  bool stable = false;
  double error = 0;  ///< root mean square over a press and release, against the reference, of the largest
                     ///< force; inf if not finite
};
CouplingRow coupling_row(const CouplingSetup& setup, const CouplingLaw& law, double depth_nm);
/// Explicit, semi-implicit, implicit with n = 1, 2, 4, 8 on walls of K/k_c = 0.01 … 1000 (`steps_a_decade`)
/// and b_c/(k_c dt) = 0, 0.1, 1, 10 (explicit only with a damper), at k_c = 20 N/m and 1 kHz; and with `laws`
/// besides (their stiffness is what it is).
std::vector<CouplingRow> coupling_table(int steps_a_decade, std::span<const CouplingLaw> laws);
std::string coupling_csv_header();
std::string coupling_csv(const CouplingRow& row);

}  // namespace telenano::studies

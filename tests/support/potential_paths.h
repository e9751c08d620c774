#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"

/// Grounds in closed form and closed paths over them, for tests of the balance on one potential.
namespace telenano::support {

using namespace telenano::physics;

inline constexpr double kTwoPi = 6.28318530717958647692;

inline TipSampleParameters silicon_oxide() {  // λ = 0.74 at 20 nm
  TipSampleParameters p;
  p.contact_modulus_gpa = 70.0;
  p.work_of_adhesion_n_m = 0.4;
  return p;
}

/// A level and waves, with its derivatives.
struct Waves {
  struct Wave {
    double size, kx, ky, phase;
  };
  double level = 0;
  std::vector<Wave> waves;

  struct Jet {
    double value = 0;
    Vec3 grad = Vec3::Zero();
    Mat3 hess = Mat3::Zero();
  };
  Jet at(double x, double y) const {
    Jet jet;
    jet.value = level;
    for (const Wave& w : waves) {
      const double angle = w.kx * x + w.ky * y + w.phase;
      const Vec3 k(w.kx, w.ky, 0);
      jet.value += w.size * std::cos(angle);
      jet.grad -= w.size * std::sin(angle) * k;
      jet.hess -= w.size * std::cos(angle) * (k * k.transpose());
    }
    return jet;
  }
};

/// δ = (H − z) c and ρ, each a wave field of (x, y): like a scan's, with exact derivatives.
class EggCrate final : public ContactFields {
 public:
  Waves height, cosine{1.0, {}}, log_radius{std::log(20.0), {}};

  std::shared_ptr<const EggCrate> softened;  ///< instead, at a fixed softening

  void contact_at(const Vec3& p, ContactJet& jet) const noexcept override {
    const Waves::Jet h = height.at(p.x(), p.y());
    const Waves::Jet c = cosine.at(p.x(), p.y());
    const Waves::Jet r = log_radius.at(p.x(), p.y());
    const double v = h.value - p.z();
    const Vec3 v_grad = h.grad - Vec3::UnitZ();
    const Mat3 both = v_grad * c.grad.transpose();
    jet.overlap_nm = v * c.value;
    jet.overlap_grad = c.value * v_grad + v * c.grad;
    jet.overlap_hess_per_nm = c.value * h.hess + both + both.transpose() + v * c.hess;
    jet.log_radius = r.value;
    jet.log_radius_grad_per_nm = r.grad;
    jet.log_radius_hess_per_nm2 = r.hess;
  }
  void growing_at(const Vec3& p, const SofteningRule& /*rule*/, ContactJet& jet) const noexcept override {
    (softened ? *softened : *this).contact_at(p, jet);
  }
  void at_softening(const Vec3& p, double /*softening_nm*/, ContactJet& jet) const noexcept override {
    (softened ? *softened : *this).contact_at(p, jet);
  }
};

/// Gentle enough for stiff springs that a pressed tip never slides; radii from 13 to 31 nm, on both sides of
/// λ = 0.717.
inline std::shared_ptr<EggCrate> gentle_ground() {
  auto ground = std::make_shared<EggCrate>();
  ground->height.waves = {{0.5, 0.11, 0.03, 0.3}, {0.3, -0.05, 0.13, 1.1}, {0.1, 0.2, 0.19, 2.0}};
  ground->cosine = {0.95, {{0.03, 0.07, 0.09, 0.5}}};
  ground->log_radius.waves = {{0.3, 0.1, -0.06, 0.9}, {0.12, 0.02, 0.17, 0.1}};
  return ground;
}

/// Rough: slopes to 60°, radii from 3 to 130 nm.
inline std::shared_ptr<EggCrate> rough_ground() {
  auto ground = std::make_shared<EggCrate>();
  ground->height.waves = {{3.0, 0.25, 0.1, 0.3}, {2.0, -0.2, 0.33, 1.1}, {0.4, 0.9, 0.5, 2.0}};
  ground->cosine = {0.75, {{0.2, 0.3, 0.21, 0.5}}};
  ground->log_radius.waves = {{1.0, 0.3, -0.26, 0.9}, {0.8, 0.22, 0.47, 0.1}};
  return ground;
}

inline std::shared_ptr<const BranchPotential> potential_of(const TipSampleParameters& p) {
  return std::make_shared<BranchPotential>(TipSampleLaw(p, 20.0), 20.0);
}

inline FrictionParameters rough_contact() {
  FrictionParameters f;
  f.shear_strength_gpa = 0.3;
  f.shear_modulus_gpa = 20.0;
  return f;
}

inline Compliance stiff_springs() {  // lateral 40 N/m, 30 along z, with a cross term
  Compliance c = Mat3::Identity() / 40.0;
  c(2, 2) = 1.0 / 30.0;
  c(0, 2) = c(2, 0) = 0.003;
  return c;
}

/// A smooth closed path of five harmonics around (0, 0, z).
struct ClosedPath {
  double z = 0, depth = 0, width = 15;
  std::vector<double> phases;

  ClosedPath(std::uint64_t seed, double z_nm, double depth_nm) : z(z_nm), depth(depth_nm) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> any(0.0, kTwoPi);
    for (int i = 0; i < 15; ++i) phases.push_back(any(random));
  }
  Vec3 at(double s, Vec3* rate) const {
    Vec3 x(0, 0, z);
    rate->setZero();
    for (int k = 1; k <= 5; ++k) {
      const double size[3] = {width / k, width / k, depth / k};
      for (int i = 0; i < 3; ++i) {
        const double angle = kTwoPi * k * s + phases[static_cast<std::size_t>(3 * (k - 1) + i)];
        x[i] += size[i] * std::sin(angle) / k;
        (*rate)[i] += size[i] * kTwoPi * std::cos(angle);
      }
    }
    return x;
  }
  double length() const {
    double sum = 0;
    Vec3 rate;
    for (int i = 0; i < 1000; ++i) {
      at(i / 1000.0, &rate);
      sum += rate.norm() / 1000.0;
    }
    return sum;
  }
};

inline double stored(const TipSolution& s, const Compliance& c) {
  return s.potential_aj + s.friction_stored_aj + 0.5 * s.force_w_nn.dot(c * s.force_w_nn);
}

struct Lap {
  double work = 0;      ///< of the free end: a sum of forces alone
  double turnover = 0;  ///< ∫ |F·dx|
  double stored = 0;    ///< change of it
  double lost = 0;
  double rubbed = 0;
  int jumps = 0;
  int bridges = 0;  ///< that formed or ruptured
  int under_way = 0;
};

/// Comes down to the path's start, and goes once round. On a closed smooth path the trapezium rule over
/// points evenly spaced in the parameter converges faster than any power of their distance: the work is as
/// exact as the forces are, and knows of no energy.
inline Lap lap(const PotentialEquilibrium& on, const Compliance& c, const ClosedPath& path, double step_nm) {
  PotentialState state;
  Vec3 rate;
  const Vec3 start = path.at(0, &rate);
  for (double above = 30.0; above > 0.0; above -= 0.05) on.advance(start + Vec3(0, 0, above), c, state);
  TipSolution s = on.advance(start, c, state);
  for (int i = 0; i < 20 && s.under_way; ++i) s = on.advance(start, c, state);
  Lap out;
  const double before = stored(s, c);
  Vec3 last = start, last_rate = rate, force = s.force_w_nn;
  const int steps = static_cast<int>(path.length() / step_nm);
  for (int i = 1; i <= steps; ++i) {
    const Vec3 x = path.at(static_cast<double>(i % steps) / steps, &rate);
    const PotentialState was = state;
    s = on.advance(x, c, state);
    out.bridges += was.branch.bridge.present != state.branch.bridge.present;
    EXPECT_EQ(s.status, SolveStatus::kOk);
    EXPECT_GE(s.dissipated_aj, 0.0);
    double power = -0.5 * (s.force_w_nn.dot(rate) + force.dot(last_rate)) / steps;
    if (s.dissipated_aj > 0.0) {  // where in it the force jumps: once more, in a thousand parts
      state = was;
      power = 0;
      double lost = 0;
      for (int j = 1; j <= 1000; ++j) {
        s = on.advance(j == 1000 ? x : Vec3(last + (x - last) * (j / 1000.0)), c, state);
        power -= 0.5 * (s.force_w_nn + force).dot(x - last) / 1000.0;
        force = s.force_w_nn;
        lost += s.dissipated_aj;
        if (j < 1000) out.rubbed += s.friction_dissipated_aj;
        out.jumps += s.jumps;
      }
      s.dissipated_aj = lost;
      s.jumps = 0;
    }
    last = x;
    last_rate = rate;
    force = s.force_w_nn;
    out.work += power;
    out.turnover += std::fabs(power);
    out.lost += s.dissipated_aj;
    EXPECT_GE(s.friction_dissipated_aj, 0.0);
    out.rubbed += s.friction_dissipated_aj;
    out.jumps += s.jumps;
    out.under_way += s.under_way ? 1 : 0;
  }
  out.stored = stored(s, c) - before;
  return out;
}

}  // namespace telenano::support

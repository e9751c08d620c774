#pragma once

// Force curves in closed form, with the lever by bisection: made without the project's laws and solver.
#include <cmath>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/fit/raw_curve.h"

namespace telenano::fit_test {

inline constexpr double kPi = 3.14159265358979323846;

/// A sphere on a flat sample, JKR or DMT, without any force before touch.
struct Sample {
  bool jkr = true;
  double contact_modulus_gpa = 0.01;  ///< K
  double work_n_m = 0.05;             ///< w
  double radius_nm = 50;
  double stiffness_n_m = 0.2;

  /// JKR (Johnson, Kendall, Roberts 1971) by the contact radius a: δ = a²/R − (2/3)√(6πwa/K),
  /// F = Ka³/R − √(6πwKa³).
  double jkr_overlap(double a) const {
    return a * a / radius_nm - 2.0 / 3.0 * std::sqrt(6 * kPi * work_n_m * a / contact_modulus_gpa);
  }
  double jkr_force(double a) const {
    const double k = contact_modulus_gpa;
    return k * a * a * a / radius_nm - std::sqrt(6 * kPi * work_n_m * k * a * a * a);
  }
  /// What the base has to go in for that: x = δ + F/k. Falls, then grows with a.
  double jkr_base(double a) const { return jkr_overlap(a) + jkr_force(a) / stiffness_n_m; }
  /// Where it is least: the pull-off under this lever.
  double jkr_last_radius() const {
    double low = 0;
    double high = 10 * radius_nm;
    // Golden section: x(a) has one minimum.
    constexpr double kPart = 0.3819660112501051;
    for (int i = 0; i < 200; ++i) {
      const double left = low + kPart * (high - low);
      const double right = high - kPart * (high - low);
      (jkr_base(left) < jkr_base(right) ? high : low) = jkr_base(left) < jkr_base(right) ? right : left;
    }
    return 0.5 * (low + high);
  }
  /// Where the base is when the tip comes off.
  double leave_nm() const {
    return jkr ? jkr_base(jkr_last_radius()) : -2 * kPi * work_n_m * radius_nm / stiffness_n_m;
  }
  /// In contact, base gone in by x.
  double contact_force(double x) const {
    double low = jkr ? jkr_last_radius() : 0.0;
    double high = jkr ? 20 * radius_nm : 1e3;
    const auto base = [&](double s) { return jkr ? jkr_base(s) : s + dmt_force(s) / stiffness_n_m; };
    for (int i = 0; i < 200; ++i) {
      const double middle = 0.5 * (low + high);
      (base(middle) < x ? low : high) = middle;
    }
    return jkr ? jkr_force(low) : dmt_force(low);
  }
  /// DMT (Derjaguin, Muller, Toporov 1975): F = K√R δ^(3/2) − 2πwR.
  double dmt_force(double overlap) const {
    return contact_modulus_gpa * std::sqrt(radius_nm) * std::pow(overlap, 1.5) -
           2 * kPi * work_n_m * radius_nm;
  }
};

struct Ramp {
  double far_nm = 150;     ///< base above touch
  double deep_nm = 60;     ///< and below
  int points = 1000;       ///< each way
  double touch_nm = 3000;  ///< what the file calls the height of touch
};

struct Blemish {
  double white_nm = 0;
  double flicker_nm = 0;       ///< 1/f: random walks that forget over 4, 16, 64, 256 and 1024 points
  double drift_nm = 0;         ///< over the whole curve
  double interference_nm = 0;  ///< amplitude of a wave over z
  double wave_nm = 90;
};

/// Noise by the sample.
class Noise {
 public:
  Noise(const Blemish& blemish, std::uint64_t seed) : blemish_(blemish), random_(seed) {
    for (double& state : states_) state = random_.normal();
    phase_ = random_.uniform(0, 2 * kPi);
  }
  double at(double z_nm, double part) {
    double sum = 0;
    double forget = 1.0 / 4.0;
    for (double& state : states_) {
      const double keep = std::exp(-forget);
      state = keep * state + std::sqrt(1 - keep * keep) * random_.normal();
      sum += state;
      forget /= 4;
    }
    return blemish_.white_nm * random_.normal() + blemish_.flicker_nm * sum / std::sqrt(5.0) +
           blemish_.drift_nm * part +
           blemish_.interference_nm * std::sin(2 * kPi * z_nm / blemish_.wave_nm + phase_);
  }

 private:
  Blemish blemish_;
  Random random_;
  double states_[5];
  double phase_ = 0;
};

/// Both ways. In: free until the surfaces touch, then in contact; out: in contact until the lever's fold.
inline fit::RawCurve curve_of(const Sample& sample, const Ramp& ramp, const Blemish& blemish,
                              std::uint64_t seed) {
  fit::RawCurve curve;
  Noise noise(blemish, seed);
  const double step = (ramp.far_nm + ramp.deep_nm) / (ramp.points - 1);
  const double leave = sample.leave_nm();
  for (int i = 0; i < 2 * ramp.points; ++i) {
    const bool in = i < ramp.points;
    const int j = in ? i : 2 * ramp.points - 1 - i;
    const double x = -ramp.far_nm + step * j;
    const bool contact = in ? x > 0 : x > leave;
    const double force = contact ? sample.contact_force(x) : 0.0;
    fit::RawSegment& segment = in ? curve.approach : curve.retract;
    const double z = ramp.touch_nm - x;
    segment.z_nm.push_back(z);
    segment.deflection.push_back(force / sample.stiffness_n_m + 7.0 + 1e-3 * (z - ramp.touch_nm) +
                                 noise.at(z, i / (2.0 * ramp.points)));
  }
  return curve;
}

}  // namespace telenano::fit_test

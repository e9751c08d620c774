#include "tests/studies/contact_study.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/contact/maugis_dugdale.h"

namespace telenano::studies {
namespace {

using physics::CurvePoint;
using physics::CurveStatus;
using physics::Held;
using physics::MaugisDugdale;

constexpr Held kOverlapHeld{1.0, 0.0};
constexpr Held kLoadHeld{0.0, 1.0};
constexpr double kLambdaMin = 1e-6;
constexpr double kLambdaMax = 1e6;
constexpr double kDeltaMax = 1e9;

/// Free or on the stable curve, with memory.
class Follower {
 public:
  Follower(double lambda, bool inside) : curve_(lambda), inside_(inside) {}

  /// True when there is a force; then `point` is the state.
  bool move_to(double delta, CurvePoint& point) {
    // Snap-in lies at -H0: there, however the caller rounded it (2 ulp), the tip is still free.
    const double edge = -curve_.range() * (1.0 - 2.0 * std::numeric_limits<double>::epsilon());
    if (!inside_ && delta <= edge) return false;
    const physics::CurveSolution s = curve_.solve(delta, kOverlapHeld, point.contact ? point.parameter : 0.0);
    if (s.status == CurveStatus::kNotConverged) {
      throw RunError(fmt::format("contact: no convergence at lambda {}, delta {}", curve_.lambda(), delta));
    }
    inside_ = s.status == CurveStatus::kOk;
    point = s.point;
    return inside_;
  }

 private:
  MaugisDugdale curve_;
  bool inside_;
};

void print_curve(const ContactOptions& options, std::FILE* out) {
  fmt::print(out, "lambda,delta,force,contact_radius,branch\n");
  for (const double lambda : options.lambda) {
    Follower follower(lambda, options.retract);
    CurvePoint point;
    for (const double delta : options.delta) {
      if (follower.move_to(delta, point)) {
        fmt::print(out, "{:.15g},{:.15g},{:.15g},{:.15g},{}\n", lambda, delta, point.load,
                   point.contact_radius, point.contact ? "contact" : "noncontact");
      } else {
        fmt::print(out, "{:.15g},{:.15g},0,0,free\n", lambda, delta);
      }
    }
  }
}

void print_points(const ContactOptions& options, std::FILE* out) {
  fmt::print(out, "lambda,pull_off_load,delta_fold,radius_zero_load,delta_zero_load,loop_energy\n");
  for (const double lambda : options.lambda) {
    const MaugisDugdale curve(lambda);
    const CurvePoint snap_off = curve.fold(kOverlapHeld);
    const CurvePoint snap_in = curve.solve(-curve.range(), kOverlapHeld).point;
    const CurvePoint zero_load = curve.solve(0.0, kLoadHeld).point;
    fmt::print(out, "{:.15g},{:.15g},{:.15g},{:.15g},{:.15g},{:.15g}\n", lambda, curve.fold(kLoadHeld).load,
               snap_off.overlap, zero_load.contact_radius, zero_load.overlap,
               snap_off.energy - snap_in.energy);
  }
}

}  // namespace

void run_contact(const ContactOptions& options, std::FILE* out) {
  if (options.law != "md")
    throw UserError(fmt::format("contact: --law: '{}' is unknown; expected md", options.law));
  if (options.lambda.empty()) throw UserError("contact: --lambda: expected at least one number");
  if (options.delta.empty() && !options.points)
    throw UserError("contact: --delta: expected at least one number");
  for (const double lambda : options.lambda) {
    if (!(lambda >= kLambdaMin && lambda <= kLambdaMax)) {
      throw UserError(fmt::format("contact: --lambda: {} is out of range; expected {:g} to {:g}", lambda,
                                  kLambdaMin, kLambdaMax));
    }
  }
  for (const double delta : options.delta) {
    if (!(std::fabs(delta) <= kDeltaMax)) {
      throw UserError(fmt::format("contact: --delta: {} is out of range; expected {:g} to {:g}", delta,
                                  -kDeltaMax, kDeltaMax));
    }
  }
  if (options.points) {
    print_points(options, out);
  } else {
    print_curve(options, out);
  }
}

}  // namespace telenano::studies

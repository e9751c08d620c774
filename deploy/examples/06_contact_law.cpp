// A contact law of one's own: a Winkler foundation with a constant adhesive pull. The tip sinks into springs
// side by side, so that the load grows with the square of the overlap: P = Δ² − L, A = √Δ, without dimensions
// (contact_curve.h). As a ContactCurve it is solved with any spring behind the tip; the program prints a
// force curve and its distance from theory.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "telenano/nve_server/physics/contact/contact_curve.h"

using namespace telenano::physics;

namespace {

class WinklerCurve {
 public:
  WinklerCurve(double lambda, double pull_off) noexcept : lambda_(lambda), pull_off_(pull_off) {}

  double lambda() const noexcept { return lambda_; }
  double range() const noexcept { return 0; }  // no attraction before touch

  CurvePoint contact(double overlap) const noexcept {
    CurvePoint p;
    p.contact = true;
    p.parameter = p.overlap = overlap;
    p.outer_radius = p.contact_radius = std::sqrt(overlap);
    p.contact_radius_rate = overlap > 0 ? 0.5 / p.contact_radius : 0;
    p.overlap_rate = 1;
    p.load = overlap * overlap - pull_off_;
    p.load_rate = 2 * overlap;
    p.load_bend = 2;
    p.energy = overlap * (overlap * overlap / 3 - pull_off_);  // ∫P dΔ: what makes the law conservative
    return p;
  }
  /// The stable states end where the tip just touches: P rises from there on.
  CurvePoint fold(const Held& /*held*/) const noexcept { return contact(0); }
  /// overlap·Δ + load·(Δ² − L) = z: the positive root, in the form that loses no digits.
  CurveSolution solve(double z, const Held& held, double /*guess*/ = 0) const noexcept {
    const double c = z + held.load * pull_off_;
    if (!(c >= 0)) return {CurveStatus::kNoState, contact(0), 1};
    const double root = std::sqrt(held.overlap * held.overlap + 4 * held.load * c);
    return {CurveStatus::kOk, contact(c > 0 ? 2 * c / (held.overlap + root) : 0), 1};
  }

 private:
  double lambda_;
  double pull_off_;
};

static_assert(ContactCurve<WinklerCurve>);  // the compiler says what is missing

}  // namespace

int main() {
  const WinklerCurve law(1, 0.5);
  const Held spring{1, 0.25};  // held behind a spring of compliance 0.25: Z = Δ + P/4
  double worst = 0;
  double work = 0;
  CurvePoint last = law.fold(spring);
  std::puts("z,overlap,load,energy");
  for (double z = last.held(spring); z <= 3; z += 1e-3) {
    const CurveSolution s = law.solve(z, spring);
    if (s.status != CurveStatus::kOk) return 1;
    work += 0.5 * (s.point.load + last.load) * (s.point.overlap - last.overlap);
    worst = std::max({worst, std::abs(s.point.held(spring) - z), std::abs(work - s.point.energy)});
    last = s.point;
    std::printf("%.3f,%.6f,%.6f,%.6f\n", z, last.overlap, last.load, last.energy);
  }
  std::fprintf(stderr, "balance and work against theory: %.1e\n", worst);
  return worst < 1e-5 ? 0 : 1;  // the trapezium's error: 1e-3 steps of a parabola
}

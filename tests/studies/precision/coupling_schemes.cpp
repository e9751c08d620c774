// Growth factors of an extension e against a linear contact F = s δ at a resting end (F = −s e up to a
// constant):
//   explicit       b (e⁺ − e)/dt + k e = −s e          g = 1 − (k + s) dt/b        |g| < 1:  s < 2b/dt − k
//   semi-implicit  b (e⁺ − e)/dt + k e⁺ = −s e         g = (b/dt − s)/(b/dt + k)   |g| < 1:  s < 2b/dt + k
//   implicit       b (e⁺ − e)/dt + k e⁺ = −s e⁺        g = (b/dt)/(b/dt + k + s)   always
// Newton's method solves the implicit equation of a linear contact in one iteration; n matters where F bends.
#include "tests/studies/precision/coupling_schemes.h"

#include <algorithm>
#include <cmath>

namespace telenano::studies {

std::vector<CouplingScheme> coupling_schemes() {
  std::vector<CouplingScheme> all;
  all.push_back({"explicit", "1 force a step", false,
                 [](double e, double before, double after, const CouplingStep& c, const ContactLaw& law) {
                   // The end has moved on by itself; the tip moves as the forces were.
                   (void)after;
                   if (c.damping == 0) return std::nan("");
                   return e + c.dt_s / c.damping * (law(before - e).force - c.stiffness * e);
                 },
                 [](const CouplingStep& c) { return std::max(0.0, 2 * c.damping / c.dt_s - c.stiffness); }});
  all.push_back({"semi-implicit", "1 force a step", false,
                 [](double e, double before, double after, const CouplingStep& c, const ContactLaw& law) {
                   (void)before;
                   const double b = c.damping / c.dt_s;
                   return (b * e + law(after - e).force) / (c.stiffness + b);
                 },
                 [](const CouplingStep& c) { return 2 * c.damping / c.dt_s + c.stiffness; }});
  for (const int n : {1, 2, 3, 5}) {
    all.push_back({"implicit, n Newton iterations", "n = " + std::to_string(n), n == 5,
                   [n](double e, double before, double after, const CouplingStep& c, const ContactLaw& law) {
                     (void)before;
                     const double b = c.damping / c.dt_s;
                     double next = e;
                     for (int i = 0; i < n; ++i) {
                       const ContactForce f = law(after - next);
                       const double residual = b * (next - e) + c.stiffness * next - f.force;
                       next -= residual / (b + c.stiffness + f.slope);
                     }
                     return next;
                   },
                   [](const CouplingStep&) { return HUGE_VAL; }});
  }
  return all;
}

bool is_stable(const CouplingScheme& scheme, const CouplingStep& step, double contact_stiffness) {
  const ContactLaw linear = [&](double overlap) {
    return ContactForce{contact_stiffness * overlap, contact_stiffness};
  };
  double e = 1;
  // Two thousand steps tell growth of 1e-4 a step (1.2) from decay.
  for (int i = 0; i < 2000 && std::isfinite(e); ++i) e = scheme.next(e, 0, 0, step, linear);
  return std::fabs(e) <= 1;
}

}  // namespace telenano::studies

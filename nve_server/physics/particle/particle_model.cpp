#include "telenano/nve_server/physics/particle/particle_model.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"

namespace telenano::physics {
namespace {

void require_of_particle(bool good, const char* what, const char* expected, double value) {
  if (good) return;
  throw UserError(std::string("particle: ") + what + " must be " + expected + ", not " +
                  std::to_string(value));
}

void check(const ContactFriction& friction) {
  const double tau = friction.shear_strength_gpa, g = friction.shear_modulus_gpa;
  require_of_particle(std::isfinite(tau) && tau >= 0.0, "shear strength", "finite and not negative (GPa)",
                      tau);
  require_of_particle(std::isfinite(g) && g >= 0.0, "shear modulus G*", "finite and not negative (GPa)", g);
  require_of_particle(tau == 0.0 || g > 0.0, "shear modulus G*",
                      "positive where there is a shear strength (GPa)", g);
  const double xi = friction.rolling_length_nm;
  require_of_particle(std::isfinite(xi) && xi >= 0.0, "rolling length", "finite and not negative (nm)", xi);
}

}  // namespace

ParticleModel::ParticleModel(std::shared_ptr<const Surface> the_surface, const ParticleParameters& p,
                             const ParticleGround& the_ground)
    : surface(std::move(the_surface)),
      ground{the_ground.tip, nullptr, the_ground.particle},
      parameters(p),
      laws{TipSampleLaw(p.tip_sample), TipSampleLaw(p.tip_particle), TipSampleLaw(p.particle_sample)},
      friction{p.tip_sample_friction, p.tip_particle_friction, p.particle_sample_friction} {
  require_of_particle(std::isfinite(p.tip_radius_nm) && p.tip_radius_nm > 0.0, "tip radius",
                      "positive and finite (nm)", p.tip_radius_nm);
  require_of_particle(std::isfinite(p.particle_radius_nm) && p.particle_radius_nm > 0.0, "radius",
                      "positive and finite (nm)", p.particle_radius_nm);
  require_of_particle(std::isfinite(p.drag_n_s_m) && p.drag_n_s_m > 0.0, "drag",
                      "positive and finite (N·s/m)", p.drag_n_s_m);
  for (const ContactFriction& f : friction) check(f);
  if (!ground[kTipSample] || !ground[kParticleSample])
    throw UserError("particle: expected a ground for both spheres");
  nominal_radius_nm[kTipSample] = p.tip_radius_nm;
  nominal_radius_nm[kTipParticle] =
      p.tip_radius_nm * p.particle_radius_nm / (p.tip_radius_nm + p.particle_radius_nm);
  nominal_radius_nm[kParticleSample] = p.particle_radius_nm;
  for (int i = 0; i < kParticleContacts; ++i) {
    pull_off_nn[i] = laws[i].pull_off_nn(nominal_radius_nm[i]);
    const ZeroLoad rest = zero_load(laws[i], nominal_radius_nm[i]);
    zero_load_radius_nm[i] = rest.contact_radius_nm;
    if (i == kTipSample) continue;
    const double smaller =
        i == kParticleSample ? p.particle_radius_nm : std::min(p.tip_radius_nm, p.particle_radius_nm);
    if (!(rest.overlap_nm < smaller)) {
      throw UserError(std::string("particle: so soft or so small that adhesion alone draws it ") +
                      std::to_string(rest.overlap_nm) + " nm into the " +
                      (i == kTipParticle ? "tip" : "sample") + ", expected less than the smaller radius, " +
                      std::to_string(smaller) + " nm");
    }
  }
  for (int i = 0; i < kParticleContacts; ++i) {
    level[i].log_radius = det_log(nominal_radius_nm[i]);
    // Between tip and particle no field says it.
    level[i].radius_nm = i == kTipParticle ? nominal_radius_nm[i] : det_exp(level[i].log_radius);
    level[i].at = at_radius(i, level[i].radius_nm);
  }
}

ParticleModel::AtRadius ParticleModel::at_radius(int contact, double radius_nm) const noexcept {
  AtRadius at;
  at.scales = laws[contact].scales(radius_nm);
  at.relative = radius_nm / nominal_radius_nm[contact];
  const double cbrt = at.relative == 1.0 ? 1.0 : det_cbrt(at.relative);
  at.zero_load_radius_nm = zero_load_radius_nm[contact] * cbrt * cbrt;
  return at;
}

ZeroLoad zero_load(const TipSampleLaw& law, double radius_nm) noexcept {
  const double unit_nm = law.scales(radius_nm).overlap_nm;
  TipSampleState deep;
  double high = 2.0 * unit_nm;
  while (law.advance(high, 0.0, radius_nm, deep).force_nn <= 0.0 && high < 1e6 * unit_nm) high *= 2.0;
  // The force rises along the branch where it is repulsive, so halving finds where it begins.
  double low = high - 100.0 * unit_nm;
  ZeroLoad out;
  for (int i = 0; i < 200; ++i) {
    const double mid = 0.5 * (low + high);
    if (mid <= low || mid >= high) break;
    TipSampleState at = deep;
    (law.advance(mid, 0.0, radius_nm, at).force_nn < 0.0 || at.branch != Branch::kContact ? low : high) = mid;
  }
  out.law = deep;
  const Equilibrium rest = law.advance(high, 0.0, radius_nm, out.law);
  out.overlap_nm = high;
  out.contact_radius_nm = rest.contact_radius_nm;
  out.potential_aj = rest.potential_aj;
  return out;
}

}  // namespace telenano::physics

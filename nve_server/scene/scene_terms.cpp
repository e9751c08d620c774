#include "telenano/nve_server/scene/scene_terms.h"

#include <functional>
#include <utility>

#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/potential/branch_potential.h"
#include "telenano/nve_server/physics/surface/flat_surface.h"
#include "telenano/nve_server/scene/readers.h"

namespace telenano::scene {
namespace {

using Change = std::function<void(Scene&)>;

std::shared_ptr<const Scene> changed(const Scene& scene, const Change& change) {
  auto copy = std::make_shared<Scene>(scene);
  change(*copy);
  make_level(*copy);
  if (copy->surface->is_flat()) {
    copy->potential.reset();
    copy->particle_ground.reset();
    if (copy->particle) make_level_ground(*copy);
  } else {
    // The ground is the same; law and friction are what has changed.
    const double radius = copy->probe.tip_radius_nm;
    copy->potential = std::make_shared<physics::PotentialEquilibrium>(
        scene.potential->shared_fields(),
        std::make_shared<physics::BranchPotential>(physics::TipSampleLaw(copy->law_parameters, radius),
                                                   radius),
        copy->friction);
  }
  const double height = scene.start_apex_w_nm.z() - scene.start_touch_w_nm;
  const Vec3& start = scene.start_apex_w_nm;
  copy->start_touch_w_nm = copy->touch_height_nm(start.x(), start.y());
  copy->start_apex_w_nm.z() = copy->start_touch_w_nm + height;
  return copy;
}

physics::ModeParameters parameters_of(const physics::ProbeMode& mode) {
  return {mode.frequency_hz(), mode.quality()};
}

// Upright, as stiff along z, nothing sideways.
void without_lateral_bending(Scene& scene) {
  physics::ProbeParameters p;
  p.stiffness_n_m = 1.0 / scene.cantilever.compliance_nm_nn()(2, 2);
  if (const auto& mode = scene.cantilever.mode()) p.mode = parameters_of(*mode);
  scene.cantilever = physics::Probe(p);
}

// Along z and sideways as before without cross terms: what is left of the cost is the mode's.
void without_mode(Scene& scene) {
  const physics::Compliance& c = scene.cantilever.compliance_nm_nn();
  physics::ProbeParameters p;
  p.stiffness_n_m = 1.0 / c(2, 2);
  if (c(0, 0) > 0) p.lateral_stiffness_n_m = 1.0 / c(0, 0);
  if (c(1, 1) > 0) p.longitudinal_stiffness_n_m = 1.0 / c(1, 1);
  scene.cantilever = physics::Probe(p);
}

// Flat, and as wide as before.
void without_surface(Scene& scene) {
  scene.surface = std::make_shared<physics::FlatSurface>();
  scene.ground.spacing_nm = 0;
  scene.marks.reset();
}

}  // namespace

std::vector<WithoutTerm> without_each_term(const Scene& scene) {
  std::vector<WithoutTerm> all;
  const auto leave_out = [&](bool in, const char* term, const Change& change) {
    if (in) all.push_back({term, changed(scene, change)});
  };
  const physics::TipSampleParameters& law = scene.law_parameters;
  const physics::LongRangeParameters& far = law.long_range;
  const physics::Compliance& lever = scene.cantilever.compliance_nm_nn();
  leave_out(law.van_der_waals, "van der Waals", [](Scene& s) {
    s.law_parameters.van_der_waals = false;
    s.law_parameters.long_range.retardation_nm = 0;
  });
  leave_out(far.retardation_nm > 0, "retardation",
            [](Scene& s) { s.law_parameters.long_range.retardation_nm = 0; });
  leave_out(far.cone_height_nm > 0, "cone", [](Scene& s) {
    s.law_parameters.long_range.cone_half_angle_deg = s.law_parameters.long_range.cone_height_nm = 0;
  });
  leave_out(far.capillary.humidity_percent > 0 || far.capillary.volume_nm3 > 0, "capillary bridge",
            [](Scene& s) { s.law_parameters.long_range.capillary = {}; });
  leave_out(far.tip_bias_v != 0, "electrostatic",
            [](Scene& s) { s.law_parameters.long_range.tip_bias_v = 0; });
  leave_out(scene.friction.has_value(), "friction", [](Scene& s) { s.friction.reset(); });
  leave_out(lever(0, 0) > 0 || lever(1, 1) > 0, "lateral bending", without_lateral_bending);
  leave_out(scene.cantilever.mode().has_value(), "first mode", without_mode);
  leave_out(scene.marks.has_value(), "yield and marks", [](Scene& s) { s.marks.reset(); });
  leave_out(scene.particle.has_value(), "particle", [](Scene& s) { s.particle.reset(); });
  leave_out(!scene.surface->is_flat(), "one potential of tip and ground", without_surface);
  return all;
}

}  // namespace telenano::scene

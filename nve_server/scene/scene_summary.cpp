#include "telenano/nve_server/scene/scene_summary.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/law/pull_off.h"
#include "telenano/nve_server/physics/long_range/long_range.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"

namespace telenano::scene {
namespace {

constexpr double kHalfSpaceRatio = 0.5;       // a/R beyond which contact on a half-space is formal
constexpr double kTheoreticalYield = 0.1;     // hardness of the hardest solids over Young's modulus
constexpr double kRubberPoissonRatio = 0.48;  // incompressible: stretches, does not yield
constexpr double kSamplesPerRadius = 2;       // fewer, and the scan cannot show what the tip would feel
constexpr double kLinearPart = 0.1;           // of the length: beyond, a beam's deflection is not linear
constexpr double kOpticalRange_nm = 1000;  // what an optical lever follows linearly, where no length is known
constexpr double kVisibleMark_nm = 0.1;    // less is within an atom
constexpr double kHoldHeight_nm = 10;      // of positioning above the sample (Kim & Sitti, task a)
constexpr int kPlacesAlong = 20;           // of the sample where the pull-off is looked at
constexpr int kPlacesAlongTiles = 10;      // where each place must be made first
constexpr double kMeniscusError = 0.1;     // of its pull-off, beyond which a meniscus that deforms nothing is

template <class... Values>
std::string line(const char* format, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

// Pressed from above with no film: has a bridge formed?
bool forms_in_contact(const physics::TipSampleLaw& law, double radius) {
  physics::TipSampleParameters p = law.parameters();
  p.long_range.capillary.film_nm = 0;
  const physics::TipSampleLaw bare(p);
  physics::TipSampleState state;
  bare.advance(-1e3, 0.0, radius, state);
  return bare.advance(0.1 * law.scales(radius).overlap_nm, 0.0, radius, state).bridge;
}

void list_terms(const Scene& scene, SceneSummary& summary) {
  const physics::TipSampleParameters& law = scene.law_parameters;
  const physics::LongRangeParameters& far = law.long_range;
  const auto term = [&](bool in, const std::string& name) {
    (in ? summary.terms_in : summary.terms_out).push_back(name);
  };
  const bool flat = scene.surface->is_flat();
  summary.terms_in.push_back(std::string(physics::contact_law_name(law.model)) +
                             (law.method == physics::MaugisMethod::kTable ? " contact (table)" : " contact"));
  term(law.van_der_waals, "van der Waals");
  term(far.retardation_nm > 0, "retardation");
  term(far.cone_height_nm > 0, "cone");
  term(far.capillary.humidity_percent > 0 || far.capillary.volume_nm3 > 0, "capillary bridge");
  term(far.tip_bias_v != 0, "electrostatic");
  term(scene.friction.has_value(), "friction");
  term(!scene.cantilever.rigid(), "cantilever");
  const physics::Compliance probe = scene.probe_compliance_nm_nn();
  term(probe(0, 0) > 0 || probe(1, 1) > 0, "lateral bending");
  term(scene.cantilever.mode().has_value(), "first mode");
  term(!flat, "one potential of tip and ground, the scan dilated by the tip");
  term(scene.marks.has_value(), "yield and marks");
  term(scene.particle.has_value(), "particle");
  term(scene.coupling.damping_n_s_m > 0, "coupling damper");
}

// By pressing a soft spring (nearly load control) to the force limit and letting go again.
void press(const Scene& scene, SceneSummary& summary) {
  const physics::TipSampleLaw& law = scene.law();
  const double radius = scene.probe.tip_radius_nm;
  const double limit = scene.limits.force_max_nn;
  const double compliance = 1e4 * radius / limit;
  physics::TipSampleState state;
  // F = (base − delta)/c: this base gives the limit but for delta, which is small beside it.
  auto eq = law.advance(compliance * limit, compliance, radius, state);
  summary.radius_at_limit_nm = eq.contact_radius_nm;
  summary.overlap_at_limit_nm = eq.overlap_nm;
  summary.stiffness_at_limit_n_m = eq.stiffness_n_m;
  if (eq.contact_radius_nm > 0) {
    summary.pressure_at_limit_gpa = eq.force_nn / (kPi * eq.contact_radius_nm * eq.contact_radius_nm);
  }
  const double port = scene.port_compliance_nm_nn()(2, 2);
  summary.shown_stiffness_n_m = 1.0 / (port + (eq.stiffness_n_m > 0 ? 1.0 / eq.stiffness_n_m : 0.0));
  summary.deflection_at_limit_nm = limit * scene.probe_compliance_nm_nn()(2, 2);
  eq = law.advance(0.0, compliance, radius, state);
  if (eq.branch == physics::Branch::kContact) summary.unloaded_radius_nm = eq.contact_radius_nm;
  summary.lambda = law.lambda(radius);
  summary.dry_contact_pull_off_nn = law.pull_off_nn(radius);
  summary.pull_off_nn = physics::total_pull_off_nn(law, radius);
}

// Where the tip would part at places all over the sample: the law at the radius that it has there.
void pull_offs(const Scene& scene, SceneSummary& summary) {
  if (scene.surface->is_flat()) return;
  const SurfaceDescription& ground = scene.ground;
  std::vector<double> radii;
  const auto* const fields = dynamic_cast<const physics::ScanFields*>(&scene.potential->fields());
  const bool tiled = fields != nullptr && fields->tiled();
  if (tiled) fields->wish_nothing(true);
  const int along = tiled ? kPlacesAlongTiles : kPlacesAlong;
  for (int i = 0; i < along; ++i) {
    for (int j = 0; j < along; ++j) {
      const double x = ground.x_min_nm + (ground.x_max_nm - ground.x_min_nm) * (i + 0.5) / along;
      const double y = ground.y_min_nm + (ground.y_max_nm - ground.y_min_nm) * (j + 0.5) / along;
      physics::ContactJet at;
      // Touch is at the finest softening: no other tiles need be made.
      const double touch = tiled ? fields->touch_height_nm(x, y) : scene.touch_height_nm(x, y);
      scene.potential->fields().contact_at(Vec3(x, y, touch), at);
      radii.push_back(det_exp(at.log_radius));
    }
  }
  if (tiled) fields->wish_nothing(false);
  // It grows with the radius: the radii tell the order.
  std::sort(radii.begin(), radii.end());
  const auto radius_at = [&](double part) {
    return radii[static_cast<std::size_t>(part * static_cast<double>(radii.size() - 1))];
  };
  const auto at = [&](double part) { return physics::total_pull_off_nn(scene.law(), radius_at(part)); };
  summary.radius_low_nm = radius_at(0.05);
  summary.radius_median_nm = radius_at(0.5);
  summary.radius_high_nm = radius_at(0.95);
  summary.pull_off_places = static_cast<int>(radii.size());
  summary.pull_off_low_nn = at(0.05);
  summary.pull_off_median_nn = at(0.5);
  summary.pull_off_high_nn = at(0.95);
}

// What the fields of a scan are known to be wrong by: against boundary elements of an elastic half-space with
// Lennard-Jones adhesion at 116 and 100 places of two scans, 16 of each made steep and 12 of one made soft
// (tests/data/elastic; `telenano-lab precision --only ground` makes the figures anew),
// a tip of 20 nm on silicon oxide, λ = 0.74; van der Waals against the proximity sum (unit_physics_fields).
// Of any other ground this says nothing.
void list_model_errors(const Scene& scene, SceneSummary& summary) {
  if (!(scene.ground.spacing_nm > 0)) return;  // closed forms
  // wsxm_600nm.gsf and nanoscope_peakforce_1um.gsf of deploy/data, as their files are.
  constexpr std::uint64_t kComparedScans[2] = {0x5bfe659be61385c4, 0x776162f8c2da2f34};
  constexpr double kCalibratedLambda[2] = {0.35, 1.5};
  constexpr double kCalibratedRadius_nm[2] = {10, 40};
  static constexpr const char* kFound[] = {
      "pull-off 1 to 2 % in the median, 5 % at one place in ten, 30 % at the worst",
      "pressed 0.2 to 0.8 nm: 3 to 6 % of the rms force; deeper: not compared",
      "van der Waals 1 to 16 nm above: at most 6 to 10 % in the median of the proximity sum",
      "slopes of 30 to 45 degrees: pull-off 4 to 5 % in the median, 12 to 20 % at one place in ten; pressed "
      "12 to 32 %",
      "soft sample (lambda 2.2): pull-off 2 % in the median, 4 % at one place in ten; pressed 10 %",
      "bias near touch, slopes of 15 to 30 degrees under load: not compared",
      "from elastic boundary elements with Lennard-Jones adhesion, 20 nm tip on silicon oxide (lambda 0.74), "
      "216 places of two scans, 32 steep and 12 soft ones"};
  std::vector<std::string>& all = summary.model_errors;
  const double radius = scene.probe.tip_radius_nm;
  const bool like = summary.lambda > kCalibratedLambda[0] && summary.lambda < kCalibratedLambda[1] &&
                    radius >= kCalibratedRadius_nm[0] && radius <= kCalibratedRadius_nm[1];
  if (std::ranges::count(kComparedScans, scene.ground.scan_hash) == 0) {
    all.push_back("not compared on this ground: the force here was not compared with elasticity");
  } else if (!like) {
    all.push_back(
        line("not compared on this ground with such a tip and sample (lambda %.3g, tip %g nm): the force was "
             "compared with elasticity for lambda 0.74 and a tip of 20 nm",
             summary.lambda, radius));
  } else {
    all.assign(std::begin(kFound), std::end(kFound));
  }
  const double widest = std::max(summary.unloaded_radius_nm, summary.radius_at_limit_nm);
  if (widest > kHalfSpaceRatio * radius) {
    all.push_back(line("formal where the contact is wider than half the tip's radius: it reaches a/R = %.3g",
                       widest / radius));
  }
  if (const auto* fields = dynamic_cast<const physics::ScanFields*>(&scene.potential->fields())) {
    const double foot = std::sqrt(radius * fields->rule().finest_nm);
    if (scene.ground.spacing_nm > foot) {
      all.push_back(
          line("the samples are %.3g nm apart, and the contact at pull-off averages over %.3g nm: detail "
               "between the samples comes from the spline, not from the ground",
               scene.ground.spacing_nm, foot));
    }
  }
}

// A meniscus is an adhesive layer of its own: stress gamma/r, range 2 r c, work 2 gamma c, and so with
// Maugis' lambda. The law has it act on rigid bodies (lambda = 0), 2 pi R times its work; bodies that it
// deforms part at less.
void warn_of_bridge(const Scene& scene, SceneSummary& summary) {
  const physics::TipSampleLaw& law = scene.law();
  const physics::CapillaryParameters& water = scene.law_parameters.long_range.capillary;
  const double liquid = physics::Capillary::adhesion_n_m(water);
  if (!(liquid > 0)) return;
  const double dry = scene.law_parameters.work_of_adhesion_n_m;
  std::vector<std::string>& warnings = summary.warnings;
  if (!(dry - liquid > 0)) {
    warnings.push_back(
        line("work of adhesion and contact angles contradict each other: under the liquid w - 2 gamma c = "
             "%.3g - %.3g = %.3g J/m2 would be negative; %g J/m2 is used instead. Give larger angles, or "
             "[contact] work_of_adhesion_j_m2",
             dry, liquid, dry - liquid, law.media().wet.work_of_adhesion_n_m()));
  }
  const physics::Capillary& bridge = law.long_range().capillary();
  if (!bridge.active()) {
    warnings.push_back(
        line("no liquid bridge forms at a humidity of %g %%: the meniscus would reach no farther than the "
             "attraction that it displaces",
             water.humidity_percent));
    return;
  }
  const double radius = scene.probe.tip_radius_nm;
  if (!forms_in_contact(law, radius)) {
    warnings.push_back(
        "no liquid bridge forms in contact: with liquid round it the contact would have more energy than "
        "without; bridges form only where the adsorbed films meet (film_nm)");
  }
  if (!(bridge.kelvin_radius_nm() > 0)) return;
  const double stress = water.surface_tension_n_m / bridge.kelvin_radius_nm();
  const double k = scene.law_parameters.contact_modulus_gpa;
  const double lambda = 2.0 * stress * det_cbrt(radius / (kPi * liquid * k * k));
  const double pull_off = -physics::MaugisDugdale(lambda).fold({0.0, 1.0}).load;
  const double error = 1.0 - 0.5 * pull_off;
  if (error > kMeniscusError) {
    warnings.push_back(
        line("the meniscus would deform this sample (the lambda of the meniscus is %.3g): the law keeps its "
             "force constant in contact, which is up to %.0f %% too much",
             lambda, 100.0 * (2.0 / pull_off - 1.0)));
  }
}

void warn(const Scene& scene, SceneSummary& summary) {
  std::vector<std::string>& warnings = summary.warnings;
  const double radius = scene.probe.tip_radius_nm;
  const double widest = std::max(summary.unloaded_radius_nm, summary.radius_at_limit_nm);
  if (widest > kHalfSpaceRatio * radius) {
    warnings.push_back(
        line("contact radius over tip radius reaches %.3g > %g: half-space contact theory is not valid there",
             widest / radius, kHalfSpaceRatio));
  }
  const double pressure = summary.pressure_at_limit_gpa;
  const bool rubber = scene.sample.poisson_ratio > kRubberPoissonRatio;
  const double ideal = kTheoreticalYield * scene.sample.youngs_modulus_gpa;
  if (scene.marks && pressure > scene.marks->hardness_gpa) {
    warnings.push_back(
        line("mean pressure at the force limit would be %.3g GPa, above the hardness of %g GPa: the sample "
             "yields before that, and marks stay",
             pressure, scene.marks->hardness_gpa));
  } else if (!scene.marks && !rubber && pressure > ideal) {
    warnings.push_back(
        line("mean pressure at the force limit is %.3g GPa, above a tenth of Young's modulus: such a "
             "sample yields; give [sample] hardness_gpa, or a lower force_max_nn",
             pressure));
  }
  if (scene.marks) {
    const physics::PlasticContact plastic(scene.law(), scene.marks->hardness_gpa);
    const double depth = plastic.zero_load_depth_nm(radius);
    if (depth > kVisibleMark_nm) {
      warnings.push_back(
          line("adhesion alone, without load, presses the tip into this sample: every touch leaves a mark "
               "of %.2g nm",
               depth));
    }
  }
  if (scene.ground.spacing_nm > 0 && kSamplesPerRadius * scene.ground.spacing_nm > radius) {
    warnings.push_back(
        line("for the tip (radius %g nm) the surface's spacing of %.3g nm is too coarse: it would feel "
             "interpolated ground between the samples",
             radius, scene.ground.spacing_nm));
  }
  if (summary.pull_off_high_nn > scene.limits.force_max_nn) {
    warnings.push_back(
        line("where the sample fits the tip best, the pull-off is %.4g nN, above force_max_nn = %g: the tip "
             "could not come off there",
             summary.pull_off_high_nn, scene.limits.force_max_nn));
  }
  const auto& length = scene.probe.length_nm;
  const double range = length ? kLinearPart * *length : kOpticalRange_nm;
  warn_of_bridge(scene, summary);
  if (summary.deflection_at_limit_nm > range) {
    warnings.push_back(
        line("the cantilever bends by %.4g nm at the force limit, beyond its linear range of %.4g nm",
             summary.deflection_at_limit_nm, range));
  }
  if (summary.jump_to_contact_nm > kHoldHeight_nm) {
    warnings.push_back(
        line("the tip jumps to contact from a gap of %.3g nm, above the hold height of %g nm: holding "
             "there needs a stiffer probe",
             summary.jump_to_contact_nm, kHoldHeight_nm));
  }
}

double jump_to_contact_nm(const Scene& scene) {
  const double compliance = scene.port_compliance_nm_nn()(2, 2);
  if (!(compliance > 0)) return 0.0;
  const physics::TipSampleParameters& p = scene.law_parameters;
  const auto van_der_waals =
      p.van_der_waals ? physics::VanDerWaals::from_adhesion(p.work_of_adhesion_n_m, p.equilibrium_distance_nm)
                      : physics::VanDerWaals{};
  const physics::LongRange long_range(p.long_range, van_der_waals.hamaker_aj, p.equilibrium_distance_nm);
  return physics::jump_to_contact_gap_nm(van_der_waals, long_range, p.equilibrium_distance_nm,
                                         1.0 / compliance, scene.probe.tip_radius_nm);
}

}  // namespace

SceneSummary summarise(const Scene& scene) {
  SceneSummary summary;
  list_terms(scene, summary);
  press(scene, summary);
  pull_offs(scene, summary);
  summary.jump_to_contact_nm = jump_to_contact_nm(scene);
  list_model_errors(scene, summary);
  warn(scene, summary);
  return summary;
}

}  // namespace telenano::scene

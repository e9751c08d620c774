#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/law/pull_off.h"
#include "telenano/nve_server/scene/readers.h"

namespace telenano::scene {
namespace {

using config::between;
using config::TomlTable;

constexpr double kGpaPerMpa = 1e-3;

constexpr double kLeastDistance_nm = 0.05;
constexpr double kGreatestDistance_nm = 2.0;

/// The Hamaker constant, where it is given, holds whatever w is.
void take_distance(std::optional<double> hamaker_aj, physics::TipSampleParameters& law) {
  if (!hamaker_aj) return;
  law.equilibrium_distance_nm = physics::VanDerWaals::cut_off_nm(*hamaker_aj, law.work_of_adhesion_n_m);
}

void read_contact(const TomlTable& table, Scene& scene) {
  physics::TipSampleParameters& law = scene.law_parameters;
  std::vector<std::string> laws;
  for (const physics::ContactLaw one : physics::kContactLaws)
    laws.emplace_back(physics::contact_law_name(one));
  const std::string name = table.choice_or("law", laws, "maugis-dugdale");
  law.model = *physics::contact_law_from_name(name);
  const std::string method = table.choice_or("method", {"direct", "table"}, "direct");
  if (method == "table" && law.model != physics::ContactLaw::kMaugisDugdale) {
    table.fail("method", "only maugis-dugdale has a table; the others are closed forms");
  }
  law.method = method == "table" ? physics::MaugisMethod::kTable : physics::MaugisMethod::kDirect;
  const auto distance =
      table.optional_number("equilibrium_distance_nm", between(kLeastDistance_nm, kGreatestDistance_nm));
  law.equilibrium_distance_nm = distance.value_or(law.equilibrium_distance_nm);
  law.work_of_adhesion_n_m =
      table.number_or("work_of_adhesion_j_m2", between(1e-6, 20.0), law.work_of_adhesion_n_m);
  scene.hamaker_aj = table.optional_number("hamaker_aj", between(1e-7, 1e4));
  if (!scene.hamaker_aj) return;
  if (distance)
    table.fail("hamaker_aj",
               "determines the equilibrium distance as well (H = 12 pi z0^2 w): give one of them");
  take_distance(scene.hamaker_aj, law);
}

physics::CapillaryParameters read_capillary(const TomlTable& table) {
  physics::CapillaryParameters capillary;
  capillary.humidity_percent = table.number("humidity_percent", {0.0, 99.0, true, false});
  const auto angle = config::Range{0.0, 90.0, false, true};
  capillary.contact_angle_tip_deg = table.number_or("contact_angle_tip_deg", angle, 0.0);
  capillary.contact_angle_sample_deg = table.number_or("contact_angle_sample_deg", angle, 0.0);
  capillary.surface_tension_n_m =
      table.number_or("surface_tension_n_m", between(1e-4, 1.0), capillary.surface_tension_n_m);
  const std::string model =
      table.choice_or("model", {"constant-curvature", "constant-volume"}, "constant-curvature");
  capillary.model = model == "constant-volume" ? physics::CapillaryModel::kConstantVolume
                                               : physics::CapillaryModel::kConstantCurvature;
  if (const auto volume = table.optional_number("volume_nm3", config::positive(1e9))) {
    if (capillary.model != physics::CapillaryModel::kConstantVolume) {
      table.fail("volume_nm3", "works only with model = \"constant-volume\"");
    }
    capillary.volume_nm3 = *volume;
  }
  capillary.film_nm = table.number_or("film_nm", between(0.0, 100.0), 0.0);
  return capillary;
}

// The work of adhesion of the dry contact that parts, with the liquid round it, at the force at which a
// contact of `law` alone does: what was measured as a pull-off in this very air has the bridge in it.
double dry_work_of_adhesion(const TomlTable& capillary, physics::TipSampleParameters law,
                            std::optional<double> hamaker_aj, double radius_nm) {
  constexpr double kBracket = 4.0;
  constexpr double kFound = 1e-6;
  physics::LongRangeParameters water;
  water.capillary = law.long_range.capillary;
  law.long_range = {};
  const double measured = physics::TipSampleLaw(law).pull_off_nn(radius_nm);
  law.long_range = water;
  const double given = law.work_of_adhesion_n_m;
  double low = given / kBracket;
  double high = given * kBracket;
  double found = 0;
  for (int i = 0; i < 60 && high - low > 1e-12 * given; ++i) {
    law.work_of_adhesion_n_m = 0.5 * (low + high);
    take_distance(hamaker_aj, law);
    found = physics::total_pull_off_nn(physics::TipSampleLaw(law), radius_nm);
    (found < measured ? low : high) = law.work_of_adhesion_n_m;
  }
  if (!(std::abs(found - measured) <= kFound * measured)) {
    capillary.fail("adhesion",
                   "\"ambient\" finds no dry work of adhesion whose pull-off in this air is that "
                   "of [contact] work_of_adhesion_j_m2; give the dry one");
  }
  return law.work_of_adhesion_n_m;
}

void read_long_range(const TomlTable& table, Scene& scene) {
  physics::TipSampleParameters& law = scene.law_parameters;
  law.van_der_waals = table.boolean_or("van_der_waals", law.van_der_waals);
  physics::LongRangeParameters& far = law.long_range;
  const auto retardation = table.optional_number("retardation_nm", between(1.0, 1e4));
  if (retardation && !law.van_der_waals) {
    table.fail("retardation_nm", "weakens van der Waals forces, which this scene switches off");
  }
  far.retardation_nm = retardation.value_or(0.0);
  const auto cone = table.optional_number("cone_half_angle_deg", {0.0, 80.0, true, false});
  const auto height = table.optional_number("cone_height_nm", config::positive(1e6));
  if (cone.has_value() != height.has_value()) {
    table.fail(cone ? "cone_height_nm" : "cone_half_angle_deg", "missing; a cone has both");
  }
  far.cone_half_angle_deg = cone.value_or(0.0);
  far.cone_height_nm = height.value_or(0.0);
  if (const auto electrostatic = table.optional_table("electrostatic")) {
    far.tip_bias_v = electrostatic->number("tip_bias_v", between(-100.0, 100.0));
  }
  if (const auto capillary = table.optional_table("capillary")) {
    far.capillary = read_capillary(*capillary);
    const bool ambient = capillary->choice_or("adhesion", {"dry", "ambient"}, "dry") == "ambient";
    const bool possible = law.model == physics::ContactLaw::kMaugisDugdale &&
                          law.method == physics::MaugisMethod::kDirect;  // else refused below
    if (ambient && possible) {
      law.work_of_adhesion_n_m =
          dry_work_of_adhesion(*capillary, law, scene.hamaker_aj, scene.probe.tip_radius_nm);
      take_distance(scene.hamaker_aj, law);
    }
  }
}

physics::FrictionParameters read_friction(const TomlTable& table, const Scene& scene) {
  physics::FrictionParameters friction;
  friction.shear_strength_gpa = kGpaPerMpa * table.number_or("shear_strength_mpa", between(0.0, 1e5), 0.0);
  friction.coefficient = table.number_or("coefficient", between(0.0, 10.0), 0.0);
  if (!(friction.shear_strength_gpa > 0 || friction.coefficient > 0)) {
    table.fail("shear_strength_mpa", "missing; friction needs a shear strength, or a coefficient, above 0");
  }
  friction.kinetic_ratio = table.number_or("kinetic_ratio", {0.0, 1.0, true, false}, 1.0);
  friction.shear_modulus_gpa = contact_shear_modulus_gpa(scene.sample, scene.probe.tip);
  return friction;
}

}  // namespace

void read_forces(const TomlTable& root, Scene& scene) {
  physics::TipSampleParameters& law = scene.law_parameters;
  law.contact_modulus_gpa = contact_modulus_gpa(scene.sample, scene.probe.tip);
  law.work_of_adhesion_n_m = work_of_adhesion_j_m2(scene.sample, scene.probe.tip);
  const auto contact = root.optional_table("contact");
  if (contact) read_contact(*contact, scene);
  if (const auto forces = root.optional_table("forces")) read_long_range(*forces, scene);
  if (scene.hamaker_aj) {
    if (!law.van_der_waals)
      contact->fail("hamaker_aj", "belongs to van der Waals forces, which this scene switches off");
    if (!(law.equilibrium_distance_nm >= kLeastDistance_nm &&
          law.equilibrium_distance_nm <= kGreatestDistance_nm)) {
      contact->fail("hamaker_aj",
                    "makes an equilibrium distance of " + std::to_string(law.equilibrium_distance_nm) +
                        " nm with the work of adhesion (z0^2 = H/(12 pi w)), expected 0.05 to 2 nm");
    }
  }
  if (law.model == physics::ContactLaw::kHertz && law.van_der_waals) {
    root.fail("contact",
              "law = \"hertz\" has no adhesion: give [forces] van_der_waals = false, or law = \"dmt\"");
  }
  const physics::LongRangeParameters& far = law.long_range;
  const bool extended = far.retardation_nm > 0 || far.cone_height_nm > 0 || far.tip_bias_v != 0 ||
                        far.capillary.humidity_percent > 0;
  if (extended &&
      (law.model != physics::ContactLaw::kMaugisDugdale || law.method == physics::MaugisMethod::kTable)) {
    root.fail("contact",
              "retardation, cone, electrostatic and capillary forces need law = \"maugis-dugdale\", method = "
              "\"direct\"");
  }
  if (const auto friction = root.optional_table("friction")) scene.friction = read_friction(*friction, scene);
}

}  // namespace telenano::scene

#include <string>

#include "telenano/nve_server/scene/readers.h"

namespace telenano::scene {
namespace {

using config::between;
using config::TomlTable;

constexpr double kNmPerUm = 1e3;

physics::BeamParameters read_beam(const TomlTable& beam) {
  physics::BeamParameters parameters;
  parameters.youngs_modulus_gpa = beam.number("youngs_modulus_gpa", kModulus_gpa);
  parameters.poisson_ratio = beam.number_or("poisson_ratio", {-1.0, 0.5, true, false}, 0.27);
  parameters.width_nm = kNmPerUm * beam.number("width_um", between(0.01, 1e4));
  parameters.thickness_nm = kNmPerUm * beam.number("thickness_um", between(0.01, 1e3));
  parameters.length_nm = kNmPerUm * beam.number("length_um", between(0.1, 1e4));
  parameters.tip_height_nm = kNmPerUm * beam.number_or("tip_height_um", between(0.1, 1e3), 12.0);
  return parameters;
}

}  // namespace

// Exactly one of: rigid = true, stiffness_n_m, [probe.beam].
void read_probe(const TomlTable& table, Scene& scene) {
  Probe& probe = scene.probe;
  probe.tip_radius_nm = table.number("tip_radius_nm", between(1.0, 1e4));
  probe.tip = read_material(table.table("tip"));
  physics::ProbeParameters parameters;
  parameters.rigid = table.boolean_or("rigid", false);
  parameters.stiffness_n_m = table.optional_number("stiffness_n_m", kStiffness_n_m);
  const auto beam = table.optional_table("beam");
  const int given = (parameters.rigid ? 1 : 0) + (parameters.stiffness_n_m ? 1 : 0) + (beam ? 1 : 0);
  if (given != 1) {
    table.fail("stiffness_n_m", given == 0
                                    ? "missing; expected one of stiffness_n_m, [probe.beam] or rigid = true"
                                    : "give only one of stiffness_n_m, [probe.beam] and rigid = true");
  }
  parameters.lateral_stiffness_n_m = table.optional_number("lateral_stiffness_n_m", kStiffness_n_m);
  parameters.longitudinal_stiffness_n_m = table.optional_number("longitudinal_stiffness_n_m", kStiffness_n_m);
  const bool sideways = parameters.lateral_stiffness_n_m || parameters.longitudinal_stiffness_n_m;
  if (sideways && !parameters.stiffness_n_m) {
    table.fail(parameters.lateral_stiffness_n_m ? "lateral_stiffness_n_m" : "longitudinal_stiffness_n_m",
               "works only with stiffness_n_m; a beam has its own");
  }
  const auto tilt = table.optional_number("tilt_deg", between(0.0, 45.0));
  const std::string points = table.choice_or("points", {"+y", "-y"}, "+y");
  const auto mode = table.optional_table("mode");
  if (parameters.rigid && (tilt || mode)) {
    table.fail(tilt ? "tilt_deg" : "mode", "a rigid probe has none");
  }
  parameters.tilt_deg = tilt.value_or(0.0);
  parameters.points = points == "+y" ? physics::ProbePoints::kPlusY : physics::ProbePoints::kMinusY;
  if (mode) {
    parameters.mode = physics::ModeParameters{1e3 * mode->number("frequency_khz", between(0.1, 1e4)),
                                              mode->number("quality", between(0.6, 1e6))};
  }
  if (beam) {
    parameters.beam = read_beam(*beam);
    probe.length_nm = parameters.beam->length_nm;
    probe.origin = "rectangular beam";
  } else {
    probe.origin = parameters.rigid ? "rigid" : "given";
  }
  scene.cantilever = physics::Probe(parameters);
  if (beam && !kStiffness_n_m.contains(scene.cantilever.stiffness_n_m())) {
    table.fail("beam", "gives a stiffness of " + std::to_string(scene.cantilever.stiffness_n_m()) +
                           " N/m, expected one " + kStiffness_n_m.text());
  }
}

}  // namespace telenano::scene

#include "telenano/nve_server/scene/readers.h"

namespace telenano::scene {
namespace {

using config::between;
using config::TomlTable;

constexpr double kGpaPerMpa = 1e-3;

physics::TipSampleParameters law_between(const Material& a, const Material& b,
                                         const physics::TipSampleParameters& like) {
  physics::TipSampleParameters parameters = like;
  parameters.contact_modulus_gpa = contact_modulus_gpa(a, b);
  parameters.work_of_adhesion_n_m = work_of_adhesion_j_m2(a, b);
  return parameters;
}

}  // namespace

void read_particle(const TomlTable& table, Scene& scene) {
  Particle particle;
  physics::ParticleParameters& p = particle.parameters;
  particle.material = read_material(table.table("material"));
  p.tip_radius_nm = scene.probe.tip_radius_nm;
  p.particle_radius_nm = table.number("radius_nm", between(1.0, 1e4));
  particle.x_nm = table.number("x_nm", between(-1e6, 1e6));
  particle.y_nm = table.number("y_nm", between(-1e6, 1e6));
  p.drag_n_s_m = table.number_or("drag_n_s_m", between(1e-12, 1.0), p.drag_n_s_m);
  p.tip_sample = scene.law_parameters;
  p.tip_particle = law_between(scene.probe.tip, particle.material, scene.law_parameters);
  p.particle_sample = law_between(particle.material, scene.sample, scene.law_parameters);
  if (scene.friction) {
    p.tip_sample_friction.shear_strength_gpa = scene.friction->shear_strength_gpa;
    p.tip_sample_friction.shear_modulus_gpa = scene.friction->shear_modulus_gpa;
  }
  if (const auto friction = table.optional_table("friction")) {
    const auto strength = between(0.0, 1e5);
    p.particle_sample_friction.shear_strength_gpa =
        kGpaPerMpa * friction->number_or("sample_shear_strength_mpa", strength, 0.0);
    p.particle_sample_friction.rolling_length_nm =
        friction->number_or("rolling_length_nm", between(0.0, 10.0), 0.0);
    p.tip_particle_friction.shear_strength_gpa =
        kGpaPerMpa * friction->number_or("tip_shear_strength_mpa", strength, 0.0);
  }
  p.particle_sample_friction.shear_modulus_gpa = contact_shear_modulus_gpa(particle.material, scene.sample);
  p.tip_particle_friction.shear_modulus_gpa = contact_shear_modulus_gpa(scene.probe.tip, particle.material);
  scene.particle = particle;
}

}  // namespace telenano::scene

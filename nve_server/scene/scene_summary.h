#pragma once

#include <string>
#include <vector>

#include "telenano/nve_server/scene/scene.h"

namespace telenano::scene {

/// What a scene computes, what to expect of it, and where its models end. For a flat patch of the sample at
/// the tip's own radius; a rough surface changes the radius.
struct SceneSummary {
  std::vector<std::string> terms_in;
  std::vector<std::string> terms_out;

  double lambda = 0;
  double pull_off_nn = 0;              ///< load control, on a flat, with all terms
  double dry_contact_pull_off_nn = 0;  ///< of the contact alone
  /// On a curved sample: at 5, 50 and 95 % of places over it, of the radius of curvature there.
  double pull_off_low_nn = 0, pull_off_median_nn = 0, pull_off_high_nn = 0;
  int pull_off_places = 0;  ///< 0: flat
  /// The effective radius at touch, at the same places.
  double radius_low_nm = 0, radius_median_nm = 0, radius_high_nm = 0;
  /// One line each, of a ground that is one potential: how far what is felt is from elasticity, by regime, and
  /// where that is known from, or that it was not compared on this ground. Empty otherwise.
  std::vector<std::string> model_errors;
  double jump_to_contact_nm = 0;  ///< gap at which the probe jumps, coming down slowly; 0: it does not
  double unloaded_radius_nm = 0;  ///< of the contact, coming out of it
  double radius_at_limit_nm = 0;  ///< of the contact at the force limit, as the next
  double overlap_at_limit_nm = 0;
  double pressure_at_limit_gpa = 0;   ///< mean
  double stiffness_at_limit_n_m = 0;  ///< of the contact
  double shown_stiffness_n_m = 0;     ///< of contact, probe and coupling in series, at the force limit
  double deflection_at_limit_nm = 0;  ///< of the probe

  /// One line each: where a model is formal, or an operator will be surprised.
  std::vector<std::string> warnings;
};

SceneSummary summarise(const Scene& scene);

}  // namespace telenano::scene

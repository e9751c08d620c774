#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "telenano/common/link/messages.h"
#include "telenano/nve_server/physics/contact/friction.h"
#include "telenano/nve_server/physics/equilibrium/tip_solution.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::slave {

/// What a scene's ground is like to the port: where a contact bears no load, how stiff it is there and where
/// it lets go. Found by walking the law down and up, some thousands of balances: once for a scene, not once
/// for each slave. On a scene of one potential at several effective radii, 1/8 to 8 times the tip's, for the
/// law of that potential is the same walk at the radius that the fields have; elsewhere on level ground.
class PortGround {
 public:
  explicit PortGround(const scene::Scene& scene);

  struct Rest {
    double overlap_nm = 0;     ///< of a contact without load
    double stiffness_n_m = 0;  ///< 0: it never pushes
    double pull_off_nn = 0;    ///< against the port's springs, all terms
  };
  /// At an effective radius: lines over its logarithm on one potential (overlap ~ R^⅓: 0.7 % of it between
  /// knots an octave apart); elsewhere that of level ground, the pull-off growing with the radius.
  Rest rest(double radius_nm) const noexcept;
  /// The deepest adhesive well of the scene: the port's charge is the change of what tip and sample store,
  /// springs included, plus losses; springs store no less than nothing, so that no path gives out more than
  /// −min U beyond what was put in, U the law's potential, 0 far away. On a flat sample that is found by the
  /// walk at the tip's own radius, to some parts in 10⁴ and never too low; U grows with the effective
  /// radius, so that elsewhere the largest that the law is ever given bounds it: on a grid the largest
  /// coefficient of its fields (splines stay within theirs), on a ball twice the tip's radius, where it
  /// touches the ball and the plate. With a particle, the tip's well on it besides. Marks may flatten the
  /// ground further than that: what is more is not in it.
  double well_aj() const noexcept { return well_aj_; }
  double well_radius_nm() const noexcept { return well_radius_nm_; }  ///< at which that is

 private:
  double tip_radius_nm_ = 0;
  double first_radius_nm_ = 0;  // of rests_, each next one an octave more
  std::vector<Rest> rests_;
  double well_aj_ = 0;
  double well_radius_nm_ = 0;
};

/// What the NVE's port is like around the tip, for the local contact model of the station: the tangent of its
/// force along the normal as a function of the commanded end, all springs in series,
///
///   k = k_s/(1 + k_s nᵀCn),   point = commanded end + n (F·n)/k,
///
/// so that at the commanded end itself the model's normal force is the true one. In adhesion the law's slope
/// k_s falls to nothing towards the pull-off; there the one without load is used, lest the point run away.
/// Before contact the point is where the tip, brought down along the normal, would first bear no load: the
/// station meets the ground without waiting for the link. Across: Mindlin's stiffness of the contact and the
/// friction limit, in series likewise.
///
/// None (version 0) where a particle is the sample: what the tip then leans on runs away.
class PortModel {
 public:
  /// `ground`: of the same scene.
  PortModel(std::shared_ptr<const scene::Scene> scene, const PortGround& ground);

  link::LocalModel of(const physics::TipSolution& tip, const Vec3& commanded_w_nm) noexcept;
  /// LocalModel::adhesion_nn of it alone; 0: there is no model.
  double adhesion_nn(const physics::TipSolution& tip) const noexcept;

 private:
  double port_stiffness_n_m(double contact_n_m, const Vec3& normal_w) const noexcept;

  std::shared_ptr<const scene::Scene> scene_;
  physics::Compliance springs_nm_nn_;
  std::optional<physics::Friction> friction_;
  PortGround ground_;
  link::LocalModel last_;
};

}  // namespace telenano::slave

#pragma once

#include <memory>
#include <optional>

#include "common/link/messages.h"
#include "nve_server/physics/friction.h"
#include "nve_server/physics/tip_equilibrium.h"
#include "nve_server/scene/scene.h"

namespace telenano::slave {

/// What a scene's level ground is like to the port: where a contact bears no load, how stiff it is there and
/// where it lets go. Found by walking the law down and up, some thousands of balances: once for a scene, not
/// once for each slave.
class PortGround {
 public:
  explicit PortGround(const scene::Scene& scene);

  double rest_overlap_nm() const noexcept { return rest_overlap_nm_; }        ///< of a contact without load
  double rest_stiffness_n_m() const noexcept { return rest_stiffness_n_m_; }  ///< 0: it never pushes
  double pull_off_nn() const noexcept { return pull_off_nn_; }  ///< against the port's springs, all terms
  /// The deepest adhesive well of the scene: the port's charge is the change of what tip and sample store,
  /// springs included, plus losses; springs store no less than nothing, so that no path gives out more than
  /// −min U beyond what was put in, U the law's potential, 0 far away. On a flat sample that is found by the
  /// walk at the tip's own radius, to some parts in 10⁴ and never too low; U grows with the effective
  /// radius, so that on any other the largest that the law is ever given (relative_curvature.h: ten tip
  /// radii) bounds it, 10 to 22 times too high where the ground is nearly level. With a particle, the tip's
  /// well on it besides. Marks may flatten the ground further than that: what is more is not in it.
  double well_aj() const noexcept { return well_aj_; }

 private:
  double rest_overlap_nm_ = 0;
  double rest_stiffness_n_m_ = 0;
  double pull_off_nn_ = 0;
  double well_aj_ = 0;
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

 private:
  double port_stiffness_n_m(double contact_n_m, const Vec3& normal_w) const noexcept;

  std::shared_ptr<const scene::Scene> scene_;
  physics::Compliance springs_nm_nn_;
  std::optional<physics::Friction> friction_;
  PortGround ground_;
  link::LocalModel last_;
};

}  // namespace telenano::slave

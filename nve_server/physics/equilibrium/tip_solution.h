#pragma once

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/law/plastic_contact.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::physics {

/// The springs between the free end and the tip's apex in W, nm/nN: symmetric, positive semidefinite, 0 =
/// rigid. The virtual coupling is equal in all directions; the cantilever adds its own, with a cross term
/// where it bends and tilts at once.
using Compliance = Mat3;

/// What yielded in a step, and where. The surface is not yet lowered (marked_potential.h does).
struct TipFlow {
  Vec3 at_w_nm = Vec3::Zero();  ///< where tip and sample touch
  double from_radius_nm = 0;    ///< R_eff before
  double origin_radius_nm = 0;
  PlasticFlow flow;  ///< no depth: nothing yielded
};

/// A balance of the tip between sample and springs.
struct TipSolution {
  SolveStatus status = SolveStatus::kOk;
  Branch branch = Branch::kFree;
  Vec3 apex_w_nm = Vec3::Zero();
  Vec3 force_w_nn = Vec3::Zero();     ///< on the tip, all of it
  Vec3 friction_w_nn = Vec3::Zero();  ///< the part of it that is friction
  Vec3 normal_w = Vec3::UnitZ();
  double normal_force_nn = 0;  ///< repulsive positive
  double overlap_nm = 0;
  double radius_nm = 0;  ///< effective
  double contact_radius_nm = 0;
  double stiffness_n_m = 0;           ///< of the tip–sample law, along the normal
  double potential_aj = 0;            ///< of the tip–sample law
  double dissipated_aj = 0;           ///< in the jumps of this step
  double friction_stored_aj = 0;      ///< in the bristle
  double friction_dissipated_aj = 0;  ///< in this step
  TipFlow yielded;
  int jumps = 0;
  int iterations = 0;
  bool sliding = false;    ///< the contact slips over the sample
  bool under_way = false;  ///< not in balance: `force_w_nn` is that of the springs, not of the sample
};

}  // namespace telenano::physics

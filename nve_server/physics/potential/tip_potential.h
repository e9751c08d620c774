#pragma once

#include <memory>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/potential/branch_potential.h"
#include "telenano/nve_server/physics/surface/contact_fields.h"

namespace telenano::physics {

/// Which of the potentials the tip is on: on the contact law's curve or outside, with a liquid bridge or
/// without.
struct PotentialBranch {
  bool inside = false;
  BridgeState bridge;
};

/// U of one branch at an apex, with gradient and Hessian.
struct PotentialSample {
  double energy_aj = 0;
  Vec3 gradient_nn = Vec3::Zero();
  Mat3 hessian_n_m = Mat3::Zero();
  ContactJet place;
  PotentialJet law;  ///< contact and van der Waals, at `place`
  ContactSize size;
  // Of the terms with fields of their own, along −∇δ of `place`.
  double other_load_nn = 0;
  Vec3 other_load_grad_n_m = Vec3::Zero();
  double other_stiffness_n_m = 0;
  bool reversible = false;  ///< the border of contact there is used both ways
};

/// Where a branch is left, if it is.
enum class BranchEnd {
  kNone,
  kContact,  ///< the border between outside and contact: the branch has no energy beyond it
  kBridge,   ///< a bridge forms or ruptures; the sample is that of the branch that ends
  kNoNumber
};

/// The potential of tip and ground (branch_potential.h over contact_fields.h), a sum of terms that each read
/// the fields at their own softening t:
///
///   U_b(p) = W_b(δ(p), ρ(p)) + W_bias(δ_1(p), ρ_1(p)) + W_bridge(δ_2(p), ρ_2(p)),
///
/// contact, van der Waals, retardation and cone at the t that grows with the distance from touch, the bias at
/// one that grows by a rule of its own (BranchPotential::bias_softening), the bridge at a fixed one
/// (bridge_potential.h).
///
/// Branches  Outside or inside, dry or wet: four. Borders of contact are those of the medium. A bridge ends
///           where its gap −δ_2 passes the rupture gap. Outside one forms where the films meet (−δ_2 at most
///           the formation gap) and U falls by it; in contact where U at overlap 0 would fall by it and U
///           falls, not in a neck. So forming and rupture both lower U, and what they set free is lost.
///           (tip_sample_law.h decides in contact once, as the overlap passes 0; here the place decides, for
///           a tip may slide.)
class TipPotential {
 public:
  TipPotential(std::shared_ptr<const ContactFields> fields, std::shared_ptr<const BranchPotential> potential)
      : fields_(std::move(fields)), potential_(std::move(potential)) {}

  /// U at `apex`, and whether the branch goes that far. No allocation, no throw.
  BranchEnd sample(const Vec3& apex_w_nm, const PotentialBranch& branch, CurveHint& hint,
                   PotentialSample& out) const noexcept;
  /// The branch beyond the end that sample() has told of. A few of these in turn lead to one that is there.
  PotentialBranch beyond(BranchEnd end, const Vec3& apex_w_nm, const PotentialBranch& branch,
                         const PotentialSample& at) const noexcept;
  /// The most ends there can be at one place.
  static constexpr int kMostEnds = 4;

  const BranchPotential& potential() const noexcept { return *potential_; }
  const std::shared_ptr<const BranchPotential>& shared_potential() const noexcept { return potential_; }
  const ContactFields& fields() const noexcept { return *fields_; }
  const std::shared_ptr<const ContactFields>& shared_fields() const noexcept { return fields_; }

 private:
  const BranchPotential& of(const BridgeState& bridge) const noexcept {
    return bridge.present && potential_->wet() ? *potential_->wet() : *potential_;
  }
  /// At the two softenings.
  struct Overlaps {
    double contact_nm, contact_log_radius;
    double bridge_nm, bridge_log_radius;
  };
  Overlaps overlaps(const Vec3& apex_w_nm, const ContactJet& place) const noexcept;
  /// The bridge that forms where the dry law's energy is `dry_aj`; none if none does.
  BridgeState bridge_forms(bool inside, const Overlaps& at, double dry_aj) const noexcept;

  std::shared_ptr<const ContactFields> fields_;
  std::shared_ptr<const BranchPotential> potential_;
};

}  // namespace telenano::physics

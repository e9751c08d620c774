#include "telenano/nve_server/physics/potential/tip_potential.h"

#include <cmath>

namespace telenano::physics {
namespace {

// Gradient and Hessian of W(δ, ρ) by the chain rule; the first term puts what there is.
template <bool kFirst>
void add(const PotentialJet& w, const ContactJet& f, PotentialSample& out) noexcept {
  const Vec3& d = f.overlap_grad;
  const Vec3& r = f.log_radius_grad_per_nm;
  const Vec3 gradient = w.force_nn * d + w.by_radius_aj * r;
  if constexpr (kFirst) {
    out.energy_aj = w.energy_aj;
    out.gradient_nn = gradient;
  } else {
    out.energy_aj += w.energy_aj;
    out.gradient_nn += gradient;
  }
  // W_δδ d dᵀ + W_δρ (d rᵀ + r dᵀ) + W_ρρ r rᵀ = a dᵀ + b rᵀ, symmetric
  const Vec3 a = w.stiffness_n_m * d + w.mixed_nn * r;
  const Vec3 b = w.mixed_nn * d + w.by_radius_twice_aj * r;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      const double h = (a[i] * d[j] + b[i] * r[j]) + (w.force_nn * f.overlap_hess_per_nm(i, j) +
                                                      w.by_radius_aj * f.log_radius_hess_per_nm2(i, j));
      const double sum = kFirst ? h : out.hessian_n_m(i, j) + h;
      out.hessian_n_m(i, j) = sum;
      if (j > i) out.hessian_n_m(j, i) = sum;
    }
  }
}

// A term with fields of its own: what of it acts along −∇δ of the contact.
void add_load(const PotentialJet& w, const ContactJet& f, PotentialSample& out) noexcept {
  const double steepness = out.place.overlap_grad.norm();
  if (!(steepness > 0.0)) return;
  const double along = f.overlap_grad.dot(out.place.overlap_grad) / steepness;
  out.other_load_nn += w.force_nn * along;
  out.other_load_grad_n_m +=
      along * (w.stiffness_n_m * f.overlap_grad + w.mixed_nn * f.log_radius_grad_per_nm);
  out.other_stiffness_n_m += along * along * w.stiffness_n_m;
}

}  // namespace

BranchEnd TipPotential::sample(const Vec3& apex, const PotentialBranch& branch, CurveHint& hint,
                               PotentialSample& out) const noexcept {
  fields_->contact_at(apex, out.place);
  const ContactJet& at = out.place;
  if (!(std::isfinite(at.overlap_nm) && std::isfinite(at.log_radius))) return BranchEnd::kNoNumber;
  const BranchPotential& law = of(branch.bridge);
  const BranchPotential::Place place = law.place(at.log_radius);
  const BranchPotential::Borders borders = law.borders(place);
  out.reversible = borders.reversible;
  if (branch.inside) {
    if (at.overlap_nm < borders.leave_nm) return BranchEnd::kContact;
    if (!law.inside(place, at.overlap_nm, at.log_radius, hint, out.law, out.size)) return BranchEnd::kContact;
  } else {
    if (at.overlap_nm > borders.enter_nm) return BranchEnd::kContact;
    law.outside(at.overlap_nm, at.log_radius, out.law);
    out.size = {};
  }
  out.other_load_nn = out.other_stiffness_n_m = 0;
  out.other_load_grad_n_m.setZero();
  add<true>(out.law, at, out);
  if (potential_->has_bias()) {
    ContactJet there;
    fields_->growing_at(apex, potential_->bias_softening(), there);
    PotentialJet bias;
    potential_->add_bias(there.overlap_nm, there.log_radius, bias);
    add<false>(bias, there, out);
    add_load(bias, there, out);
  }
  BranchEnd end = BranchEnd::kNone;
  const BridgePotential& bridge = potential_->bridge();
  if (bridge.active()) {
    if (branch.bridge.present) {
      ContactJet there;
      fields_->at_softening(apex, bridge.softening_nm(), there);
      PotentialJet liquid;
      bridge.add(branch.bridge, there.overlap_nm, there.log_radius, liquid);
      add<false>(liquid, there, out);
      add_load(liquid, there, out);
      if (BridgePotential::ruptured(branch.bridge, there.overlap_nm)) end = BranchEnd::kBridge;
    } else {
      if (bridge_forms(branch.inside, overlaps(apex, at), out.law.energy_aj).present)
        end = BranchEnd::kBridge;
    }
  }
  return std::isfinite(out.energy_aj) && is_finite(out.gradient_nn) ? end : BranchEnd::kNoNumber;
}

BridgeState TipPotential::bridge_forms(bool inside, const Overlaps& at, double dry_aj) const noexcept {
  const BridgePotential& bridge = potential_->bridge();
  const BranchPotential& wet = *potential_->wet();
  double forms_at = 0;
  if (inside) {
    if (!(at.contact_nm >= 0.0)) return {};
    PotentialJet touch;
    bridge.add(bridge.formed_at(0.0, at.bridge_log_radius), 0.0, at.bridge_log_radius, touch);
    if (!(wet.touch_energy_aj(at.contact_log_radius) + touch.energy_aj <
          potential_->touch_energy_aj(at.contact_log_radius))) {
      return {};
    }
  } else {
    forms_at = bridge.formation_overlap_nm(at.bridge_log_radius);
    if (!(at.bridge_nm >= forms_at)) return {};
  }
  const BridgeState formed = bridge.formed_at(forms_at, at.bridge_log_radius);
  if (BridgePotential::ruptured(formed, at.bridge_nm)) return {};
  PotentialJet after;
  if (!inside && at.contact_nm <= wet.borders(at.contact_log_radius).enter_nm) {
    wet.outside(at.contact_nm, at.contact_log_radius, after);
  } else {
    CurveHint hint;
    ContactSize size;
    if (!wet.inside(at.contact_nm, at.contact_log_radius, hint, after, size)) return {};
  }
  bridge.add(formed, at.bridge_nm, at.bridge_log_radius, after);
  return after.energy_aj < dry_aj ? formed : BridgeState{};
}

TipPotential::Overlaps TipPotential::overlaps(const Vec3& apex, const ContactJet& place) const noexcept {
  Overlaps at{place.overlap_nm, place.log_radius, 0, 0};
  fields_->values_at_softening(apex, potential_->bridge().softening_nm(), at.bridge_nm, at.bridge_log_radius);
  return at;
}

PotentialBranch TipPotential::beyond(BranchEnd end, const Vec3& apex, const PotentialBranch& branch,
                                     const PotentialSample& at) const noexcept {
  PotentialBranch next = branch;
  const bool dry = potential_->bridge().active() && !branch.bridge.present;
  if (end == BranchEnd::kContact) {
    next.inside = !branch.inside;
    if (dry && !branch.inside) {
      // On its way in the tip has passed the border of contact: did the films meet before?
      Overlaps there = overlaps(apex, at.place);
      const double back = there.contact_nm - potential_->borders(there.contact_log_radius).enter_nm;
      there.contact_nm -= back;
      there.bridge_nm -= back;
      PotentialJet outside;
      potential_->outside(there.contact_nm, there.contact_log_radius, outside);
      next.bridge = bridge_forms(false, there, outside.energy_aj);
    }
  } else if (end == BranchEnd::kBridge) {
    next.bridge =
        dry ? bridge_forms(branch.inside, overlaps(apex, at.place), at.law.energy_aj) : BridgeState{};
  }
  return next;
}

}  // namespace telenano::physics

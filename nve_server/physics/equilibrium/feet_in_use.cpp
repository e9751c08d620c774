#include "telenano/nve_server/physics/equilibrium/feet_in_use.h"

#include <algorithm>
#include <cmath>

namespace telenano::physics {
namespace {

constexpr double kMerge = 0.05;       // nm between two feet that have become one
constexpr double kSameNormal = 1e-8;  // of the compliance: equalising it would take a huge force
constexpr double kNegativeShare = -1e-9;

}  // namespace

bool FeetInUse::add(const FootMemory& memory, const SurfaceContact& contact, double share) noexcept {
  if (count_ == kMaxFeet) return false;
  feet_[count_++] = {memory, contact, share, 0.0};
  return true;
}

bool FeetInUse::add_if_new(const FootMemory& memory, const SurfaceContact& contact) noexcept {
  for (int i = 0; i < count_; ++i) {
    if ((feet_[i].contact.foot_w_nm - contact.foot_w_nm).squaredNorm() <= kMerge * kMerge) return false;
  }
  return add(memory, contact, 0.0);
}

void FeetInUse::replace_least(const FootMemory& memory, const SurfaceContact& contact) noexcept {
  int least = 0;
  for (int i = 1; i < count_; ++i) {
    if (feet_[i].share < feet_[least].share) least = i;
  }
  feet_[least] = {memory, contact, feet_[least].share, 0.0};
}

void FeetInUse::drop(int i) noexcept {
  for (int j = i; j + 1 < count_; ++j) feet_[j] = feet_[j + 1];
  --count_;
  normalise();
}

void FeetInUse::normalise() noexcept {
  double sum = 0;
  for (int i = 0; i < count_; ++i) sum += std::max(0.0, feet_[i].share);
  for (int i = 0; i < count_; ++i) {
    feet_[i].share = sum > 0.0 ? std::max(0.0, feet_[i].share) / sum : (i == 0 ? 1.0 : 0.0);
  }
}

void FeetInUse::keep_deepest() noexcept {
  int deepest = 0;
  for (int i = 1; i < count_; ++i) {
    if (feet_[i].overlap_nm > feet_[deepest].overlap_nm) deepest = i;
  }
  if (deepest != 0) feet_[0] = feet_[deepest];
  count_ = 1;
  feet_[0].share = 1.0;
}

void FeetInUse::measure(double tip_radius_nm) noexcept {
  for (int i = 0; i < count_; ++i) {
    Foot& foot = feet_[i];
    foot.overlap_nm = tip_radius_nm - foot.contact.distance_nm;
  }
  for (int i = count_ - 1; i > 0; --i) {
    for (int j = 0; j < i; ++j) {
      if ((feet_[i].contact.foot_w_nm - feet_[j].contact.foot_w_nm).squaredNorm() > kMerge * kMerge) continue;
      feet_[j].share += feet_[i].share;
      drop(i);
      break;
    }
  }
}

double FeetInUse::turning(double force_nn) const noexcept {
  double most = 0;
  for (int i = 0; i < count_; ++i) {
    const SurfaceContact& contact = feet_[i].contact;
    const double d = contact.distance_nm;
    for (const double curvature : {contact.curvature_1_per_nm, contact.curvature_2_per_nm}) {
      const double seen = 1.0 + curvature * d;
      if (seen > 1e-6) most = std::max(most, feet_[i].share * force_nn * curvature / seen);
    }
  }
  return most;
}

Mat3 FeetInUse::normal_turn() const noexcept {
  if (count_ == 1) return feet_[0].contact.normal_turn_per_nm;
  Mat3 sum = Mat3::Zero();
  for (int i = 0; i < count_; ++i) sum += feet_[i].share * feet_[i].contact.normal_turn_per_nm;
  return sum;
}

Vec3 FeetInUse::normal() const noexcept {
  if (count_ == 1) return feet_[0].contact.normal_w;
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < count_; ++i) sum += feet_[i].share * feet_[i].contact.normal_w;
  return sum;
}

double FeetInUse::radius_nm() const noexcept {
  if (count_ == 1) return feet_[0].contact.effective_radius_nm;
  double sum = 0;
  for (int i = 0; i < count_; ++i) sum += feet_[i].share * feet_[i].contact.effective_radius_nm;
  return sum;
}

double FeetInUse::origin_radius_nm() const noexcept {
  double sum = 0;
  for (int i = 0; i < count_; ++i) sum += feet_[i].share * feet_[i].contact.origin_radius_nm;
  return sum;
}

Vec3 FeetInUse::radius_gradient() const noexcept {
  if (count_ == 1) return feet_[0].contact.radius_gradient;
  Vec3 sum = Vec3::Zero();
  for (int i = 0; i < count_; ++i) sum += feet_[i].share * feet_[i].contact.radius_gradient;
  return sum;
}

bool FeetInUse::radius_clamped() const noexcept {
  return std::any_of(feet_.begin(), feet_.begin() + count_,
                     [](const Foot& f) { return f.contact.radius_clamped; });
}

bool FeetInUse::outside() const noexcept {
  return std::any_of(feet_.begin(), feet_.begin() + count_, [](const Foot& f) { return f.contact.outside; });
}

double FeetInUse::overlap_nm() const noexcept {
  double most = feet_[0].overlap_nm;
  for (int i = 1; i < count_; ++i) most = std::max(most, feet_[i].overlap_nm);
  return most;
}

FeetInUse::Reduced FeetInUse::reduce(const Mat3& s, const Vec3& u, const Vec3& tilt,
                                     const Vec3& slope) noexcept {
  Reduced reduced;
  while (true) {
    const Vec3& n0 = feet_[0].contact.normal_w;
    const Vec3 give = s * (n0 + slope);
    const Vec3 seen = n0 + tilt;
    const double along = seen.dot(give);
    reduced.base_overlap_nm = feet_[0].overlap_nm - seen.dot(u);
    reduced.compliance = std::max(0.0, along);
    if (count_ == 1) return reduced;

    Vec3 m[kMaxFeet - 1], sm[kMaxFeet - 1];
    double r[kMaxFeet - 1], q[kMaxFeet - 1], back[kMaxFeet - 1];
    for (int i = 1; i < count_; ++i) {
      m[i - 1] = feet_[i].contact.normal_w - n0;
      sm[i - 1] = s * m[i - 1];
      r[i - 1] = feet_[i].overlap_nm - feet_[0].overlap_nm - m[i - 1].dot(u);
      q[i - 1] = m[i - 1].dot(give);
      back[i - 1] = seen.dot(sm[i - 1]);
    }
    const double g11 = m[0].dot(sm[0]);
    const double floor = kSameNormal * std::max(along, 1e-300);
    if (count_ == 2) {
      if (!(g11 > floor)) {
        keep_deepest();
        continue;
      }
      reduced.b0[0] = r[0] / g11;
      reduced.b1[0] = q[0] / g11;
    } else {
      const double g12 = m[0].dot(sm[1]);
      const double g22 = m[1].dot(sm[1]);
      const double det = g11 * g22 - g12 * g12;
      if (!(g11 > floor && g22 > floor && det > 1e-8 * g11 * g22)) {
        // Three normals (nearly) in a plane, as in a groove: two feet carry it.
        drop(feet_[1].share < feet_[2].share ? 1 : 2);
        continue;
      }
      reduced.b0 = {(g22 * r[0] - g12 * r[1]) / det, (g11 * r[1] - g12 * r[0]) / det};
      reduced.b1 = {(g22 * q[0] - g12 * q[1]) / det, (g11 * q[1] - g12 * q[0]) / det};
    }
    for (int i = 1; i < count_; ++i) {
      reduced.base_overlap_nm -= back[i - 1] * reduced.b0[i - 1];
      reduced.compliance -= back[i - 1] * reduced.b1[i - 1];
    }
    reduced.compliance = std::max(0.0, reduced.compliance);
    return reduced;
  }
}

bool FeetInUse::share(const Reduced& reduced, double force_nn) noexcept {
  if (count_ == 1) return false;
  if (!(force_nn > 0.0)) {
    keep_deepest();
    return true;
  }
  double rest = 1.0;
  for (int i = 1; i < count_; ++i) {
    feet_[i].share = (reduced.b0[i - 1] - reduced.b1[i - 1] * force_nn) / force_nn;
    rest -= feet_[i].share;
  }
  feet_[0].share = rest;
  int least = 0;
  for (int i = 1; i < count_; ++i) {
    if (feet_[i].share < feet_[least].share) least = i;
  }
  if (feet_[least].share >= kNegativeShare) return false;
  drop(least);
  return true;
}

void FeetInUse::store(TipState& state) const noexcept {
  state.foot_count = count_;
  for (int i = 0; i < count_; ++i) state.feet[i] = {feet_[i].memory, feet_[i].share};
}

void FeetInUse::store(TipFlow& flow) const noexcept {
  flow.feet = 0;
  for (int i = 0; i < count_; ++i) {
    const SurfaceContact& contact = feet_[i].contact;
    if (!(feet_[i].share > 0.0)) continue;
    flow.foot[flow.feet++] = {contact.foot_w_nm, contact.normal_w.z()};
  }
}

}  // namespace telenano::physics

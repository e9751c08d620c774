#include "telenano/nve_server/physics/particle/particle_footing.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/surface/relative_curvature.h"

namespace telenano::physics {
namespace {

constexpr double kSameFoot_nm = 0.05;  // nearer feet are one
constexpr double kDeeper_nm = 1e-7;    // by which a foot must be deeper to count as another
constexpr double kForget_nm = 0.5;     // a foot so much less deep carries nothing

struct Radius {
  double nm = 0;
  bool clamped = false;
};

// As for the tip (relative_curvature.h), with this sphere's own radius.
Radius effective(double radius_nm, const SurfaceContact& contact) noexcept {
  const double c1 = 1.0 + radius_nm * contact.curvature_1_per_nm;
  const double c2 = 1.0 + radius_nm * contact.curvature_2_per_nm;
  return {radius_nm / std::sqrt(kept_factor(c1) * kept_factor(c2)), is_clamped(c1) || is_clamped(c2)};
}

}  // namespace

Footing stand(const Surface& surface, const Vec3& centre, double radius_nm, ParticleFeet& feet) noexcept {
  Footing out;
  if (surface.is_flat()) {
    out.overlap_nm = radius_nm - centre.z();
    out.radius_nm = radius_nm;
    return out;
  }
  std::array<SurfaceContact, kMaxParticleFeet> contacts;
  int count = 0;
  if (feet.count == 0) {
    feet.count = 1;
    feet.feet[0] = FootMemory{};
    contacts[count++] = surface.nearest(centre, Search::kGlobal, feet.feet[0]);
  } else {
    for (int i = 0; i < feet.count; ++i) {
      const SurfaceContact contact = surface.nearest(centre, Search::kLocal, feet.feet[i]);
      bool known = false;
      for (int k = 0; k < count; ++k) {
        known = known || (contacts[k].foot_w_nm - contact.foot_w_nm).norm() < kSameFoot_nm;
      }
      if (!known) contacts[count++] = contact;
    }
  }
  double nearest = contacts[0].distance_nm;
  for (int i = 1; i < count; ++i) nearest = std::min(nearest, contacts[i].distance_nm);
  std::array<double, kMaxParticleFeet> weight{};
  double sum = 0.0;
  for (int i = 0; i < count; ++i) {
    weight[i] = count == 1 ? 1.0 : det_exp((nearest - contacts[i].distance_nm) / kKinkWidth_nm);
    sum += weight[i];
  }
  out.overlap_nm = radius_nm - nearest + (count == 1 ? 0.0 : kKinkWidth_nm * det_log(sum));
  out.normal_w.setZero();
  Mat3 spread = Mat3::Zero();
  for (int i = 0; i < count; ++i) {
    const double share = weight[i] / sum;
    const SurfaceContact& contact = contacts[i];
    const Radius radius = effective(radius_nm, contact);
    out.normal_w += share * contact.normal_w;
    out.bend_1_per_nm -= share * contact.normal_turn_per_nm;
    spread += share * contact.normal_w * contact.normal_w.transpose();
    out.radius_nm += share * radius.nm;
    out.clamped = out.clamped || (radius.clamped && share > 0.01);
    out.outside = out.outside || (contact.outside && share > 0.01);
  }
  if (count > 1) {
    out.kink_1_per_nm = (spread - out.normal_w * out.normal_w.transpose()) / kKinkWidth_nm;
  }
  return out;
}

bool look_around(const Surface& surface, const Vec3& centre, ParticleFeet& feet) noexcept {
  if (surface.is_flat()) return false;
  FootMemory memory = feet.feet[0];
  const SurfaceContact deepest = surface.nearest(centre, Search::kGlobal, memory);
  ParticleFeet kept;
  std::array<Vec3, kMaxParticleFeet> where;
  double known_nm = std::numeric_limits<double>::infinity();
  for (int i = 0; i < feet.count; ++i) {
    const SurfaceContact contact = surface.nearest(centre, Search::kLocal, feet.feet[i]);
    known_nm = std::min(known_nm, contact.distance_nm);
    bool drop = contact.distance_nm > deepest.distance_nm + kForget_nm;
    for (int k = 0; k < kept.count; ++k) {
      drop = drop || (where[k] - contact.foot_w_nm).norm() < kSameFoot_nm;
    }
    if (drop) continue;
    where[kept.count] = contact.foot_w_nm;
    kept.feet[kept.count++] = feet.feet[i];
  }
  const bool deeper = deepest.distance_nm < known_nm - kDeeper_nm;
  if (deeper || kept.count == 0) {
    if (kept.count == kMaxParticleFeet) --kept.count;
    kept.feet[kept.count++] = memory;
  }
  feet = kept;
  return deeper;
}

}  // namespace telenano::physics

// The nearest point of a spline surface to a sphere's centre.
//
// Foot (x, y) minimises f = ½|S − c|², S = (x, y, z(x, y)). With r = z − c_z:
//   g = (x − c_x + r z_x, y − c_y + r z_y),   M = [[1 + z_x² + r z_xx, z_x z_y + r z_xy], [·, 1 + z_y² + r
//   z_yy]].
// Newton's step −M⁻¹g where M is positive definite, else Gauss–Newton's (r dropped from M, always positive);
// never longer than kMaxStepCells cells, halved until f falls (Armijo).
//
// The distance to a rough surface has many minima: the one that was followed need not be the least. A global
// search asks SampleTops for any sample that is nearer than the best foot — or, away from the feet already
// known, nearer than that plus a margin for what lies between samples (a summit of radius ρ between four
// samples is nearer than all of them by up to h²/4·(1/d + 1/ρ)), and descends from there. So no foot is
// farther than any sample; a summit between samples, sharper than the margin allows for, may still be
// overlooked for a foot elsewhere that is hardly farther (real scan, spacing 2.3 nm: three cases in four
// hundred, by less than 0.1 nm).
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/physics/surface/relative_curvature.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {
namespace {

constexpr double kMaxStepCells = 2.0;
constexpr int kMaxIterations = 60;
constexpr int kMaxBasins = 8;          // basins visited by one global search
constexpr double kKnownCells = 2.0;    // a sample this near to a known foot belongs to its basin
constexpr double kStepDone = 2e-5;     // cells: Newton's next error is about its square
constexpr double kStepNone = 1e-10;    // cells: the foot has not moved
constexpr double kStepTrusted = 1e-4;  // cells: f can no longer resolve the gain

}  // namespace

struct SplineSurface::Foot {
  double x = 0, y = 0;
  HeightJet jet;
  double m11 = 1, m12 = 0, m22 = 1;  // M
  double distance_sq = 0;
  bool converged = false;
};

SplineSurface::Foot SplineSurface::descend(const Vec3& centre, double x, double y, const HeightJet& start,
                                           bool jet_is_old) const noexcept {
  Foot foot;
  foot.x = x;
  foot.y = y;
  foot.jet = start;
  double f = 0;
  const auto value = [&centre](double px, double py, double pz) {
    const double ex = px - centre.x(), ey = py - centre.y(), ez = pz - centre.z();
    return 0.5 * (ex * ex + ey * ey + ez * ez);
  };
  f = value(foot.x, foot.y, foot.jet.z);
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const HeightJet& j = foot.jet;
    const double r = j.z - centre.z();
    const double gx = foot.x - centre.x() + r * j.zx;
    const double gy = foot.y - centre.y() + r * j.zy;
    double a = 1.0 + j.zx * j.zx + r * j.zxx;
    double b = j.zx * j.zy + r * j.zxy;
    double c = 1.0 + j.zy * j.zy + r * j.zyy;
    double det = a * c - b * b;
    const bool newton = a > 0.0 && det > 1e-5 * (a * a + c * c + 2.0 * b * b);
    foot.m11 = a;
    foot.m12 = b;
    foot.m22 = c;
    if (!newton) {
      a = 1.0 + j.zx * j.zx;
      b = j.zx * j.zy;
      c = 1.0 + j.zy * j.zy;
      det = a * c - b * b;
    }
    double sx = -(c * gx - b * gy) / det;
    double sy = -(a * gy - b * gx) / det;
    const double length_sq = sx * sx + sy * sy;
    if (!std::isfinite(length_sq)) return foot;
    if (length_sq < kStepDone * kStepDone * cell_ * cell_) {
      if (jet_is_old) {
        // The centre has not moved, or so little that the foot may stay; else its jet must be seen afresh,
        // lest Taylor steps follow upon each other.
        if (length_sq < kStepNone * kStepNone * cell_ * cell_) {
          foot.converged = true;
          break;
        }
        jet_is_old = false;
        foot.jet = jet(foot.x, foot.y);
        f = value(foot.x, foot.y, foot.jet.z);
        continue;
      }
      // The last step is too short to need another evaluation.
      foot.x += sx;
      foot.y += sy;
      foot.jet.z +=
          (j.zx + 0.5 * (j.zxx * sx + j.zxy * sy)) * sx + (j.zy + 0.5 * (j.zxy * sx + j.zyy * sy)) * sy;
      foot.jet.zx += j.zxx * sx + j.zxy * sy;
      foot.jet.zy += j.zxy * sx + j.zyy * sy;
      foot.converged = true;
      break;
    }
    const double longest = kMaxStepCells * cell_;
    if (length_sq > longest * longest) {
      const double scale = longest / std::sqrt(length_sq);
      sx *= scale;
      sy *= scale;
    }
    jet_is_old = false;
    const bool trusted = newton && length_sq < kStepTrusted * kStepTrusted * cell_ * cell_;
    const double slope = gx * sx + gy * sy;
    double scale = 1.0;
    bool moved = false;
    for (int halving = 0; halving < 12; ++halving, scale *= 0.5) {
      const double px = foot.x + scale * sx;
      const double py = foot.y + scale * sy;
      const HeightJet trial = jet(px, py);
      const double trial_f = value(px, py, trial.z);
      if (!trusted && !(trial_f <= f + 1e-4 * scale * slope)) continue;
      foot.x = px;
      foot.y = py;
      foot.jet = trial;
      f = trial_f;
      moved = true;
      break;
    }
    if (!moved) break;
  }
  foot.distance_sq = 2.0 * value(foot.x, foot.y, foot.jet.z);
  return foot;
}

// Other basins than that of the foot that was followed, from the nearest sample onwards. (Leaving out samples
// with a nearer neighbour, as lying on a known basin's slope, saves a tenth, and overlooks twice as many
// summits between samples.)
SplineSurface::Foot SplineSurface::deepest_basin(const Vec3& centre, Foot foot) const noexcept {
  const auto margin = [this](double distance) {
    return 0.25 * cell_ * cell_ / std::max(distance, cell_) + 0.1 * cell_;
  };
  const double known_radius = kKnownCells * cell_;
  double distance = std::sqrt(foot.distance_sq);
  double limit = distance + margin(distance);
  SampleTops::Near near;
  tops_.near(centre, limit, distance * (1.0 - 1e-12), {foot.x, foot.y, known_radius}, near);
  for (int visited = 1; visited < kMaxBasins && near.count > 0;) {
    SampleTops::Sample& nearest =
        *std::min_element(near.samples.begin(), near.samples.begin() + near.count,
                          [](const auto& a, const auto& b) { return a.distance_sq < b.distance_sq; });
    const SampleTops::Sample sample = nearest;
    nearest = near.samples[static_cast<std::size_t>(--near.count)];
    const Foot other = descend(centre, sample.x_nm, sample.y_nm, jet(sample.x_nm, sample.y_nm), false);
    if (other.distance_sq < foot.distance_sq) foot = other;
    ++visited;
    distance = std::sqrt(foot.distance_sq);
    limit = distance + margin(distance);
    const double known_sq = foot.distance_sq * (1.0 - 2e-12);
    int kept = 0;
    for (int i = 0; i < near.count; ++i) {
      const SampleTops::Sample& s = near.samples[static_cast<std::size_t>(i)];
      if (!(s.distance_sq < limit * limit)) continue;
      const double ex = s.x_nm - sample.x_nm, ey = s.y_nm - sample.y_nm;
      if (s.distance_sq >= known_sq && ex * ex + ey * ey < known_radius * known_radius) continue;
      near.samples[static_cast<std::size_t>(kept++)] = s;
    }
    near.count = kept;
  }
  return foot;
}

SurfaceContact SplineSurface::contact_at(const Vec3& centre, const Foot& foot) const noexcept {
  const HeightJet& j = foot.jet;
  const double per_w = 1.0 / std::sqrt(1.0 + j.zx * j.zx + j.zy * j.zy);
  SurfaceContact contact;
  contact.foot_w_nm = Vec3(foot.x, foot.y, j.z);
  contact.normal_w = Vec3(-j.zx * per_w, -j.zy * per_w, per_w);
  contact.distance_nm = (centre - contact.foot_w_nm).dot(contact.normal_w);
  contact.outside = !inside(foot.x, foot.y);
  contact.converged = foot.converged;
  const PrincipalCurvatures curvatures = principal_curvatures(j);
  contact.curvature_1_per_nm = curvatures.first_1_per_nm;
  contact.curvature_2_per_nm = curvatures.second_1_per_nm;
  contact.radius_clamped = is_clamped(1.0 + tip_radius_ * curvatures.second_1_per_nm);
  const ValueAndSlope g = relative_curvature(foot.x, foot.y);
  const double per_g = 1.0 / g.value;
  contact.effective_radius_nm = contact.origin_radius_nm = tip_radius_ * per_g;
  if (marked_) contact.origin_radius_nm = tip_radius_ / origin_->value_and_slope(foot.x, foot.y).value;

  // Tᵀ(S − c) = 0 along the foot's way gives d(x, y) = M⁻¹ Tᵀ dc (T the tangents S_x, S_y), and so dS = T M⁻¹
  // Tᵀ dc; with c − S = d n, ∂n/∂c = (1 − n nᵀ − T M⁻¹ Tᵀ)/d.
  const double det = foot.m11 * foot.m22 - foot.m12 * foot.m12;
  if (foot.converged && det > 0.0) {
    const double per_det = 1.0 / det;
    const double i11 = foot.m22 * per_det, i12 = -foot.m12 * per_det, i22 = foot.m11 * per_det;
    // The rows of M⁻¹ Tᵀ; T = (1 0 z_x; 0 1 z_y)ᵀ.
    const Vec3 ux(i11, i12, i11 * j.zx + i12 * j.zy);
    const Vec3 uy(i12, i22, i12 * j.zx + i22 * j.zy);
    contact.radius_gradient = -(contact.effective_radius_nm * per_g) * (g.slope_x * ux + g.slope_y * uy);
    const double d = contact.distance_nm;
    if (d * d > 1e-6) {
      const double per_d = 1.0 / d;
      const Vec3& n = contact.normal_w;
      Mat3& turn = contact.normal_turn_per_nm;
      turn(0, 0) = (1.0 - n.x() * n.x() - ux.x()) * per_d;
      turn(1, 1) = (1.0 - n.y() * n.y() - uy.y()) * per_d;
      turn(2, 2) = (1.0 - n.z() * n.z() - (j.zx * ux.z() + j.zy * uy.z())) * per_d;
      turn(0, 1) = turn(1, 0) = (-n.x() * n.y() - ux.y()) * per_d;
      turn(0, 2) = turn(2, 0) = (-n.x() * n.z() - ux.z()) * per_d;
      turn(1, 2) = turn(2, 1) = (-n.y() * n.z() - uy.z()) * per_d;
    }
  }
  return contact;
}

SurfaceContact SplineSurface::nearest(const Vec3& centre, Search search, FootMemory& memory) const noexcept {
  bool follow = memory.warm;
  if (follow) {
    // A foot farther away, sideways alone, than the deepest point below the centre is cannot be the nearest.
    const double ex = memory.x_nm - centre.x(), ey = memory.y_nm - centre.y();
    const double deepest = std::max(centre.z() - lowest_nm(), cell_);
    follow = ex * ex + ey * ey < deepest * deepest;
  }
  const double start_x = follow ? memory.x_nm : centre.x();
  const double start_y = follow ? memory.y_nm : centre.y();
  const bool remembered = follow && memory.stamp == stamp_;
  Foot foot = descend(centre, start_x, start_y, remembered ? memory.jet : jet(start_x, start_y), remembered);
  // From within the sample every side is near: only the foot that was followed says where the tip came from.
  if (search == Search::kGlobal && centre.z() > foot.jet.z) foot = deepest_basin(centre, foot);
  memory.x_nm = foot.x;
  memory.y_nm = foot.y;
  memory.jet = foot.jet;
  memory.stamp = stamp_;
  memory.warm = true;
  return contact_at(centre, foot);
}

}  // namespace telenano::physics

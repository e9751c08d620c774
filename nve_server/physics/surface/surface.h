#pragma once

#include <cstdint>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/surface/height_jet.h"

/// The sample's surface, frame W: x to the right, y up the image, z out of the sample, nm.
namespace telenano::physics {

/// Where a sphere would touch: everything that the force law and the equilibrium need of the surface.
///
/// `distance` is from the sphere's centre to the nearest point of the surface along its normal, negative when
/// the centre is below; overlap = tip radius − distance. `normal` points out of the sample. Curvatures of a
/// summit are positive.
struct SurfaceContact {
  double distance_nm = 0;
  Vec3 foot_w_nm = Vec3::Zero();
  Vec3 normal_w = Vec3::UnitZ();
  double curvature_1_per_nm = 0;  ///< principal, curvature_1 >= curvature_2
  double curvature_2_per_nm = 0;
  /// How the normal turns as the centre moves, ∂n/∂c = Hessian of the distance (symmetric, 1/nm): 0 on a flat
  /// sample.
  Mat3 normal_turn_per_nm = Mat3::Zero();
  /// Radius that the force law is given (relative_curvature.h), a field of the foot, and how it changes as
  /// the centre moves, ∂R_eff/∂c (tangential): the law's potential U(overlap, R_eff) pulls with −∂U/∂R_eff of
  /// it.
  double effective_radius_nm = 0;
  Vec3 radius_gradient = Vec3::Zero();
  double origin_radius_nm = 0;  ///< the effective radius there before any mark
  bool radius_clamped = false;  ///< the pit at the foot is nearly as narrow as the tip, or narrower
  bool outside = false;         ///< the foot lies on the continuation beyond the rim of the scan
  bool converged = true;        ///< false: the foot is only as good as the search grid
};

/// Where the last search ended, so that the next starts there. Private to the surface.
struct FootMemory {
  double x_nm = 0;
  double y_nm = 0;
  HeightJet jet;            // of the height there, if `stamp` is still the surface's
  std::uint32_t stamp = 0;  // 0: none
  bool warm = false;
};

/// How much of the surface is searched.
enum class Search {
  kLocal,   ///< follow the foot of the memory: cheapest, may miss a nearer one elsewhere
  kGlobal,  ///< the nearest foot of all: what an accepted step must use, so that no motion passes through a
            ///< flake
};

/// Seam: a height field without overhangs.
class Surface {
 public:
  virtual ~Surface() = default;

  /// The nearest point to a sphere's centre. No allocation, no throw.
  virtual SurfaceContact nearest(const Vec3& centre_w_nm, Search search,
                                 FootMemory& memory) const noexcept = 0;
  virtual double height_nm(double x_nm, double y_nm) const noexcept = 0;

  virtual double lowest_nm() const noexcept = 0;
  virtual double highest_nm() const noexcept = 0;
  /// A flat sample needs neither search nor iteration: distance and normal follow at once.
  virtual bool is_flat() const noexcept = 0;
};

}  // namespace telenano::physics

#pragma once

#include <array>

#include "telenano/nve_server/physics/equilibrium/tip_equilibrium.h"
#include "telenano/nve_server/physics/surface/surface.h"

namespace telenano::physics {

/// The feet that the tip leans on during one balance (tip_equilibrium.h, Corners): at most kMaxFeet, their
/// shares of the force, and the linear algebra that makes their overlaps equal.
class FeetInUse {
 public:
  int count() const noexcept { return count_; }
  FootMemory& memory(int i) noexcept { return feet_[i].memory; }
  void clear() noexcept { count_ = 0; }
  /// False if there is no room.
  bool add(const FootMemory& memory, const SurfaceContact& contact, double share) noexcept;
  /// False if it is one of those in use already, or there is no room.
  bool add_if_new(const FootMemory& memory, const SurfaceContact& contact) noexcept;
  void replace_least(const FootMemory& memory, const SurfaceContact& contact) noexcept;
  void update(int i, const SurfaceContact& contact) noexcept { feet_[i].contact = contact; }
  void keep_deepest() noexcept;

  /// To be called once the contacts are known at the present position: merges feet that have become one.
  void measure(double tip_radius_nm) noexcept;

  /// Largest eigenvalue of F·N, at most: from the feet's principal curvatures as seen from the centre.
  double turning(double force_nn) const noexcept;
  Mat3 normal_turn() const noexcept;         ///< Σ share·N
  Vec3 normal() const noexcept;              ///< Σ share·n
  double radius_nm() const noexcept;         ///< Σ share·R_eff
  double origin_radius_nm() const noexcept;  ///< Σ share·R_eff before any mark
  Vec3 radius_gradient() const noexcept;     ///< Σ share·∇R_eff
  bool radius_clamped() const noexcept;
  bool outside() const noexcept;
  double overlap_nm() const noexcept;  ///< largest

  /// The scalar balance that is left when the overlaps are made equal: δ = base_overlap − compliance·F,
  /// β = b0 − b1·F for the feet after the first.
  struct Reduced {
    double base_overlap_nm = 0;
    double compliance = 0;
    std::array<double, kMaxFeet - 1> b0{};
    std::array<double, kMaxFeet - 1> b1{};
  };
  /// The law sees the overlap along the normals and `tilt_w`; `slope_w` is the change of the other forces
  /// with F. May drop feet whose normals say nothing new.
  Reduced reduce(const Mat3& compliance, const Vec3& unloaded_step, const Vec3& tilt_w,
                 const Vec3& slope_w) noexcept;
  /// Shares at this force. True if a foot was dropped for a negative share.
  bool share(const Reduced& reduced, double force_nn) noexcept;

  void store(TipState& state) const noexcept;
  void store(TipFlow& flow) const noexcept;

 private:
  struct Foot {
    FootMemory memory;
    SurfaceContact contact;
    double share = 0;
    double overlap_nm = 0;
  };
  void drop(int i) noexcept;
  void normalise() noexcept;

  std::array<Foot, kMaxFeet> feet_;
  int count_ = 0;
};

}  // namespace telenano::physics

#pragma once

#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/contact/joined_law.h"
#include "telenano/nve_server/physics/contact/maugis_dugdale.h"
#include "telenano/nve_server/physics/long_range/van_der_waals.h"

namespace telenano::physics {

/// What turns the dimensionless law into nm, nN, aJ at one radius.
struct ContactScales {
  double length_nm = 0;   ///< u_a = (pi w R^2/K)^(1/3), of contact radii
  double overlap_nm = 0;  ///< u_delta = (pi^2 w^2 R/K^2)^(1/3)
  double force_nn = 0;    ///< u_F = pi w R
  double energy_aj = 0;   ///< u_F u_delta
  double lambda = 0;      ///< 2 sigma0 (R/(pi w K^2))^(1/3)
};

/// The adhesion of tip and sample in one medium: in air, or under the liquid of a bridge.
class ContactMedium {
 public:
  ContactMedium() = default;
  /// `cut_off_nm` = z0 of Maugis–Dugdale = a0 of van der Waals, which goes with w (H = 12 pi a0^2 w).
  ContactMedium(double work_of_adhesion_n_m, double contact_modulus_gpa, double cut_off_nm,
                bool van_der_waals) noexcept
      : work_of_adhesion_n_m_(work_of_adhesion_n_m),
        cbrt_(det_cbrt(kPi * work_of_adhesion_n_m / contact_modulus_gpa)),
        // sigma0 = 16/(9 sqrt(3)) w/z0 (the greatest stress of the Lennard-Jones law)
        sigma0_over_w_(16.0 / (9.0 * std::sqrt(3.0)) / cut_off_nm) {
    if (van_der_waals) van_der_waals_ = VanDerWaals::from_adhesion(work_of_adhesion_n_m, cut_off_nm);
  }

  double work_of_adhesion_n_m() const noexcept { return work_of_adhesion_n_m_; }
  /// Without Hamaker constant if there is no van der Waals outside.
  const VanDerWaals& van_der_waals() const noexcept { return van_der_waals_; }

  ContactScales scales(double radius_nm) const noexcept {
    const double r = det_cbrt(radius_nm);
    ContactScales s;
    s.length_nm = cbrt_ * r * r;
    s.overlap_nm = cbrt_ * cbrt_ * r;
    s.force_nn = kPi * work_of_adhesion_n_m_ * radius_nm;
    s.energy_aj = s.force_nn * s.overlap_nm;
    s.lambda = (2.0 / kPi) * sigma0_over_w_ * s.overlap_nm;
    return s;
  }

 private:
  double work_of_adhesion_n_m_ = 0;
  double cbrt_ = 0;  // (pi w/K)^(1/3)
  double sigma0_over_w_ = 0;
  VanDerWaals van_der_waals_;
};

struct ContactMedia {
  ContactMedium dry;
  ContactMedium wet;
  const ContactMedium& of(bool is_wet) const noexcept { return is_wet ? wet : dry; }
};

/// The cache of Maugis–Dugdale in another medium: nothing of the last one's curve is a guess for this one's.
template <class Cache>
void enter(const ContactMedia& media, bool wet, double radius_nm, Cache& cache) noexcept {
  cache.wet = wet;
  cache.radius_nm = radius_nm;
  cache.scales = media.of(wet).scales(radius_nm);
  cache.curve = MaugisDugdale(cache.scales.lambda);
  cache.outside = OutsideLaw(cache.scales.lambda);
  cache.has_handover = cache.has_parting = false;
  cache.handover_ratio[0] = cache.handover_ratio[1] = 0;
  cache.u = 0;
  cache.has_last = false;
  cache.fold_radius_nm = -1;
  cache.far_radius_nm = -1;
}

}  // namespace telenano::physics

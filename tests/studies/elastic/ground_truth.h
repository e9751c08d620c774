#pragma once

#include <functional>
#include <vector>

#include "telenano/common/surface/height_grid.h"
#include "telenano/nve_server/physics/potential/branch_potential.h"
#include "telenano/nve_server/physics/surface/contact_fields.h"
#include "tests/studies/elastic/places.h"

/// How far the product's ground and law are from elasticity at the places of a table.
namespace telenano::elastic {

/// Force along z (nN, up positive) at an apex height above a place's first touch (nm).
using ForceOf = std::function<double(double above_touch_nm)>;

/// −∂U/∂z at an overlap and radius on the way out: of the inner branch up to where it is left, then of the
/// outer one.
double retraction_force_nn(const physics::BranchPotential& law, const physics::ContactJet& jet) noexcept;
/// −∂U/∂x of the inner branch, where the tip is pressed.
double lateral_force_nn(const physics::BranchPotential& law, const physics::ContactJet& jet) noexcept;
/// That over the flat sample, for a tip of the radius.
ForceOf flat_force(const physics::BranchPotential& law, double radius_nm);

/// The height at which the model's flat sample pushes as the reference's does at `above_touch_nm`, where both
/// are pressed: Lennard and Jones' bodies touch a z0 earlier than Dugdale's, which says nothing of the ground.
double same_flat_force_nm(const Place& flat, const ForceOf& on_flat, double above_touch_nm);

/// The greatest attraction between 0.2 nm below and `to_nm` above first touch, to 2 pm of height. Soft samples come off
/// higher than 3 nm.
double pull_off_nn(const ForceOf& force, double to_nm = 3);

/// One place against its reference.
struct PlaceError {
  double pull_off_ratio = 0;               ///< pull-off over that of the flat sample, by the model
  double reference_ratio = 0;              ///< the same by the reference
  double pressed_error_nn2 = 0;            ///< sum of squares over the states pressed by 0.2 nm and more
  double pressed_square_nn2 = 0;           ///< of the reference's force there
  double pull_off_error() const noexcept;  ///< |ratio / reference − 1|
};
/// Lennard and Jones' attraction differs from Dugdale's also on the flat sample, which says nothing of the
/// ground: that difference, at the same height, is taken out.
PlaceError place_error(const Place& flat, const ForceOf& on_flat, const Place& place, const ForceOf& force);

/// Root of the summed squares of error over those of force.
double pressed_error(const std::vector<PlaceError>& places);

/// Linear between the ordered values; q from 0 to 1, at least one value.
double quantile(std::vector<double> values, double q);

/// Of a quantile, by `resamples` samples with replacement: the 2.5th and 97.5th percentile. The same for the
/// same values.
struct Interval {
  double low = 0, high = 0;
};
Interval bootstrap(const std::vector<double>& values, double q, int resamples = 2000);

/// 64 × 64 samples round a place, fewer at a rim; the place's (x, y) stays.
surface::HeightGrid piece_round(const surface::HeightGrid& scan, int column, int row);

}  // namespace telenano::elastic

#pragma once

#include <functional>
#include <vector>

#include "telenano/common/surface/height_grid.h"
#include "telenano/nve_server/physics/potential/branch_potential.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "tests/studies/elastic/places.h"

/// How far the product's ground and law are from elasticity at the places of a table.
namespace telenano::elastic {

/// Force along z (nN, up positive) at an apex height above a place's first touch (nm).
using ForceOf = std::function<double(double above_touch_nm)>;

/// −∂U/∂z at an overlap and radius on the way out: of the inner branch up to where it is left, then of the
/// outer one.
double retraction_force_nn(const physics::BranchPotential& law, const physics::ContactJet& jet) noexcept;
/// What a tip feels of the ground at an apex height above a place's first touch (nm), and the cosine of its feet there.
using ContactOf = std::function<void(double above_touch_nm, physics::ContactJet& jet, double& cosine)>;
/// −∂U/∂z on the way out as boundary elements with vertical displacements see the same ground.
///
/// Derivation  On a plane whose normal has the cosine c, the half-space turns with the plane: a sphere that is v too low
///             has the overlap vc, and is pushed up by c F_R(vc), with Hertz c^(5/2) (4/3)E*√R v^(3/2). Elements that
///             move along z only have the vertical gap x²/(2Rc³) + y²/(2Rc), an overlap v and a radius Rc²: their force
///             is F_{Rc²}(v), with Hertz c (4/3)E*√R v^(3/2), too much by c^(−3/2): 8 % at 18 degrees, 24 % at 30. That
///             is an error of the elements, not of the ground's: so the ground is given to the law as the elements
///             would give it, (δ/c, ρ + 2 ln c).
/// Validity    Feet less steep than 30 degrees or so. On the flanks of a valley no half-space is right.
ForceOf vertical_force(const physics::BranchPotential& law, ContactOf contact);
/// At the softening that the ground has by itself.
ContactOf contact_of(const physics::ScanFields& fields, double x_nm, double y_nm, double touch_nm);
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
  double cosine = 1;                       ///< of the feet, pressed by 0.4 nm
  double pull_off_error() const noexcept;  ///< |ratio / reference − 1|
};
/// Lennard and Jones' attraction differs from Dugdale's also on the flat sample, which says nothing of the
/// ground: that difference, at the same height, is taken out.
PlaceError place_error(const physics::BranchPotential& law, const Place& flat, const ForceOf& on_flat,
                       const Place& place, const ContactOf& contact);
/// Feet steeper than 30 degrees: elements that move along z only are a formal reference there.
bool is_steep(const PlaceError& place) noexcept;
std::vector<PlaceError> without_steep(const std::vector<PlaceError>& places);

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

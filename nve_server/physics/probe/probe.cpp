#include "telenano/nve_server/physics/probe/probe.h"

#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/numerics/require.h"

namespace telenano::physics {
namespace {

constexpr double kTiltMax_deg = 45.0;

[[noreturn]] void fail(const char* what) {
  throw UserError(std::string("probe: ") + what);
}

bool positive(double value) {
  return std::isfinite(value) && value > 0.0;
}

// What the beam's frame T knows of the probe.
struct Lever {
  double stiffness_n_m = 0;
  Compliance compliance_nm_nn = Compliance::Zero();
  Vec3 optical_nm_nn = Vec3::Zero();
  Vec3 twist_rad_nn = Vec3::Zero();
};

Lever given(const ProbeParameters& p) {
  const auto compliance = [](const std::optional<double>& stiffness, const char* what) {
    if (!stiffness) return 0.0;
    require(positive(*stiffness), what, *stiffness);
    return 1.0 / *stiffness;
  };
  Lever lever;
  lever.compliance_nm_nn(2, 2) =
      compliance(p.stiffness_n_m, "probe: stiffness must be positive and finite (N/m)");
  lever.compliance_nm_nn(0, 0) =
      compliance(p.lateral_stiffness_n_m, "probe: lateral stiffness must be positive and finite (N/m)");
  lever.compliance_nm_nn(1, 1) = compliance(
      p.longitudinal_stiffness_n_m, "probe: longitudinal stiffness must be positive and finite (N/m)");
  lever.stiffness_n_m = *p.stiffness_n_m;
  lever.optical_nm_nn.z() = lever.compliance_nm_nn(2, 2);
  return lever;
}

Lever beam(const BeamParameters& b) {
  require(positive(b.youngs_modulus_gpa),
          "probe: Young's modulus of the beam must be positive and finite (GPa)", b.youngs_modulus_gpa);
  require(b.poisson_ratio > -1.0 && b.poisson_ratio <= 0.5,
          "probe: Poisson's ratio of the beam must be above -1 and at most 0.5", b.poisson_ratio);
  require(positive(b.width_nm), "probe: width of the beam must be positive and finite (nm)", b.width_nm);
  require(positive(b.thickness_nm), "probe: thickness of the beam must be positive and finite (nm)",
          b.thickness_nm);
  require(positive(b.length_nm), "probe: length of the beam must be positive and finite (nm)", b.length_nm);
  require(std::isfinite(b.tip_height_nm) && b.tip_height_nm >= 0.0,
          "probe: tip height must be finite and not negative (nm)", b.tip_height_nm);
  // Slender, or the formulas are not those of a beam.
  require(b.thickness_nm <= b.width_nm, "probe: thickness of the beam must be at most its width (nm)",
          b.thickness_nm);
  require(b.width_nm <= b.length_nm, "probe: width of the beam must be at most its length (nm)", b.width_nm);
  require(b.tip_height_nm <= b.length_nm, "probe: tip height must be at most the length of the beam (nm)",
          b.tip_height_nm);

  const double slenderness = b.thickness_nm / b.length_nm;
  const double k = 0.25 * b.youngs_modulus_gpa * b.width_nm * slenderness * slenderness * slenderness;
  require(positive(k), "probe: stiffness of the beam must be positive and finite (N/m)", k);
  const double shear_gpa = 0.5 * b.youngs_modulus_gpa / (1.0 + b.poisson_ratio);
  const double flatness = b.thickness_nm / b.width_nm;
  const double rise = b.tip_height_nm / b.length_nm;
  // Twist per moment, L/(GJ), J = b t³/3.
  const double twist_per_nn_nm =
      3.0 * b.length_nm / (shear_gpa * b.width_nm * b.thickness_nm * b.thickness_nm * b.thickness_nm);
  Lever lever;
  lever.stiffness_n_m = k;
  lever.compliance_nm_nn(0, 0) =
      twist_per_nn_nm * b.tip_height_nm * b.tip_height_nm + flatness * flatness / k;
  lever.compliance_nm_nn(1, 1) = 3.0 * rise * rise / k;
  lever.compliance_nm_nn(1, 2) = lever.compliance_nm_nn(2, 1) = 1.5 * rise / k;
  lever.compliance_nm_nn(2, 2) = 1.0 / k;
  lever.optical_nm_nn = Vec3(0.0, 2.0 * rise / k, 1.0 / k);
  lever.twist_rad_nn.x() = -twist_per_nn_nm * b.tip_height_nm;
  return lever;
}

// T to W. A turn by −α about x lowers what lies ahead (y).
Mat3 orientation(double tilt_deg, ProbePoints points) {
  const SinCos tilt = det_sin_cos(tilt_deg * (kPi / 180.0));
  const double way = points == ProbePoints::kPlusY ? 1.0 : -1.0;
  Mat3 r;
  r << way, 0.0, 0.0,                       //
      0.0, way * tilt.cos, way * tilt.sin,  //
      0.0, -tilt.sin, tilt.cos;
  return r;
}

}  // namespace

Probe::Probe(const ProbeParameters& p) : rigid_(p.rigid) {
  const int kinds = (p.rigid ? 1 : 0) + (p.stiffness_n_m ? 1 : 0) + (p.beam ? 1 : 0);
  if (kinds != 1) fail("expected exactly one of rigid, a stiffness and a beam");
  if (!p.stiffness_n_m && (p.lateral_stiffness_n_m || p.longitudinal_stiffness_n_m)) {
    fail("lateral and longitudinal stiffness go with a given stiffness only");
  }
  require(p.tilt_deg >= 0.0 && p.tilt_deg <= kTiltMax_deg, "probe: tilt must be 0 to 45 degrees", p.tilt_deg);
  const Mat3 r = orientation(p.tilt_deg, p.points);
  normal_w_ = r.col(2);
  if (p.rigid) {
    if (p.mode) fail("a rigid probe has no mode");
    return;
  }
  const Lever lever = p.beam ? beam(*p.beam) : given(p);
  stiffness_n_m_ = lever.stiffness_n_m;
  compliance_ = r * lever.compliance_nm_nn * r.transpose();
  compliance_ = (0.5 * (compliance_ + compliance_.transpose())).eval();  // rounding
  optical_w_nm_nn_ = r * lever.optical_nm_nn;
  twist_w_rad_nn_ = r * lever.twist_rad_nn;
  rest_compliance_ = compliance_;
  if (!p.mode) return;
  mode_.emplace(stiffness_n_m_, p.mode->frequency_hz, p.mode->quality);
  const Vec3 shape_t = lever.compliance_nm_nn.col(2) * stiffness_n_m_;
  mode_shape_w_ = r * shape_t;
  // In T, where the mode's row and column vanish exactly.
  Compliance rest_t = lever.compliance_nm_nn - shape_t * shape_t.transpose() / stiffness_n_m_;
  rest_t.row(2).setZero();
  rest_t.col(2).setZero();
  rest_compliance_ = r * rest_t * r.transpose();
  rest_compliance_ = (0.5 * (rest_compliance_ + rest_compliance_.transpose())).eval();
}

}  // namespace telenano::physics

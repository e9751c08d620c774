#pragma once

#include <optional>

#include "telenano/nve_server/physics/equilibrium/tip_solution.h"
#include "telenano/nve_server/physics/probe/probe_mode.h"

namespace telenano::physics {

/// A rectangular beam, clamped at the base, with the tip standing on its free end.
struct BeamParameters {
  double youngs_modulus_gpa = 0;
  double poisson_ratio = 0;  ///< G = E/(2(1 + ν))
  double width_nm = 0;       ///< b
  double thickness_nm = 0;   ///< t
  double length_nm = 0;      ///< L
  double tip_height_nm = 0;  ///< h, apex to the middle of the thickness
};

enum class ProbePoints : unsigned char { kPlusY, kMinusY };

/// Where the first mode is: its stiffness is that of the probe.
struct ModeParameters {
  double frequency_hz = 0;
  double quality = 0;
};

/// A probe is rigid, or has given stiffnesses, or is a beam of given dimensions; exactly one of them.
struct ProbeParameters {
  bool rigid = false;
  std::optional<double> stiffness_n_m;               ///< k, normal to the beam
  std::optional<double> lateral_stiffness_n_m;       ///< with stiffness_n_m only; none = rigid there
  std::optional<double> longitudinal_stiffness_n_m;  ///< with stiffness_n_m only; none = rigid there
  std::optional<BeamParameters> beam;
  double tilt_deg = 0;  ///< by which the free end hangs lower than the clamped one, 0 to 45; typically 11
  ProbePoints points = ProbePoints::kPlusY;  ///< from the clamped end to the free one, seen from above
  std::optional<ModeParameters> mode;        ///< none: quasi-static at any rate
};

/// The probe between its base and the tip's apex: p = p_base + C F (quasi-static), C in W.
///
/// Frame T: y along the beam from the clamped to the free end, z its normal (up), x across; the apex hangs at
/// −h z from the free end. Euler–Bernoulli bending with EI = E b t³/12 and thin-strip torsion GJ = G b t³/3:
///
///   k   = E b t³/(4 L³)     bending by F_z: end deflection F_z/k, end slope 3 F_z/(2 L k)
///   1/k_x = 3 L h²/(G b t³) + 4 L³/(E t b³)     torsion (moment −h F_x about y), and sideways bending of the
///                                              lever, in series; 4 L³/(E t b³) = (t/b)²/k
///   k_y = L² k/(3 h²)       bending by the moment h F_y about x: end slope h F_y L/(EI) = 3 h F_y/(L² k)
///
/// A positive moment about x lifts the free end and moves the apex, below it, forward (+y): F_z moves the
/// apex along y by h · 3/(2 L k), and F_y along z by the same. Hence for the y–z block, in T,
///
///   C_T = [[1/k_y, 3h/(2Lk)], [3h/(2Lk), 1/k]],   det = (3/4) h²/(L² k²) > 0,
///
/// and in W, with R = (turn by 180° about z if the beam points along −y) · (turn by −tilt about x), C = R C_T
/// Rᵀ. So without tilt the cross compliance is + for a beam along +y and − along −y; with tilt α
///   C_zz = (cos²α/k)(1 − 3 (h/L) tan α + 3 (h/L)² tan²α).
///
/// Given only k, lateral or longitudinal stiffness, the beam is their diagonal in T, infinite where not
/// given.
///
/// Valid for small deflections of slender beams. Left out: shear (relative (t/L)²), axial stretch (t²/(12 h²)
/// of 1/k_y), J of a strip that is not thin (k_x is 0.63 t/b too high at small t/b), triangular levers.
/// Source: Neumeister & Ducker, Rev. Sci. Instrum. 65:2527 (1994); tilt: Heim, Kappl & Butt, Langmuir 20:2760
/// (2004), Hutter, Langmuir 21:2630 (2005).
///
/// The first mode (probe_mode.h), when asked for, has the shape of the statically bent beam: deflection q
/// moves the apex by q u, u = C n/(nᵀCn) with n the beam's normal, so that |u·n| = 1 and u leans along the
/// beam by 3h/(2L). The rest is C_rest = C − u uᵀ/k, positive semidefinite (the Schur complement: h²·3/(4L²k)
/// along y, 1/k_x along x), and stays quasi-static:
///   p = p_base + q u + C_rest F,   m q'' + c q' + k q = u·F;
/// at rest q = u·F/k, and p − p_base = C F as above. The base feels F.
class Probe {
 public:
  Probe() = default;  ///< rigid
  /// Throws UserError: one line that names the value and what is expected.
  explicit Probe(const ProbeParameters& parameters);

  /// C, in W, nm/nN: symmetric, positive semidefinite, 0 when rigid.
  const Compliance& compliance_nm_nn() const noexcept { return compliance_; }
  bool rigid() const noexcept { return rigid_; }
  double stiffness_n_m() const noexcept { return stiffness_n_m_; }  ///< k, normal to the beam; 0 when rigid
  const Vec3& normal_w() const noexcept { return normal_w_; }

  /// The first mode, none if the probe is quasi-static.
  const std::optional<ProbeMode>& mode() const noexcept { return mode_; }
  const Vec3& mode_shape_w() const noexcept { return mode_shape_w_; }  ///< u; 0 without a mode
  /// C_rest: what yields while the mode does not move; C without a mode.
  const Compliance& rest_compliance_nm_nn() const noexcept { return rest_compliance_; }

  /// What an optical lever reads under a static force on the apex, as the deflection that it was calibrated
  /// in: slope of the free end · 2L/3 = (F_z + (2h/L) F_y)/k in T, for a beam of given dimensions; else
  /// F_z/k. A force along the beam counts as a normal one, and the base-relative displacement of the apex, (C
  /// F)·n, is another again (it has 3h/(2L) F_y).
  double optical_deflection_nm(const Vec3& force_w_nn) const noexcept {
    return optical_w_nm_nn_.dot(force_w_nn);
  }
  /// Twist of the free end under a static force on the apex, −h F_x L/(GJ) in T, rad about the beam; 0 unless
  /// its dimensions are given.
  double optical_twist_rad(const Vec3& force_w_nn) const noexcept { return twist_w_rad_nn_.dot(force_w_nn); }

 private:
  bool rigid_ = true;
  double stiffness_n_m_ = 0;
  Compliance compliance_ = Compliance::Zero();
  Compliance rest_compliance_ = Compliance::Zero();
  Vec3 normal_w_ = Vec3::UnitZ();
  Vec3 mode_shape_w_ = Vec3::Zero();
  Vec3 optical_w_nm_nn_ = Vec3::Zero();
  Vec3 twist_w_rad_nn_ = Vec3::Zero();
  std::optional<ProbeMode> mode_;
};

}  // namespace telenano::physics

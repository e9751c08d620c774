#pragma once

#include "telenano/common/base/vec3.h"

namespace telenano::physics {

/// Friction of the tip on the sample, in the tangent plane of the contact: rate-independent, with memory.
///
/// Formula   limit T = tau pi a^2 + mu max(F, 0); bristle f = -k e, k = 8 G* a, |f| <= T;
///           1/G* = (2 - nu1)/G1 + (2 - nu2)/G2.
/// Symbols   a contact radius (nm) and F normal force (nN) of the contact law, tau interfacial shear strength
///           (GPa), mu coefficient of the part that grows with the load (0 for a single asperity), e
///           tangential deformation of the contact (nm), f force on the tip (nN).
/// Method    The tip does not turn, so that its contact slides over the sample by the tangential part of the
///           apex's own motion m. Backward Euler, with the radius at the end of the step: the trial e* = e' +
///           T m sticks if k|e*| <= T; otherwise it slips to the limit along itself, e = (T/k) e*/|e*|
///           (return mapping). At kinetic ratio r < 1 a contact that breaks away slips until it carries r T
///           only, and holds again up to T: stick–slip on whatever springs hold the tip.
/// Passivity Stored k e^2/2, dissipated T |e* - e| >= 0. Before each step the bristle is carried over to the
///           new contact: the turning normal turns it (the least rotation, length kept); a contact that grew
///           keeps the force (the new area is unstressed: e' = e k0/k), one that shrank keeps the
///           deformation (e' = e); both lower k e^2/2, and the difference is dissipated. No contact: the
///           bristle is released, and its energy dissipated. So over every step, to rounding,
///             -(f0' + f)/2 · (T m - slip) - f · slip = k e^2/2 - k e'^2/2 + T |slip|.
/// Validity  Uniform shear strength, that of the interface (10 MPa to 1 GPa); slip anywhere in the contact
///           before all of it slides (Mindlin's annulus) is left out: the bristle is stiffer than the partial
///           slip by up to a factor that grows from 1 to infinity near the limit.
/// Source    R. D. Mindlin, J. Appl. Mech. 16 (1949) 259 (k); R. W. Carpick and M. Salmeron, Chem. Rev. 97
///           (1997) 1163 (T = tau pi a^2); J. C. Simo and T. J. R. Hughes, Computational Inelasticity (1998)
///           (return mapping).
struct FrictionParameters {
  double shear_strength_gpa = 0;  ///< tau
  double shear_modulus_gpa = 0;   ///< G*
  double coefficient = 0;         ///< mu
  double kinetic_ratio = 1;       ///< r in (0, 1]
};

/// The bristle between two steps.
struct FrictionState {
  Vec3 extension_w_nm = Vec3::Zero();  ///< e, perpendicular to the normal
  Vec3 normal_w = Vec3::UnitZ();       ///< of length 1
  double stiffness_n_m = 0;            ///< k; 0 without contact
};

/// What a motion makes of the bristle.
struct FrictionStep {
  FrictionState after;
  Vec3 force_w_nn = Vec3::Zero();  ///< on the tip
  Vec3 slip_w_nm = Vec3::Zero();
  double stored_aj = 0;
  double dissipated_aj = 0;  ///< by slip and by the changed contact, >= 0
  bool sliding = false;
  // For Newton's method: how the force changes with the motion, the contact radius, and the normal force.
  Mat3 stiffness_n_m = Mat3::Zero();  ///< -df/dm, symmetric, positive semidefinite
  Vec3 force_per_radius_w_n_m = Vec3::Zero();
  Vec3 force_per_load_w = Vec3::Zero();
};

class Friction {
 public:
  /// Throws UserError unless strength and coefficient are finite, >= 0 and one of them positive, the modulus
  /// is finite and positive, and the kinetic ratio lies in (0, 1].
  explicit Friction(const FrictionParameters& parameters);

  const FrictionParameters& parameters() const noexcept { return parameters_; }
  double limit_nn(double contact_radius_nm, double normal_force_nn) const noexcept;
  double stiffness_n_m(double contact_radius_nm) const noexcept;

  /// Moves the tip by `moved_w_nm` to a contact of this normal (length 1), radius and force. `breaking`: the
  /// contact has let go in this step, and carries kinetic_ratio of the limit.
  FrictionStep move(const FrictionState& from, const Vec3& normal_w, const Vec3& moved_w_nm,
                    double contact_radius_nm, double normal_force_nn, bool breaking) const noexcept;
  /// The same, with nothing in what is for Newton's method.
  FrictionStep move_once(const FrictionState& from, const Vec3& normal_w, const Vec3& moved_w_nm,
                         double contact_radius_nm, double normal_force_nn, bool breaking) const noexcept;
  /// Both into `step`, in place: some hundred bytes that loops need not copy.
  void move(const FrictionState& from, const Vec3& normal_w, const Vec3& moved_w_nm, double contact_radius_nm,
            double normal_force_nn, bool breaking, FrictionStep& step) const noexcept;
  void move_once(const FrictionState& from, const Vec3& normal_w, const Vec3& moved_w_nm,
                 double contact_radius_nm, double normal_force_nn, bool breaking,
                 FrictionStep& step) const noexcept;

 private:
  template <bool kTangents>
  void moved(const FrictionState& from, const Vec3& normal_w, const Vec3& moved_w_nm,
             double contact_radius_nm, double normal_force_nn, bool breaking,
             FrictionStep& step) const noexcept;

  FrictionParameters parameters_;
};

}  // namespace telenano::physics

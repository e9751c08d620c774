#pragma once

#include <complex>
#include <vector>

/// An oracle for forces on rough ground, independent of the product's laws and fields: a linear elastic
/// half-space under a rigid tip, by boundary elements with the Fourier transform.
///
/// Model     N × N elements on a periodic square of side L. u is the surface's displacement towards the tip,
///           p the traction that pulls it there:  û(k) = 2 p̂(k)/(E* |k|)  (Johnson, Contact Mechanics, 1985,
///           ch. 13; vertical displacements only). The mean: an isolated contact on a square patch that
///           repeats would otherwise be too stiff or too soft as a whole, ū = p̄ L/(0.8055 E*) (validated by
///           Hertz's contact). Adhesion between facing elements after Lennard and Jones, w its work, z0 its
///           range:
///             p(g) = (8w/3z0) [(z0/g)³ − (z0/g)⁹],  g = z + tip − ground − u.
///           Without adhesion g >= 0, p <= 0, p g = 0 (Polonsky and Keer's conjugate gradients, Wear 231
///           (1999) 206).
///           Adhesion of no range (Johnson, Kendall and Roberts; soft samples): an element comes off where its
///           pull exceeds √(E* w/(0.473 h)), h its width, which lets go of as much elastic energy as w costs
///           (Pohrt and Popov, Facta Universitatis Mech. Eng. 13 (2015) 3; here with a constant of its own, as
///           the elements are waves').
/// Units     nm, GPa, N/m, nN.
/// Validity  Slopes small enough for the half-space; contact radius below 0.15 L; elements below z0 and below
///           the width E* z0²/w over which the attraction falls off at a rim, else the attraction is felt at
///           single elements. Without range: some sixteen elements to a contact radius.
namespace telenano::testing {

class ElasticPatch {
 public:
  /// N a power of two.
  ElasticPatch(int n, double side_nm, double modulus_gpa);

  int count() const { return n_; }
  double spacing_nm() const { return side_ / n_; }
  /// Of element i along x or y, from the middle of the patch.
  double offset_nm(int i) const {
    const int middle = n_ / 2;
    return (i - middle) * spacing_nm();
  }

  /// Force on the tip (up positive, nN) without adhesion; `gap` of the undeformed ground, element (i, j) at
  /// j·N + i.
  double press(const std::vector<double>& gap) const;

  struct Adhesion {
    double work_n_per_m = 0.4;
    double range_nm = 0.165;
  };
  /// The same with adhesion, from the displacement u on (in: the last state, so that a path is followed; out:
  /// the balance). NaN if Newton's method finds none.
  double adhere(const std::vector<double>& gap, const Adhesion& adhesion, std::vector<double>& u) const;
  /// What touches, and the traction that pulls there (GPa, negative: presses).
  struct Touching {
    std::vector<char> element;
    std::vector<double> pull_gpa;
  };
  /// The force with adhesion of no range, from the state on (in: the last, so that a path is followed; empty:
  /// nothing touches. Out: the balance). NaN if none is found.
  double stick(const std::vector<double>& gap, double work_n_per_m, Touching& state) const;

  /// Traction that pulls element by element at a state of adhere(), GPa.
  static std::vector<double> pull_gpa(const std::vector<double>& gap, const Adhesion& adhesion,
                                      const std::vector<double>& u);

 private:
  void transform(std::vector<std::complex<double>>& a, bool back) const;
  /// Multiplies each wave by f(stiffness E*|k|/2 of that wave).
  template <class F>
  void filter(const std::vector<double>& in, std::vector<double>& out, const F& f) const;

  int n_;
  double side_, modulus_;
  std::vector<double> stiffness_;  // of a wave, GPa/nm
  std::vector<std::complex<double>> turn_;
};

/// Height of a sphere's underside above its apex at a distance from its axis; beyond its radius out of reach.
double sphere_profile(double radius_nm, double x_nm, double y_nm);

}  // namespace telenano::testing

#pragma once

#include <functional>
#include <string>
#include <vector>

/// Time stepping of the virtual coupling against a contact, one axis, no mass: what could be done instead of
/// what the slave does.
///
///   b de/dt + k e = F(u − e),  e = u − δ the coupling's extension, u the commanded end, δ the tip's overlap
///
/// All in overlaps (positive into the sample), N/m, N·s/m, s.
namespace telenano::studies {

struct ContactForce {
  double force = 0;
  double slope = 0;  ///< dF/dδ
};
using ContactLaw = std::function<ContactForce(double overlap)>;

struct CouplingStep {
  double stiffness = 20;
  double damping = 0;
  double dt_s = 1e-3;
};

/// The next extension from the last one, the ends before and after, and the law; adding a scheme is adding an
/// entry to coupling_schemes().
struct CouplingScheme {
  std::string family;
  std::string setting;
  bool is_default = false;
  std::function<double(double extension, double end_before, double end_after, const CouplingStep&,
                       const ContactLaw&)>
      next;
  /// Largest stable stiffness of a linear contact, from the growth factor (see coupling_schemes.cpp).
  std::function<double(const CouplingStep&)> stable_until;
};

std::vector<CouplingScheme> coupling_schemes();

/// Does a disturbance die out against a linear contact of this stiffness? By running it.
bool is_stable(const CouplingScheme& scheme, const CouplingStep& step, double contact_stiffness);

}  // namespace telenano::studies

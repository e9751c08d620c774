#pragma once

#include "telenano/nve_server/physics/contact/contact_law.h"

namespace telenano::physics {

/// The closed-form contact laws, without dimensions (units of maugis_dugdale.h), as members of one family.
///
/// Formula   With the contact radius A and B = sqrt(A),
///             P = (sqrt(kappa) B^3 - p)^2 - L,   Delta = B^4 - k B^m,
///           so L is the pull-off under load control, reached at B^3 = p/sqrt(kappa).
///           Hertz     kappa = 1, p = 0, L = 0, k = 0:         P = Delta^1.5.
///           DMT       kappa = 1, p = 0, L = 2, k = 0:         P = Delta^1.5 - 2.
///           Schwarz   JKR of the work t^2 w and DMT of the rest: P = A^3 - t A sqrt(6 A) - 2 (1 - t^2),
///                     Delta = A^2 - (2/3) t sqrt(6 A): kappa = 1, p = t sqrt(6)/2, L = 2 - t^2/2,
///                     k = (2/3) sqrt(6) t, m = 1. t is taken so that L is that of COS:
///                     t^2 = 4.04 lambda^1.4/(1 + 4.04 lambda^1.4).
///           JKR       Schwarz with t = 1.
///           PT        With g = (alpha + x)/(1 + alpha), x = sqrt(1 + P/L) (negative on the branch below the
///                     pull-off): A = A0 g^(2/3), Delta = A0^2 (g^(4/3) - S g^(2 beta/3)); since
///                     g = (A/A0)^1.5, kappa = L (1 + alpha)^2/A0^3, p = alpha sqrt(L), k = S A0^(2 - beta),
///                     m = 2 beta, with their fits of A0, L, S, beta in alpha.
///           COS       Gives A(P) only, by the same formula with A0 and L fitted in lambda. It has no
///                     overlap; it is completed by S and beta of PT, which were made for this A(P).
///           alpha     of COS and PT from lambda = -0.924 ln(1 - 1.02 alpha).
/// Validity  Hertz without adhesion; DMT lambda -> 0, JKR lambda -> infinity, the others for any lambda. S of
///           PT turns negative below alpha = 0.004 (lambda = 0.004), where its fit ends; it is then taken as
///           0, and never so large that the overlap would fold before the load.
/// Errors    Of the model, |P - P_MD|/max(|P_MD|, 1) at worst over Delta = -0.5 ... 10 where both have a
///           state, and of the load-controlled pull-off, against Maugis–Dugdale in 50 digits
///           (tests/unit/physics/closed_form_laws_test.cpp):
///             lambda              0.01        0.1         0.5         1           3           10
///             Hertz             180/-100 %  150/-100 %  132/-100 %  125/-100 %  121/-100 %  120/-100 %
///             DMT              24.4/0.1    55.1/2.5    76.7/16.4   82.2/24.9   85.8/31.9   86.5/33.2
///             JKR              63.6/-24.9  34.1/-23.1  12.9/-12.7   6.6/-6.3    1.2/-1.1   0.12/-0.11
///             Schwarz          23.8/-0.1   42.1/-1.0   23.0/-1.2   12.0/-0.1    3.4/0.6     0.7/0.2
///             COS               3.2/-0.1   19.4/-1.0    9.8/-1.2   11.8/-0.1    4.1/0.6     1.7/0.2
///             PT                8.5/-0.3    7.5/-1.3    2.1/0.7     1.0/0.9     0.4/-0.2    0.2/0.2
/// Source    Hertz, J. reine angew. Math. 92 (1882) 156. Derjaguin, Muller, Toporov, J. Colloid Interface
///           Sci. 53 (1975) 314. Johnson, Kendall, Roberts, Proc. R. Soc. A 324 (1971) 301. Carpick,
///           Ogletree, Salmeron, J. Colloid Interface Sci. 211 (1999) 395. Piétrement, Troyon, J. Colloid
///           Interface Sci. 226 (2000) 166. Schwarz, J. Colloid Interface Sci. 261 (2003) 99.
struct ClosedFormCoefficients {
  double kappa = 1;
  double p = 0;
  double pull_off = 0;  ///< L >= 0
  double k = 0;
  double m = 1;
};

/// Any model but Maugis–Dugdale.
ClosedFormCoefficients closed_form_coefficients(ContactLaw model, double lambda) noexcept;

}  // namespace telenano::physics

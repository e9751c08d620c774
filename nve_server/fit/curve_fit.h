#pragma once

#include <optional>
#include <string>
#include <vector>

#include "telenano/nve_server/fit/prepared_curve.h"
#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::fit {

/// What is known, and what is looked for.
struct FitSetup {
  physics::TipSampleParameters law;  ///< start of w and z0; its modulus is replaced; direct method
  double radius_nm = 0;              ///< of the tip
  double compliance_nm_nn = 0;       ///< of the lever along z, base held
  double stiffness_error = 0;     ///< standard deviation of the logarithm of its stiffness: in the intervals
  double sample_modulus_gpa = 0;  ///< E, start
  double sample_poisson = 0;
  double tip_compliance_per_gpa = 0;  ///< (1 − ν²)/E of the tip's material
  double modulus_min_gpa = 1e-4;      ///< of E; an interval that reaches one of them is open
  double modulus_max_gpa = 2000;
  bool fit_radius = false;
  bool fit_distance = false;  ///< z0, with it the Hamaker constant 12π z0² w
  bool fit_hamaker = false;   ///< that constant itself; z0 then follows from it and w. Not with fit_distance
  std::optional<double> hamaker_aj;  ///< held, or with fit_hamaker the start; none: z0 is held
  bool fit_humidity = false;         ///< of a law with a capillary bridge: how far it reaches
  bool fit_film = false;   ///< both adsorbed films: the gap at which the bridge forms; more than 0 to begin
  bool fit_shift = false;  ///< of z between the two ways: drift or hysteresis of the piezo
};

/// A parameter with its 95 % interval; an end that the curve does not show is empty.
struct Estimate {
  std::string name;
  std::string unit;
  double value = 0;
  std::optional<double> low;
  std::optional<double> high;
  double sensitivity_stiffness = 0;  ///< d ln(value)/d ln k of the lever
  double sensitivity_invols = 0;     ///< d ln(value)/d ln(deflection's scale)
  double sensitivity_radius = 0;     ///< d ln(value)/d ln R; 0 where R is fitted
};

struct FitSegment {
  std::vector<double> model_nm;     ///< deflection with baseline
  std::vector<double> residual_nm;  ///< measured − model
  std::vector<char> used;           ///< 0: between the leap of the curve and the model's
};

struct CurveFit {
  std::vector<Estimate>
      estimates;  ///< E, w, then R, z0, H, humidity and film where fitted; w is absent without adhesion
  std::vector<std::vector<double>> correlation;  ///< of the logarithms of the estimates
  double modulus_gpa = 0;
  double work_n_m = 0;
  double radius_nm = 0;
  double distance_nm = 0;
  double contact_modulus_gpa = 0;  ///< K
  double lambda = 0;               ///< Maugis's; 0 without adhesion
  double hamaker_aj = 0;           ///< 12π z0² w; 0 without van der Waals
  double humidity_percent = 0;
  double film_nm = 0;
  double touch_z_nm = 0;
  double shift_nm = 0;
  double rms_nm = 0;    ///< of the residuals that count
  double noise_nm = 0;  ///< of the free part
  double reduced = 0;   ///< sum of the whitened residuals' squares over their number
  double left_correlation =
      0;  ///< of whitened residuals with their neighbours: 0 if the noise is all that is left
  int starts = 0;
  int starts_agree = 0;  ///< that end within 1 % of the best cost
  long evaluations = 0;
  FitSegment approach;
  FitSegment retract;
  std::vector<std::string> notes;  ///< what the curve cannot tell
  std::string error;
};

/// Both ways of a curve by the exact law with the lever in the loop.
///
/// Model     The base at height z leaves an overlap x = touch − z without force; the path of curve_path.h
///           gives the force F(x), and the deflection measured is c·F + offset + tilt·(z − z̄) with offset and
///           tilt for each way. Free: ln of the sample's E, w, and as asked R and z0; touch, offsets and
///           tilts. The lever's stiffness is never free: F → sF with k, K and w → s times theirs leaves every
///           deflection as it is, so a quasi-static curve alone cannot tell it.
/// Leaps     A point that lies on one side of a leap and on the other in the model would pull at no parameter
///           but by its whole height. Such points are left out; instead the place of a leap is compared:
///           (z of the curve − z of the model) over what it is known to.
/// Noise     Residuals are whitened by the noise of the free part (noise_model.h); where the deflection
///           changes with z, noise of z is added. Huber's loss (P. J. Huber, Ann. Math. Statist. 35 (1964)
///           73) beyond three standard deviations.
/// Search    Levenberg–Marquardt (D. W. Marquardt, J. SIAM 11 (1963) 431) from several starts: the modulus of
///           Hertz's stiffness at the deepest part and its multiples, w from the pull-off.
/// Intervals Profile likelihood at 95 % (D. J. Venzon, S. H. Moolgavkar, Appl. Statist. 37 (1988) 87): cost
///           above its least by 3.84/2 times the reduced sum of squares if that is more than 1.
/// Same arguments, same bits. Never throws but for want of memory.
CurveFit fit_curve(const PreparedCurve& curve, const FitSetup& setup);

}  // namespace telenano::fit

#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace telenano::fit {

/// Spectral density of a lever's free deflection, one-sided: ∫ density df from 0 is the mean square.
struct Spectrum {
  std::vector<double> frequency_hz;
  std::vector<double> density;  ///< nm²/Hz, or V²/Hz
  bool in_volts = false;
  std::string what;   ///< for a person
  std::string error;  ///< not empty: what is wrong, one line without the file's name
};

/// A table (see read_csv) with columns like "frequency_khz" and "psd_nm2_hz" (m2, nm2, pm2, fm2 or V2, mV2 per Hz), or
/// a series with "time_s" in equal steps and "deflection_nm" (m, um, nm, pm, V, mV). A series becomes
/// periodograms of 2^n points each, as many as it holds and the largest first, so that all of it counts.
Spectrum read_spectrum(std::string_view bytes);

/// Which deflection is measured, and so what of the thermal motion is seen.
enum class LeverShape {
  kRectangular,  ///< by the lever's slope, calibrated by pressing on something rigid: 0.817
  kVShaped,      ///< the same for a V-shaped lever: 0.764
  kDisplacement  ///< the end's displacement itself (interferometer, or slope with its own calibration): 0.971
};

/// The mean square of the first mode as it is seen, times k, over k_B T.
///
/// Source    H.-J. Butt, M. Jaschke, Nanotechnology 6 (1995) 1: of the equipartition's k_B T/k the first mode of
///           a rectangular lever has 12/α⁴ = 0.971 with cos α cosh α = −1; by the slope, calibrated statically, it
///           seems (2/3 φ'/φ)² = 0.842 times as much: 0.817. R. W. Stark, T. Drobek, W. M. Heckl, Ultramicroscopy
///           86 (2001) 207, for a V-shaped one by finite elements: 0.764.
double thermal_share(LeverShape shape) noexcept;

struct ThermalSetup {
  double share = 0.817;  ///< thermal_share()
  double temperature_k = 295;
  std::optional<double> invols_nm_v{};  ///< for a spectrum in volts
  /// The band that is fitted; none: 0.5 to 1.5 times the peak's frequency, 0.2 to 3 times it for Q below 10.
  std::optional<double> low_hz{};
  std::optional<double> high_hz{};
};

/// The lever's stiffness by its thermal motion.
struct ThermalStiffness {
  double stiffness_n_m = 0;   ///< along z, as the curve's deflection is calibrated
  double relative_error = 0;  ///< standard deviation of its logarithm, by the spectrum's own scatter
  double frequency_hz = 0;
  double quality = 0;
  double mean_square_nm2 = 0;  ///< of the mode, as it is seen
  double floor_nm2_hz = 0;     ///< white noise under it
  double averages = 0;         ///< spectra that each density is the mean of, by its scatter
  double scatter_at_peak = 1;  ///< measured over fitted within f0/Q of the peak: 1 where the oscillator fits
  std::size_t points = 0;
  std::string error;
};

/// A simple harmonic oscillator and a white floor, S = A f0⁴/((f² − f0²)² + (f f0/Q)²) + B, by the likelihood of a
/// spectrum's values (P. Whittle, J. R. Stat. Soc. B 15 (1953) 125): Σ ln S + P/S. Mean square (π/2) A f0 Q.
///
/// Tilt      The deflection is calibrated by the base's way along z on something rigid. A lever tilted by θ then
///           bends by z/cos θ along its normal; its thermal motion along the normal is seen as cos θ times as much,
///           and a force along z bends it by cos θ/k. So share·k_B T/⟨z²⟩ is the stiffness along z, k/cos²θ (J. L.
///           Hutter, Langmuir 21 (2005) 2630; L.-O. Heim, M. Kappl, H.-J. Butt, Langmuir 20 (2004) 2760), whatever θ:
///           what a force curve needs.
/// Same arguments, same bits. Never throws but for want of memory.
ThermalStiffness stiffness_of(const Spectrum& spectrum, const ThermalSetup& setup);

}  // namespace telenano::fit

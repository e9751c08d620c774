#include "telenano/nve_server/app/sample/fit_lever.h"

#include <charconv>
#include <cmath>
#include <system_error>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/app/sample/fit_files.h"
#include "telenano/nve_server/fit/thermal_spectrum.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::app {
namespace {

/// Where the files of curves say a deflection sensitivity, the first one's.
std::optional<double> invols_of(const FitOptions& options) {
  const fit::Preparation given = preparation_of(options, 1.0);
  if (given.invols_nm_v || given.invols_from_stiff) return given.invols_nm_v;
  fit::ColumnChoice columns = options.columns;
  columns.number = options.number.value_or(0);
  return fit::read_curve(read_curve_bytes(options.curves[0]), columns).invols_nm_v;
}

MeasuredLever by_thermal_motion(const FitOptions& options) {
  const fit::Spectrum spectrum = fit::read_spectrum(read_curve_bytes(options.thermal));
  fit::ThermalSetup setup;
  setup.temperature_k = 273.15 + options.temperature_c;
  const fit::LeverShape shape = options.thermal_lever == "v-shaped"       ? fit::LeverShape::kVShaped
                                : options.thermal_lever == "displacement" ? fit::LeverShape::kDisplacement
                                                                          : fit::LeverShape::kRectangular;
  setup.share = fit::thermal_share(shape);
  if (spectrum.error.empty() && spectrum.in_volts) setup.invols_nm_v = invols_of(options);
  if (!options.thermal_band.empty()) {
    double low = 0, high = 0;
    if (!two_numbers(options.thermal_band, low, high, ':') || !(low > 0) || !(high > low) || !(high < 1e12)) {
      throw UserError("--thermal-band-hz is '" + fit::plain_line(options.thermal_band) +
                      "', expected LOW:HIGH in Hz, such as 5000:30000");
    }
    setup.low_hz = low;
    setup.high_hz = high;
  }
  const fit::ThermalStiffness found = fit::stiffness_of(spectrum, setup);
  if (!found.error.empty()) throw UserError(options.thermal + ": " + found.error);
  MeasuredLever lever{found.stiffness_n_m, found.relative_error, {}};
  lever.how = "thermal motion (" + spectrum.what + "): " + number_text(found.frequency_hz / 1e3) +
              " kHz, Q " + number_text(found.quality, 3) + ", " + number_text(found.mean_square_nm2) +
              " nm^2 at " + number_text(options.temperature_c, 3) + " C, share " +
              number_text(setup.share, 3) + ", measured over fitted at the peak " +
              number_text(found.scatter_at_peak, 3);
  return lever;
}

/// On something of stiffness K the base's way z is shared: deflection s z with s = K/(k + K), so k = K (1 − s)/s.
MeasuredLever by_reference(const FitOptions& options) {
  if (!options.reference_n_m)
    throw UserError("--reference-curve needs --reference-stiffness-n-m, the stiffness of the reference");
  if (!(*options.reference_n_m >= 1e-4 && *options.reference_n_m <= 1e5)) {
    throw UserError("--reference-stiffness-n-m is " + number_text(*options.reference_n_m) +
                    ", expected 1e-4 to 1e5 N/m");
  }
  const fit::RawCurve raw = fit::read_curve(read_curve_bytes(options.reference), options.columns);
  fit::Preparation how = preparation_of(options, 1.0);
  if (raw.error.empty() && raw.unit == fit::DeflectionUnit::kNanonewton)
    throw UserError(options.reference + ": contains forces: the deflection in nm or V is needed instead");
  if (raw.unit == fit::DeflectionUnit::kVolt && !raw.invols_nm_v && !how.invols_nm_v)
    how.invols_nm_v = invols_of(options);
  if (how.invols_from_stiff)
    throw UserError(
        "--invols-nm-v stiff cannot be used with --reference-curve: the reference yields, so it is not "
        "rigid");
  const fit::PreparedCurve curve = fit::prepare(raw, how);
  if (!curve.error.empty()) throw UserError(options.reference + ": " + curve.error);
  const fit::ReferenceSlope slope = fit::reference_slope(curve);
  if (!(slope.value > 0.02 && slope.value < 0.98)) {
    throw UserError(
        options.reference + ": its deflection grows by " + number_text(slope.value, 3) +
        " nm per nm of the base, expected 0.02 to 0.98: use a reference about as stiff as the lever");
  }
  MeasuredLever lever;
  lever.stiffness_n_m = *options.reference_n_m * (1.0 - slope.value) / slope.value;
  lever.error = slope.error / (slope.value * (1.0 - slope.value));
  lever.how =
      "a reference of " + number_text(*options.reference_n_m) + " N/m: slope " + number_text(slope.value);
  return lever;
}

}  // namespace

std::optional<MeasuredLever> measured_lever(const FitOptions& options) {
  if (!options.reference.empty()) return by_reference(options);
  if (!options.thermal.empty()) return by_thermal_motion(options);
  return std::nullopt;
}

fit::Preparation preparation_of(const FitOptions& options, double stiffness_n_m) {
  fit::Preparation how;
  how.stiffness_n_m = stiffness_n_m;
  how.invols_from_stiff = options.invols == "stiff";
  if (options.invols.empty() || how.invols_from_stiff) return how;
  double value = 0;
  const char* end = options.invols.data() + options.invols.size();
  const auto [read, error] = std::from_chars(options.invols.data(), end, value);
  if (error != std::errc() || read != end || !(value >= 0.01 && value <= 1e5)) {
    throw UserError("--invols-nm-v is '" + fit::plain_line(options.invols) +
                    "', expected a sensitivity of 0.01 to 1e5 nm/V, or stiff");
  }
  how.invols_nm_v = value;
  return how;
}

bool two_numbers(const std::string& text, double& first, double& second, char between) {
  const auto cross = text.find(between);
  if (cross == std::string::npos) return false;
  const char* const begin = text.data();
  const char* const end = begin + text.size();
  const auto a = std::from_chars(begin, begin + cross, first);
  const auto b = std::from_chars(begin + cross + 1, end, second);
  return a.ec == std::errc() && a.ptr == begin + cross && b.ec == std::errc() && b.ptr == end;
}

fit::FitSetup setup_of(const FitOptions& options, const scene::Scene& scene,
                       const std::optional<MeasuredLever>& lever) {
  if (scene.probe.origin == "rigid")
    throw UserError(scene.path + ": has a rigid probe: a curve is fitted with its lever, give stiffness_n_m");
  const char* const flag = options.stiffness_n_m        ? "--stiffness-n-m"
                           : !options.thermal.empty()   ? "--thermal"
                           : !options.reference.empty() ? "--reference-curve"
                                                        : nullptr;
  if (flag != nullptr && scene.probe.origin != "given") {
    throw UserError(scene.path + ": " + flag + " needs a scene with stiffness_n_m: its lever is a " +
                    scene.probe.origin);
  }
  fit::FitSetup setup;
  setup.law = scene.law_parameters;
  setup.radius_nm = options.radius_nm.value_or(scene.probe.tip_radius_nm);
  setup.compliance_nm_nn = scene.probe_compliance_nm_nn()(2, 2);
  if (options.stiffness_n_m)
    setup.compliance_nm_nn *= scene.cantilever.stiffness_n_m() / *options.stiffness_n_m;
  if (lever) {
    setup.compliance_nm_nn = 1.0 / lever->stiffness_n_m;
    setup.stiffness_error = lever->error;
  }
  setup.stiffness_error = std::hypot(setup.stiffness_error, 0.01 * options.stiffness_error_percent);
  setup.sample_modulus_gpa = scene.sample.youngs_modulus_gpa;
  setup.sample_poisson = scene.sample.poisson_ratio;
  const scene::Material& tip = scene.probe.tip;
  setup.tip_compliance_per_gpa = (1.0 - tip.poisson_ratio * tip.poisson_ratio) / tip.youngs_modulus_gpa;
  for (const std::string& name : options.also) {
    (name == "R"          ? setup.fit_radius
     : name == "H"        ? setup.fit_hamaker
     : name == "humidity" ? setup.fit_humidity
     : name == "film"     ? setup.fit_film
                          : setup.fit_distance) = true;
  }
  const bool water = setup.law.long_range.capillary.humidity_percent > 0;
  if ((setup.fit_humidity || setup.fit_film) && !water) {
    throw UserError(scene.path + ": has no capillary bridge, whose " +
                    (setup.fit_film ? "film" : "humidity") +
                    " could be fitted: give [forces.capillary] humidity_percent as a start");
  }
  if (setup.fit_hamaker && setup.fit_distance)
    throw UserError("--also H and --also z0 are the same unknown (H = 12 pi z0^2 w): choose one of them");
  if (options.hamaker_aj && setup.fit_distance)
    throw UserError("--hamaker-aj fixes what --also z0 fits (H = 12 pi z0^2 w): choose one of them");
  const bool tail = setup.law.van_der_waals && setup.law.model != physics::ContactLaw::kHertz;
  if ((setup.fit_hamaker || options.hamaker_aj) && !tail)
    throw UserError(scene.path + ": has no van der Waals forces, and so no Hamaker constant");
  if (options.hamaker_aj && !(*options.hamaker_aj >= 1e-7 && *options.hamaker_aj <= 1e4))
    throw UserError("--hamaker-aj is " + number_text(*options.hamaker_aj) + ", expected 1e-7 to 1e4 aJ");
  if (!setup.fit_distance) setup.hamaker_aj = options.hamaker_aj ? options.hamaker_aj : scene.hamaker_aj;
  setup.fit_shift = options.shift;
  return setup;
}

}  // namespace telenano::app

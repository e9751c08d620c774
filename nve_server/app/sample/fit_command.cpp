#include "telenano/nve_server/app/sample/fit_command.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/plot/gnuplot.h"
#include "telenano/nve_server/app/scene/scene_loading.h"
#include "telenano/nve_server/fit/curve_file.h"
#include "telenano/nve_server/fit/curve_fit.h"
#include "telenano/nve_server/fit/fitted_scene.h"
#include "telenano/nve_server/fit/parameter_map.h"
#include "telenano/nve_server/fit/prepared_curve.h"
#include "telenano/nve_server/fit/thermal_spectrum.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::app {
namespace {

constexpr std::size_t kFileBytesMax = std::size_t{1} << 28;
constexpr int kThreadsMax = 256;

struct Options {
  std::vector<std::string> curves;
  std::string scene;
  std::string out;
  std::string invols;  // nm/V, "stiff", or empty
  std::optional<double> stiffness_n_m;
  std::string thermal;  // file with the lever's thermal motion
  std::string thermal_lever = "rectangular";
  std::string thermal_band;  // LOW:HIGH, Hz
  double temperature_c = 22;
  std::string reference;  // a curve on something whose stiffness is known
  std::optional<double> reference_n_m;
  double stiffness_error_percent = 0;
  std::optional<double> radius_nm;
  std::optional<double> hamaker_aj;
  fit::ColumnChoice columns;
  std::optional<std::size_t> number;  // of the curve, in files with several
  std::vector<std::string> also;
  bool shift = false;
  std::string residuals;
  std::string plot;
  std::string table;
  std::string map;       // folder for pictures of what was found
  std::string map_grid;  // COLUMNSxROWS
  std::string map_size;  // WIDTHxLENGTH, nm
  int threads = 0;
  bool force = false;
};

/// One file on its way.
struct Curve {
  std::string path;
  std::string name;  // the path, and the curve's number in a file with several
  std::size_t number = 0;
  std::shared_ptr<const std::string> bytes;  // of a file with several
  std::string what;
  std::optional<double> stiffness_n_m;  // as the file has it
  std::vector<std::string> notes;
  fit::PreparedCurve prepared;
  fit::CurveFit fit;
};

std::string words(double value, int digits = 4) {
  std::ostringstream text;
  text.precision(digits);
  text << value;
  return text.str();
}

std::string read_bytes(const std::string& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found)
    throw UserError(path + ": there is no such file");
  if (status.type() != std::filesystem::file_type::regular)
    throw UserError(path + ": is no regular file, expected a force curve");
  const auto size = std::filesystem::file_size(path, error);
  if (!error && size > kFileBytesMax)
    throw UserError(path + ": has " + std::to_string(size) + " bytes, expected at most 256 MiB");
  std::ifstream file(path, std::ios::binary);
  if (error || !file) throw UserError(path + ": cannot be read: " + std::strerror(errno));
  std::string bytes(static_cast<std::size_t>(size), '\0');
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(file.gcount()));
  return bytes;
}

[[noreturn]] void cannot_write(const std::string& path) {
  throw RunError(path + ": cannot be written: " + std::strerror(errno));
}

/// The old file or the new one whole.
void write_text(const std::string& path, const std::string& text) {
  const std::string beside = path + ".part";
  std::FILE* file = std::fopen(beside.c_str(), "we");
  if (file == nullptr) cannot_write(path);
  bool good = std::fwrite(text.data(), 1, text.size(), file) == text.size() && std::fflush(file) == 0 &&
              ::fsync(::fileno(file)) == 0;
  good = std::fclose(file) == 0 && good;
  if (good && ::rename(beside.c_str(), path.c_str()) == 0) return;
  const int why = errno;
  ::unlink(beside.c_str());
  errno = why;
  cannot_write(path);
}

fit::Preparation preparation_of(const Options& options, double stiffness_n_m) {
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

/// "32x32", "500:250.5": two numbers.
bool two_numbers(const std::string& text, double& first, double& second, char between = 'x') {
  const auto cross = text.find(between);
  if (cross == std::string::npos) return false;
  const char* const begin = text.data();
  const char* const end = begin + text.size();
  const auto a = std::from_chars(begin, begin + cross, first);
  const auto b = std::from_chars(begin + cross + 1, end, second);
  return a.ec == std::errc() && a.ptr == begin + cross && b.ec == std::errc() && b.ptr == end;
}

/// The lever's stiffness along z as it was measured, and its relative standard deviation.
struct MeasuredLever {
  double stiffness_n_m = 0;
  double error = 0;
  std::string how;  // for a person
};

/// Where the files of curves say a deflection sensitivity, the first one's.
std::optional<double> invols_of(const Options& options) {
  const fit::Preparation given = preparation_of(options, 1.0);
  if (given.invols_nm_v || given.invols_from_stiff) return given.invols_nm_v;
  fit::ColumnChoice columns = options.columns;
  columns.number = options.number.value_or(0);
  return fit::read_curve(read_bytes(options.curves[0]), columns).invols_nm_v;
}

MeasuredLever by_thermal_motion(const Options& options) {
  const fit::Spectrum spectrum = fit::read_spectrum(read_bytes(options.thermal));
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
  lever.how = "thermal motion (" + spectrum.what + "): " + words(found.frequency_hz / 1e3) + " kHz, Q " +
              words(found.quality, 3) + ", " + words(found.mean_square_nm2) + " nm^2 at " +
              words(options.temperature_c, 3) + " C, share " + words(setup.share, 3) +
              ", measured over fitted at the peak " + words(found.scatter_at_peak, 3);
  return lever;
}

/// On something of stiffness K the base's way z is shared: deflection s z with s = K/(k + K), so k = K (1 − s)/s.
MeasuredLever by_reference(const Options& options) {
  if (!options.reference_n_m)
    throw UserError(
        "--reference-curve goes with --reference-stiffness-n-m, the stiffness that it was taken on");
  if (!(*options.reference_n_m >= 1e-4 && *options.reference_n_m <= 1e5)) {
    throw UserError("--reference-stiffness-n-m is " + words(*options.reference_n_m) +
                    ", expected 1e-4 to 1e5 N/m");
  }
  const fit::RawCurve raw = fit::read_curve(read_bytes(options.reference), options.columns);
  fit::Preparation how = preparation_of(options, 1.0);
  if (raw.error.empty() && raw.unit == fit::DeflectionUnit::kNanonewton)
    throw UserError(options.reference +
                    ": has forces: a deflection in nm or V is needed, from which they were made");
  if (raw.unit == fit::DeflectionUnit::kVolt && !raw.invols_nm_v && !how.invols_nm_v)
    how.invols_nm_v = invols_of(options);
  if (how.invols_from_stiff)
    throw UserError("--invols-nm-v stiff does not go with --reference-curve: what it pressed on gives way");
  const fit::PreparedCurve curve = fit::prepare(raw, how);
  if (!curve.error.empty()) throw UserError(options.reference + ": " + curve.error);
  const fit::ReferenceSlope slope = fit::reference_slope(curve);
  if (!(slope.value > 0.02 && slope.value < 0.98)) {
    throw UserError(options.reference + ": its deflection grows by " + words(slope.value, 3) +
                    " of the base's way, expected 0.02 to 0.98: a reference about as stiff as the lever");
  }
  MeasuredLever lever;
  lever.stiffness_n_m = *options.reference_n_m * (1.0 - slope.value) / slope.value;
  lever.error = slope.error / (slope.value * (1.0 - slope.value));
  lever.how = "a reference of " + words(*options.reference_n_m) + " N/m: slope " + words(slope.value);
  return lever;
}

fit::FitSetup setup_of(const Options& options, const scene::Scene& scene,
                       const std::optional<MeasuredLever>& lever) {
  if (scene.probe.origin == "rigid")
    throw UserError(scene.path + ": has a rigid probe: a curve is fitted with its lever, give stiffness_n_m");
  const char* const flag = options.stiffness_n_m        ? "--stiffness-n-m"
                           : !options.thermal.empty()   ? "--thermal"
                           : !options.reference.empty() ? "--reference-curve"
                                                        : nullptr;
  if (flag != nullptr && scene.probe.origin != "given") {
    throw UserError(scene.path + ": " + flag + " goes with a scene that has stiffness_n_m: its lever is a " +
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
    throw UserError("--also H and --also z0 are one length (H = 12 pi z0^2 w): choose one of them");
  if (options.hamaker_aj && setup.fit_distance)
    throw UserError("--hamaker-aj holds what --also z0 fits (H = 12 pi z0^2 w): choose one of them");
  const bool tail = setup.law.van_der_waals && setup.law.model != physics::ContactLaw::kHertz;
  if ((setup.fit_hamaker || options.hamaker_aj) && !tail)
    throw UserError(scene.path + ": has no van der Waals forces, and so no Hamaker constant");
  if (options.hamaker_aj && !(*options.hamaker_aj >= 1e-7 && *options.hamaker_aj <= 1e4))
    throw UserError("--hamaker-aj is " + words(*options.hamaker_aj) + ", expected 1e-7 to 1e4 aJ");
  if (!setup.fit_distance) setup.hamaker_aj = options.hamaker_aj ? options.hamaker_aj : scene.hamaker_aj;
  setup.fit_shift = options.shift;
  return setup;
}

void fit_one(const Options& options, const fit::FitSetup& setup, const fit::Preparation& how, Curve& curve) {
  fit::ColumnChoice columns = options.columns;
  columns.number = curve.number;
  const fit::RawCurve raw = fit::read_curve(curve.bytes ? *curve.bytes : read_bytes(curve.path), columns);
  curve.bytes.reset();
  curve.what = raw.what;
  curve.stiffness_n_m = raw.stiffness_n_m;
  curve.prepared = fit::prepare(raw, how);
  curve.notes = curve.prepared.notes;
  curve.fit = fit::fit_curve(curve.prepared, setup);
  const double k = how.stiffness_n_m;
  if (raw.stiffness_n_m && std::abs(*raw.stiffness_n_m / k - 1.0) > 0.01) {
    curve.notes.push_back("the file has a lever of " + words(*raw.stiffness_n_m) + " N/m, fitted with " +
                          words(k) + " N/m: --stiffness-n-m takes another");
  }
}

/// A file with several curves becomes as many. What cannot be read stays one, and says so when its turn comes.
std::vector<Curve> curves_of(const Options& options) {
  std::vector<Curve> curves;
  for (const std::string& path : options.curves) {
    Curve one;
    one.path = path;
    one.name = path;
    one.number = options.number.value_or(0);
    std::array<char, fit::kHdf5Begin.size()> begin{};
    std::ifstream(path, std::ios::binary).read(begin.data(), begin.size());
    std::error_code error;
    const bool several = std::filesystem::is_regular_file(path, error) &&
                         std::string_view(begin.data(), begin.size()) == fit::kHdf5Begin;
    if (!several || options.number) {
      curves.push_back(one);
      continue;
    }
    one.bytes = std::make_shared<const std::string>(read_bytes(path));
    const std::size_t count = fit::curves_in(*one.bytes);
    for (one.number = 0; one.number < count; ++one.number) {
      if (count > 1) one.name = path + "#" + std::to_string(one.number);
      curves.push_back(one);
    }
  }
  return curves;
}

/// Each curve by itself, so that the number of threads changes nothing. Of several a file that cannot be used
/// costs its own line and no other's.
void fit_all(const Options& options, const fit::FitSetup& setup, const fit::Preparation& how,
             std::vector<Curve>& curves) {
  const int wanted =
      options.threads > 0 ? options.threads : static_cast<int>(std::thread::hardware_concurrency());
  const int count =
      std::clamp(wanted, 1, static_cast<int>(std::min<std::size_t>(curves.size(), kThreadsMax)));
  std::atomic<std::size_t> next{0};
  std::atomic<std::size_t> done{0};
  std::vector<std::string> failed(curves.size());
  const bool tell = curves.size() > 1 && ::isatty(STDERR_FILENO) == 1;
  const auto work = [&] {
    for (std::size_t i = next++; i < curves.size(); i = next++) {
      try {
        fit_one(options, setup, how, curves[i]);
      } catch (const std::exception& error) {
        failed[i] = error.what();
      }
      const std::size_t so_far = ++done;
      if (tell) std::fprintf(stderr, "\rfit %zu of %zu curves", so_far, curves.size());
    }
  };
  std::vector<std::jthread> threads;
  for (int i = 1; i < count; ++i) threads.emplace_back(work);
  work();
  threads.clear();
  if (tell) std::fputs("\n", stderr);
  for (std::size_t i = 0; i < curves.size(); ++i) {
    if (failed[i].empty()) continue;
    if (curves.size() == 1) throw UserError(failed[i]);
    const std::string named = curves[i].path + ": ";
    curves[i].fit.error = failed[i].starts_with(named) ? failed[i].substr(named.size()) : failed[i];
  }
}

std::string interval_of(const fit::Estimate& e) {
  return (e.low ? words(*e.low) : std::string("open")) + " to " +
         (e.high ? words(*e.high) : std::string("open"));
}

void print_one(const Curve& curve) {
  const fit::CurveFit& f = curve.fit;
  std::printf("%-14s %s (%s), %zu points in, %zu out\n", "curve", curve.name.c_str(), curve.what.c_str(),
              f.approach.model_nm.size(), f.retract.model_nm.size());
  std::printf("%-14s %-22s %-28s 1 %% of k, InvOLS, R moves it by\n", "estimate", "value", "95 % interval");
  for (const fit::Estimate& e : f.estimates) {
    std::printf("%-14s %-22s %-28s %.3g %%, %.3g %%, %.3g %%\n", e.name.c_str(),
                (words(e.value) + " " + e.unit).c_str(), interval_of(e).c_str(), e.sensitivity_stiffness,
                e.sensitivity_invols, e.sensitivity_radius);
  }
  std::printf("%-14s K = %.4g GPa", "follows", f.contact_modulus_gpa);
  if (f.lambda > 0) std::printf(", lambda = %.4g", f.lambda);
  if (f.hamaker_aj > 0) std::printf(", Hamaker constant 12 pi z0^2 w = %.4g aJ", f.hamaker_aj);
  std::printf("\n");
  for (std::size_t a = 1; a < f.correlation.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      std::printf("%-14s %s and %s: %.3f\n", "correlation", f.estimates[a].name.c_str(),
                  f.estimates[b].name.c_str(), f.correlation[a][b]);
    }
  }
  std::printf(
      "%-14s rms %.4g nm, free part's noise %.4g nm (ratio %.3g), whitened %.3g, left correlation %.2g\n",
      "residuals", f.rms_nm, f.noise_nm, f.rms_nm / f.noise_nm, f.reduced, f.left_correlation);
  std::printf("%-14s %d of %d starts end here\n", "search", f.starts_agree, f.starts);
  for (const std::string& note : curve.notes) std::printf("%-14s %s\n", "note", note.c_str());
  for (const std::string& note : f.notes) std::printf("%-14s %s\n", "cannot tell", note.c_str());
}

std::string csv_table(const std::vector<Curve>& curves) {
  std::string text =
      "curve,e_gpa,e_low_gpa,e_high_gpa,w_mj_m2,w_low_mj_m2,w_high_mj_m2,r_nm,r_low_nm,r_high_nm,z0_nm,z0_"
      "low_nm,"
      "z0_high_nm,h_aj,h_low_aj,h_high_aj,humidity_percent,humidity_low_percent,humidity_high_percent,film_"
      "nm,film_low_nm,film_high_nm,lambda,hamaker_aj,rms_nm,noise_nm,error\n";
  for (const Curve& curve : curves) {
    std::string name = "\"";
    for (const char c : curve.name) name += c == '"' ? std::string("\"\"") : std::string(1, c);
    text += name + "\"";
    for (const char* wanted : {"E", "w", "R", "z0", "H", "humidity", "film"}) {
      const auto found = std::find_if(curve.fit.estimates.begin(), curve.fit.estimates.end(),
                                      [&](const fit::Estimate& e) { return e.name == wanted; });
      if (found == curve.fit.estimates.end()) {
        text += ",,,";
        continue;
      }
      text += "," + words(found->value, 9) + "," + (found->low ? words(*found->low, 9) : "") + "," +
              (found->high ? words(*found->high, 9) : "");
    }
    const fit::CurveFit& f = curve.fit;
    if (f.error.empty()) {
      text += "," + words(f.lambda, 9) + "," + words(f.hamaker_aj, 9) + "," + words(f.rms_nm, 9) + "," +
              words(f.noise_nm, 9) + ",\n";
    } else {
      std::string why = f.error;
      std::replace(why.begin(), why.end(), '"', '\'');
      text += ",,,,,\"" + why + "\"\n";
    }
  }
  return text;
}

std::string csv_residuals(const std::vector<Curve>& curves) {
  std::string text = "curve,direction,z_nm,deflection_nm,model_nm,residual_nm,used\n";
  char line[256];
  for (std::size_t c = 0; c < curves.size(); ++c) {
    for (const bool approach : {true, false}) {
      const fit::FitSegment& segment = approach ? curves[c].fit.approach : curves[c].fit.retract;
      const fit::PreparedSegment& data = approach ? curves[c].prepared.approach : curves[c].prepared.retract;
      for (std::size_t i = 0; i < segment.model_nm.size(); ++i) {
        std::snprintf(line, sizeof line, "%zu,%s,%.9g,%.9g,%.9g,%.9g,%d\n", c,
                      approach ? "approach" : "retract", data.z_nm[i], data.deflection_nm[i],
                      segment.model_nm[i], segment.residual_nm[i], static_cast<int>(segment.used[i]));
        text += line;
      }
    }
  }
  return text;
}

void draw(const Curve& curve, const std::string& file) {
  std::string script = "$curve << EOD\n";
  char line[160];
  for (const bool approach : {true, false}) {
    const fit::FitSegment& segment = approach ? curve.fit.approach : curve.fit.retract;
    const fit::PreparedSegment& data = approach ? curve.prepared.approach : curve.prepared.retract;
    for (std::size_t i = 0; i < segment.model_nm.size(); ++i) {
      std::snprintf(line, sizeof line, "%.7g,%.7g,%.7g,%.7g\n", data.z_nm[i] - curve.fit.touch_z_nm,
                    data.deflection_nm[i], segment.model_nm[i],
                    segment.used[i] != 0 ? segment.residual_nm[i] : 0.0);
      script += line;
    }
    script += "\n\n";
  }
  script += "EOD\n";
  script += "set bmargin\nset tmargin\nset lmargin 11\nset multiplot layout 2,1\n";
  script += "set title " +
            plot::quoted(fit::plain_line(std::filesystem::path(curve.path).filename().string())) +
            " noenhanced\n";
  script += "set ylabel 'deflection (nm)'\n";
  const std::string blue = plot::kBlue;
  const std::string red = plot::kRed;
  script += "plot $curve index 0 using 1:2 with points pt 7 ps 0.2 lc rgb '" + blue +
            "' title 'in', $curve index 1 using 1:2 with points pt 7 ps 0.2 lc rgb '" + red +
            "' title 'out', $curve index 0 using 1:3 with lines lw 1.2 lc rgb '" + plot::kInk +
            "' title 'fit', $curve index 1 using 1:3 with lines lw 1.2 lc rgb '" + plot::kInk + "' notitle\n";
  script += "unset title\nset ylabel 'measured - fit (nm)'\nset xlabel 'base above touch (nm)'\n";
  script += "plot $curve index 0 using 1:4 with points pt 7 ps 0.2 lc rgb '" + blue +
            "' notitle, $curve index 1 using 1:4 with points pt 7 ps 0.2 lc rgb '" + red + "' notitle\n";
  script += "unset multiplot\n";
  plot::draw(file, 900, 800, script);
}

/// Of the curves that were fitted; the middle one's logarithm, or between the two middle ones.
double median_of(const std::vector<Curve>& curves, double fit::CurveFit::*what) {
  std::vector<double> values;
  for (const Curve& curve : curves)
    if (curve.fit.error.empty()) values.push_back(curve.fit.*what);
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : std::sqrt(values[n / 2 - 1] * values[n / 2]);
}

std::string fitted_text(const Options& options, const scene::Scene& scene, const fit::FitSetup& setup,
                        const std::vector<Curve>& curves) {
  std::string text = read_bytes(scene.path);
  const auto set = [&](const char* table, const char* key, double value) {
    text = fit::with_key(text, table, key, words(value, 9));
  };
  physics::TipSampleParameters law = setup.law;
  set("sample", "youngs_modulus_gpa", median_of(curves, &fit::CurveFit::modulus_gpa));
  const bool adhesion = law.model != physics::ContactLaw::kHertz;
  double radius_nm = setup.radius_nm;
  if (setup.fit_radius) radius_nm = median_of(curves, &fit::CurveFit::radius_nm);
  if (adhesion) {
    law.work_of_adhesion_n_m = median_of(curves, &fit::CurveFit::work_n_m);
    set("contact", "work_of_adhesion_j_m2", law.work_of_adhesion_n_m);
  }
  if (setup.fit_distance) {
    law.equilibrium_distance_nm = median_of(curves, &fit::CurveFit::distance_nm);
    text = fit::without_key(text, "contact", "hamaker_aj");
    set("contact", "equilibrium_distance_nm", law.equilibrium_distance_nm);
  } else if (adhesion && (setup.fit_hamaker || setup.hamaker_aj)) {
    const double hamaker_aj =
        setup.fit_hamaker ? median_of(curves, &fit::CurveFit::hamaker_aj) : *setup.hamaker_aj;
    law.equilibrium_distance_nm = physics::VanDerWaals::cut_off_nm(hamaker_aj, law.work_of_adhesion_n_m);
    text = fit::without_key(text, "contact", "equilibrium_distance_nm");
    if (setup.fit_hamaker || options.hamaker_aj) set("contact", "hamaker_aj", hamaker_aj);
  }
  if (setup.fit_radius || options.radius_nm) set("probe", "tip_radius_nm", radius_nm);
  if (options.stiffness_n_m) {
    set("probe", "stiffness_n_m", *options.stiffness_n_m);
  } else if (!options.thermal.empty() || !options.reference.empty()) {
    // Along the lever's normal, of which z sees what its tilt leaves.
    set("probe", "stiffness_n_m",
        scene.cantilever.stiffness_n_m() * scene.probe_compliance_nm_nn()(2, 2) / setup.compliance_nm_nn);
  }
  if (setup.fit_humidity)
    set("forces.capillary", "humidity_percent", median_of(curves, &fit::CurveFit::humidity_percent));
  if (setup.fit_film) set("forces.capillary", "film_nm", median_of(curves, &fit::CurveFit::film_nm));
  // What was fitted is the dry contact's.
  if (law.long_range.capillary.humidity_percent > 0)
    text = fit::with_key(text, "forces.capillary", "adhesion", "\"dry\"");
  // A scene whose tip may not bear its own adhesion is refused.
  law.method = physics::MaugisMethod::kDirect;
  const double attraction_nn = physics::TipSampleLaw(law).attraction_bound_nn(radius_nm);
  if (!(scene.limits.force_max_nn > attraction_nn))
    set("limits", "force_max_nn", std::ceil(2.0 * attraction_nn));
  if (!scene.ground.scan_path.empty()) {
    std::error_code error;
    const auto here = std::filesystem::absolute(options.out).parent_path();
    auto scan = std::filesystem::relative(scene.ground.scan_path, here, error).string();
    if (error || scan.empty()) scan = std::filesystem::absolute(scene.ground.scan_path).string();
    if (std::filesystem::absolute(scene.path).parent_path() != here) {
      std::string quoted = "\"";
      for (const char c : scan) quoted += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
      text = fit::with_key(text, "surface", "file", quoted + "\"");
    }
  }
  std::string head = "# Made by telenano-nve fit from " + std::to_string(curves.size()) + " curve" +
                     (curves.size() == 1 ? "" : "s") + ", the first " + fit::plain_line(curves[0].path, 200) +
                     ".\n";
  text = head + text;
  const auto again = scene::parse_scene(text, options.out);
  const double modulus = again->sample.youngs_modulus_gpa;
  const bool same =
      std::abs(modulus / median_of(curves, &fit::CurveFit::modulus_gpa) - 1.0) < 1e-6 &&
      (!adhesion ||
       std::abs(again->law_parameters.work_of_adhesion_n_m / law.work_of_adhesion_n_m - 1.0) < 1e-6);
  if (!same) {
    throw UserError(
        scene.path +
        ": its text cannot be edited: write [sample] and [contact] as tables of their own, a key a line");
  }
  return text;
}

void check_target(const std::string& path, const char* flag, const Options& options) {
  if (path.empty()) return;
  std::error_code error;
  if (std::filesystem::is_directory(path, error))
    throw UserError(path + ": is a folder: choose a file with " + flag);
  if (std::filesystem::exists(std::filesystem::symlink_status(path, error))) {
    if (!options.force)
      throw UserError(path + ": is there already: --force replaces it, or choose another with " + flag);
    for (const std::string& curve : options.curves)
      if (std::filesystem::equivalent(path, curve, error))
        throw UserError(path + ": is a curve to fit: choose another file with " + flag);
  }
}

/// The pictures that are asked for, without values; as many curves as places.
fit::ParameterMap map_of(const Options& options, std::size_t curves) {
  fit::ParameterMap map;
  if (options.map.empty()) {
    if (!options.map_grid.empty() || !options.map_size.empty())
      throw UserError("--map-grid and --map-size-nm go with --map FOLDER");
    return map;
  }
  double columns = 0, rows = 0;
  const bool whole = two_numbers(options.map_grid, columns, rows) && columns >= 1 && rows >= 1 &&
                     columns <= 4096 && rows <= 4096 && columns == std::floor(columns) &&
                     rows == std::floor(rows);
  if (!whole) {
    throw UserError("--map-grid is '" + fit::plain_line(options.map_grid) +
                    "', expected COLUMNSxROWS, such as 32x32");
  }
  const bool sized = two_numbers(options.map_size, map.width_nm, map.length_nm) && map.width_nm > 0 &&
                     map.length_nm > 0 && map.width_nm < 1e9 && map.length_nm < 1e9;
  if (!sized) {
    throw UserError("--map-size-nm is '" + fit::plain_line(options.map_size) +
                    "', expected WIDTHxLENGTH in nm, such as 500x500");
  }
  map.columns = static_cast<int>(columns);
  map.rows = static_cast<int>(rows);
  const auto places = static_cast<std::size_t>(map.columns) * static_cast<std::size_t>(map.rows);
  if (places != curves) {
    throw UserError("--map-grid " + options.map_grid + " has " + std::to_string(places) + " places, and " +
                    std::to_string(curves) +
                    " curves are given: expected one a place, line by line from the lower left");
  }
  return map;
}

struct MapOf {
  const char* name;  // of the estimate, and the file's
  const char* title;
  const char* unit;
  double in_unit;  // of the estimate's own
};
constexpr MapOf kMaps[] = {{"E", "Young's modulus", "Pa", 1e9},   {"w", "work of adhesion", "J/m2", 1e-3},
                           {"R", "tip radius", "m", 1e-9},        {"z0", "equilibrium distance", "m", 1e-9},
                           {"H", "Hamaker constant", "J", 1e-18}, {"humidity", "humidity", "", 1e-2},
                           {"film", "adsorbed films", "m", 1e-9}};

std::string map_file(const Options& options, const MapOf& what) {
  return (std::filesystem::path(options.map) / (std::string(what.name) + ".gsf")).string();
}

void write_maps(const Options& options, fit::ParameterMap map, const std::vector<Curve>& curves) {
  std::error_code error;
  std::filesystem::create_directories(options.map, error);
  if (error) throw RunError(options.map + ": cannot be made: " + error.message());
  for (const MapOf& what : kMaps) {
    map.values.clear();
    bool any = false;
    for (const Curve& curve : curves) {
      const auto& all = curve.fit.estimates;
      const auto found =
          std::find_if(all.begin(), all.end(), [&](const auto& e) { return e.name == what.name; });
      const bool there = curve.fit.error.empty() && found != all.end();
      any = any || there;
      map.values.push_back(there ? what.in_unit * found->value : std::nan(""));
    }
    if (!any) continue;
    map.title = what.title;
    map.unit = what.unit;
    std::size_t filled = 0;
    write_text(map_file(options, what), fit::format_map(map, filled));
    std::printf("# map of %s: %s", what.title, map_file(options, what).c_str());
    if (filled > 0) std::printf(" (%zu places without a fit have the median)", filled);
    std::printf("\n");
  }
}

void run(const Options& options) {
  check_target(options.out, "-o", options);
  check_target(options.residuals, "--residuals", options);
  check_target(options.table, "--table", options);
  check_target(options.plot, "--plot", options);
  if (!options.plot.empty()) plot::require_drawable(options.plot, "--plot");
  std::vector<Curve> curves = curves_of(options);
  const fit::ParameterMap map = map_of(options, curves.size());
  if (map.columns > 0)
    for (const MapOf& what : kMaps) check_target(map_file(options, what), "--map", options);
  if (options.stiffness_n_m && !(*options.stiffness_n_m >= 1e-3 && *options.stiffness_n_m <= 1e5))
    throw UserError("--stiffness-n-m is " + words(*options.stiffness_n_m) + ", expected 1e-3 to 1e5 N/m");
  if (options.radius_nm && !(*options.radius_nm >= 1.0 && *options.radius_nm <= 1e4))
    throw UserError("--radius-nm is " + words(*options.radius_nm) + ", expected 1 to 1e4 nm");
  if (options.threads < 0 || options.threads > kThreadsMax)
    throw UserError("--threads is " + std::to_string(options.threads) + ", expected 0 (all cores) to 256");
  const auto scene = load_scene(options.scene);
  if (!(options.temperature_c >= -270 && options.temperature_c <= 1000))
    throw UserError("--temperature-c is " + words(options.temperature_c) + ", expected -270 to 1000 C");
  if (!(options.stiffness_error_percent >= 0 && options.stiffness_error_percent <= 100)) {
    throw UserError("--stiffness-error-percent is " + words(options.stiffness_error_percent) +
                    ", expected 0 to 100 %");
  }
  if (options.reference_n_m && options.reference.empty())
    throw UserError("--reference-stiffness-n-m goes with --reference-curve");
  if (!options.thermal_band.empty() && options.thermal.empty())
    throw UserError("--thermal-band-hz goes with --thermal");
  std::optional<MeasuredLever> lever;
  if (!options.thermal.empty()) lever = by_thermal_motion(options);
  if (!options.reference.empty()) lever = by_reference(options);
  const fit::FitSetup setup = setup_of(options, *scene, lever);
  fit::Preparation how = preparation_of(options, 1.0 / setup.compliance_nm_nn);
  how.bridge_step = setup.fit_film || setup.fit_humidity;
  fit_all(options, setup, how, curves);
  std::size_t good = 0;
  for (const Curve& curve : curves) {
    if (curve.fit.error.empty())
      ++good;
    else if (curves.size() > 1)
      std::fprintf(stderr, "telenano-nve: warning: %s: %s\n", curve.name.c_str(), curve.fit.error.c_str());
  }
  if (good == 0) throw UserError(curves[0].name + ": " + curves[0].fit.error);
  const std::string text = fitted_text(options, *scene, setup, curves);
  write_text(options.out, text);
  if (!options.residuals.empty()) write_text(options.residuals, csv_residuals(curves));
  if (!options.table.empty()) write_text(options.table, csv_table(curves));
  if (lever) {
    std::printf("%-14s %.4g N/m along z, standard deviation %.2g %%, by %s\n",
                curves.size() == 1 ? "lever" : "# lever", lever->stiffness_n_m, 100 * lever->error,
                lever->how.c_str());
  }
  if (curves.size() == 1) {
    print_one(curves[0]);
  } else {
    std::fputs(csv_table(curves).c_str(), stdout);
    std::printf("# median of %zu curves: E = %.4g GPa, w = %.4g mJ/m2\n", good,
                median_of(curves, &fit::CurveFit::modulus_gpa),
                1e3 * median_of(curves, &fit::CurveFit::work_n_m));
  }
  if (!options.plot.empty()) {
    const auto first =
        std::find_if(curves.begin(), curves.end(), [](const Curve& c) { return c.fit.error.empty(); });
    draw(*first, options.plot);
  }
  if (map.columns > 0) write_maps(options, map, curves);
  std::fflush(stdout);
}

}  // namespace

void add_fit_command(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("fit", "a sample's modulus and adhesion from force curves of your own");
  auto options = std::make_shared<Options>();
  command
      ->add_option(
          "curves", options->curves,
          "force curves: .csv, .ibw (Igor 5), .jpk-force, .h5 (afmformats), NanoScope (.spm, .000); several: "
          "each by itself")
      ->required()
      ->type_name("FILE");
  command
      ->add_option(
          "--scene", options->scene,
          "the start, and what is known: tip radius, lever, law, materials; its ground does not matter")
      ->required()
      ->type_name(config::kSceneOrFile);
  command
      ->add_option("-o,--out", options->out,
                   "the same scene with what was found (of several curves the median)")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--invols-nm-v", options->invols,
                   "deflection sensitivity; stiff: from the deepest part, as if the sample were rigid")
      ->type_name("NUMBER|stiff");
  auto* stiffness =
      command->add_option("--stiffness-n-m", options->stiffness_n_m, "of the lever; left out: the scene's");
  auto* thermal =
      command
          ->add_option(
              "--thermal", options->thermal,
              "the lever's stiffness by its thermal motion: table of frequency_hz and psd_nm2_hz (or V2), or "
              "of time_s and deflection_nm (or V), of the free lever")
          ->type_name("FILE");
  auto* reference =
      command
          ->add_option("--reference-curve", options->reference,
                       "the lever's stiffness by a curve on a reference, with --reference-stiffness-n-m")
          ->type_name("FILE");
  stiffness->excludes(thermal)->excludes(reference);
  thermal->excludes(reference);
  command
      ->add_option(
          "--thermal-lever", options->thermal_lever,
          "what of the motion is seen: rectangular 0.817 or v-shaped 0.764 by the slope, whose sensitivity "
          "was taken on something rigid; displacement 0.971")
      ->check(CLI::IsMember({"rectangular", "v-shaped", "displacement"}))
      ->capture_default_str();
  command->add_option("--temperature-c", options->temperature_c, "of the lever")->capture_default_str();
  command
      ->add_option("--thermal-band-hz", options->thermal_band,
                   "frequencies that are fitted; left out: about the peak")
      ->type_name("LOW:HIGH");
  command->add_option("--reference-stiffness-n-m", options->reference_n_m, "of the reference, along z");
  command
      ->add_option(
          "--stiffness-error-percent", options->stiffness_error_percent,
          "standard deviation of the lever's stiffness beside what its measurement shows (sensitivity, "
          "temperature); the intervals hold it")
      ->capture_default_str();
  command->add_option("--radius-nm", options->radius_nm, "of the tip; left out: the scene's");
  command
      ->add_option(
          "--also", options->also,
          "fit these, too: R the tip's radius (for lambda 0.1 to 5), z0 the equilibrium distance, or H the "
          "Hamaker constant; one follows from the other and w: H = 12 pi z0^2 w; humidity and film of a "
          "scene "
          "with a capillary bridge")
      ->check(CLI::IsMember({"R", "z0", "H", "humidity", "film"}));
  command->add_option(
      "--hamaker-aj", options->hamaker_aj,
      "Hamaker constant, held whatever w is; with --also H the start; left out: the scene's, or "
      "that of its z0 and w");
  command->add_flag("--shift", options->shift, "z may be shifted between the two ways: drift of the piezo");
  command->add_option("--z-column", options->columns.z, "name of the column or channel with the height");
  command->add_option("--deflection-column", options->columns.deflection,
                      "name of the column or channel with the deflection");
  command
      ->add_option("--curve", options->number,
                   "of a file with several curves (HDF5) that one alone, from 0; left out: all of them")
      ->type_name("NUMBER");
  command->add_option("--residuals", options->residuals, "CSV: curve, model and residual, point by point")
      ->type_name("FILE");
  command->add_option("--table", options->table, "CSV: a line of estimates a curve")->type_name("FILE");
  command->add_option("--plot", options->plot, "picture of the first curve with its fit (.svg or .png)")
      ->type_name("FILE");
  command
      ->add_option("--map", options->map,
                   "folder for pictures of E, w and what else is fitted (.gsf), of curves on a grid")
      ->type_name("FOLDER");
  command
      ->add_option("--map-grid", options->map_grid,
                   "places of the grid: the curves are given line by line from the lower left")
      ->type_name("COLUMNSxROWS");
  command->add_option("--map-size-nm", options->map_size, "size of the grid")->type_name("WIDTHxLENGTH");
  command->add_option("--threads", options->threads, "0: as many as cores; changes no result")
      ->capture_default_str();
  command->add_flag("--force", options->force, "replace files that are there");
  command->footer(
      "The model is that of curve: the scene's law on a flat sample with the lever in the loop, both ways. "
      "The "
      "lever's\nstiffness is never fitted: no quasi-static curve tells it; --thermal and --reference-curve "
      "do. Intervals are 95 %, by profile "
      "likelihood with the noise's own\ncorrelation; what the curve cannot tell is open, and said.");
  command->callback([options] { run(*options); });
}

}  // namespace telenano::app

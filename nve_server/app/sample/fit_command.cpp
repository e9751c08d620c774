#include "telenano/nve_server/app/sample/fit_command.h"

#include <unistd.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/plot/gnuplot.h"
#include "telenano/nve_server/app/sample/fit_files.h"
#include "telenano/nve_server/app/sample/fit_lever.h"
#include "telenano/nve_server/app/sample/fit_map.h"
#include "telenano/nve_server/app/sample/fit_options.h"
#include "telenano/nve_server/app/sample/fit_report.h"
#include "telenano/nve_server/app/sample/user_files.h"
#include "telenano/nve_server/app/scene/scene_loading.h"
#include "telenano/nve_server/fit/column_check.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::app {
namespace {

constexpr int kThreadsMax = 256;
constexpr double kStiffnessOff = 0.1;  // of the file's from the scene's
constexpr const char* kExchanged =
    "the deflection changes evenly, as z should, and z does not: are the two columns swapped? --z-column and "
    "--deflection-column choose them";

void fit_one(const FitOptions& options, const fit::FitSetup& setup, const fit::Preparation& how,
             FittedCurve& curve) {
  fit::ColumnChoice columns = options.columns;
  columns.number = curve.number;
  const fit::RawCurve raw =
      fit::read_curve(curve.bytes ? *curve.bytes : read_curve_bytes(curve.path), columns);
  curve.bytes.reset();
  curve.what = raw.what;
  curve.stiffness_n_m = raw.stiffness_n_m;
  curve.prepared = fit::prepare(raw, how);
  curve.notes = curve.prepared.notes;
  std::string& wrong = curve.prepared.error;
  if (fit::columns_look_exchanged(curve.prepared)) wrong = kExchanged;
  const double k = how.stiffness_n_m;
  const std::string stated =
      raw.stiffness_n_m ? number_text(*raw.stiffness_n_m) + " N/m" : "'" + raw.stiffness_unread + "'";
  const double off = raw.stiffness_n_m ? std::abs(*raw.stiffness_n_m / k - 1.0) : 1.0;
  const bool given = options.stiffness_n_m || !options.thermal.empty() || !options.reference.empty();
  if (raw.error.empty() && (raw.stiffness_n_m || !raw.stiffness_unread.empty()) && !given &&
      off > kStiffnessOff)
    wrong = "says that its lever has " + stated + ", and the scene has " + number_text(k) +
            " N/m: give the right one by --stiffness-n-m, or in the scene";
  curve.fit = fit::fit_curve(curve.prepared, setup);
  if (how.invols_from_stiff) {
    // What the sample gives is taken from it, too: a softer one looks stiffer, a tip that slides softer.
    for (fit::Estimate& estimate : curve.fit.estimates) {
      estimate.low.reset();
      estimate.high.reset();
    }
  }
  if (off > 0.01 && (raw.stiffness_n_m || !raw.stiffness_unread.empty()))
    curve.notes.push_back("the file says that its lever has " + stated + ", and the fit uses " +
                          number_text(k) + " N/m: --stiffness-n-m chooses another");
}

/// A file with several curves becomes as many. What cannot be read stays one, and says so when its turn comes.
std::vector<FittedCurve> curves_of(const FitOptions& options) {
  std::vector<FittedCurve> curves;
  for (const std::string& path : options.curves) {
    FittedCurve one;
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
    one.bytes = std::make_shared<const std::string>(read_curve_bytes(path));
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
void fit_all(const FitOptions& options, const fit::FitSetup& setup, const fit::Preparation& how,
             std::vector<FittedCurve>& curves) {
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

void run(const FitOptions& options) {
  check_target(options.out, "-o", options);
  check_target(options.residuals, "--residuals", options);
  check_target(options.table, "--table", options);
  check_target(options.plot, "--plot", options);
  if (!options.plot.empty()) plot::require_drawable(options.plot, "--plot");
  std::vector<FittedCurve> curves = curves_of(options);
  const fit::ParameterMap map = map_of(options, curves.size());
  if (map.columns > 0) check_map_targets(options);
  if (options.stiffness_n_m && !(*options.stiffness_n_m >= 1e-3 && *options.stiffness_n_m <= 1e5))
    throw UserError("--stiffness-n-m is " + number_text(*options.stiffness_n_m) +
                    ", expected 1e-3 to 1e5 N/m");
  if (options.radius_nm && !(*options.radius_nm >= 1.0 && *options.radius_nm <= 1e4))
    throw UserError("--radius-nm is " + number_text(*options.radius_nm) + ", expected 1 to 1e4 nm");
  if (options.threads < 0 || options.threads > kThreadsMax)
    throw UserError("--threads is " + std::to_string(options.threads) + ", expected 0 (all cores) to 256");
  const auto scene = load_scene(options.scene);
  if (!(options.temperature_c >= -270 && options.temperature_c <= 1000))
    throw UserError("--temperature-c is " + number_text(options.temperature_c) + ", expected -270 to 1000 C");
  if (!(options.stiffness_error_percent >= 0 && options.stiffness_error_percent <= 100)) {
    throw UserError("--stiffness-error-percent is " + number_text(options.stiffness_error_percent) +
                    ", expected 0 to 100 %");
  }
  if (options.reference_n_m && options.reference.empty())
    throw UserError("--reference-stiffness-n-m needs --reference-curve");
  if (!options.thermal_band.empty() && options.thermal.empty())
    throw UserError("--thermal-band-hz needs --thermal");
  const std::optional<MeasuredLever> lever = measured_lever(options);
  const fit::FitSetup setup = setup_of(options, *scene, lever);
  fit::Preparation how = preparation_of(options, 1.0 / setup.compliance_nm_nn);
  how.bridge_step = setup.fit_film || setup.fit_humidity;
  fit_all(options, setup, how, curves);
  std::size_t good = 0;
  for (const FittedCurve& curve : curves) {
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
        std::find_if(curves.begin(), curves.end(), [](const FittedCurve& c) { return c.fit.error.empty(); });
    draw(*first, options.plot);
  }
  if (map.columns > 0) write_maps(options, map, curves);
  std::fflush(stdout);
}

}  // namespace

void add_fit_command(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("fit", "Find a sample's modulus and adhesion from your own force curves");
  auto options = std::make_shared<FitOptions>();
  command
      ->add_option("curves", options->curves,
                   "Force curves: .csv, .ibw (Igor 5), .jpk-force, .h5 (afmformats), NanoScope (.spm, .000); "
                   "several curves are fitted separately")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--scene", options->scene,
                   "The starting scene with the known values: tip radius, lever, law, materials; its surface "
                   "does not matter")
      ->required()
      ->type_name(config::kSceneOrFile);
  command
      ->add_option("-o,--out", options->out,
                   "The same scene with the fitted values (for several curves, the median)")
      ->required()
      ->type_name("FILE");
  command
      ->add_option(
          "--invols-nm-v", options->invols,
          "deflection sensitivity; stiff: taken from the deepest part of the curve, as if the sample "
          "were rigid")
      ->type_name("NUMBER|stiff");
  auto* stiffness = command->add_option("--stiffness-n-m", options->stiffness_n_m,
                                        "Stiffness of the lever (default: the scene's)");
  auto* thermal =
      command
          ->add_option(
              "--thermal", options->thermal,
              "Measure the lever's stiffness from its thermal motion: table of frequency_hz and psd_nm2_hz "
              "(or V2), or of time_s and deflection_nm (or V), of the free lever")
          ->type_name("FILE");
  auto* reference =
      command
          ->add_option(
              "--reference-curve", options->reference,
              "Measure the lever's stiffness from a curve on a reference, with --reference-stiffness-n-m")
          ->type_name("FILE");
  stiffness->excludes(thermal)->excludes(reference);
  thermal->excludes(reference);
  command
      ->add_option("--thermal-lever", options->thermal_lever,
                   "Part of the motion that the instrument sees: rectangular 0.817 or v-shaped 0.764 if it "
                   "measures the slope with a sensitivity calibrated on something rigid; displacement 0.971")
      ->check(CLI::IsMember({"rectangular", "v-shaped", "displacement"}))
      ->capture_default_str();
  command->add_option("--temperature-c", options->temperature_c, "Temperature of the lever")
      ->capture_default_str();
  command
      ->add_option("--thermal-band-hz", options->thermal_band,
                   "Frequencies to fit (default: around the peak)")
      ->type_name("LOW:HIGH");
  command->add_option("--reference-stiffness-n-m", options->reference_n_m,
                      "Stiffness of the reference, along z");
  command
      ->add_option(
          "--stiffness-error-percent", options->stiffness_error_percent,
          "Additional standard deviation of the lever's stiffness that its measurement does not show "
          "(sensitivity, temperature); the intervals include it")
      ->capture_default_str();
  command->add_option("--radius-nm", options->radius_nm, "Radius of the tip (default: the scene's)");
  command
      ->add_option(
          "--also", options->also,
          "Fit these too: R the tip's radius (for lambda 0.1 to 5), z0 the equilibrium distance, or H "
          "the Hamaker constant; each follows from the other and w: H = 12 pi z0^2 w; humidity and "
          "film for a scene with a capillary bridge")
      ->check(CLI::IsMember({"R", "z0", "H", "humidity", "film"}));
  command->add_option("--hamaker-aj", options->hamaker_aj,
                      "Hamaker constant, fixed whatever w is; with --also H the starting value (default: the "
                      "scene's, or that of its z0 and w)");
  command->add_flag("--shift", options->shift,
                    "Allow a shift of z between approach and retract: drift of the piezo");
  command->add_option("--z-column", options->columns.z, "name of the column or channel with the height");
  command->add_option("--deflection-column", options->columns.deflection,
                      "name of the column or channel with the deflection");
  command
      ->add_option("--curve", options->number,
                   "use only this curve of a file with several curves (HDF5), from 0 (default: all of them)")
      ->type_name("NUMBER");
  command->add_option("--residuals", options->residuals, "CSV: curve, model and residual, point by point")
      ->type_name("FILE");
  command->add_option("--table", options->table, "CSV: one line of estimates per curve")->type_name("FILE");
  command->add_option("--plot", options->plot, "picture of the first curve with its fit (.svg or .png)")
      ->type_name("FILE");
  command
      ->add_option("--map", options->map,
                   "folder for maps of E, w and the other fitted values (.gsf), for curves on a grid")
      ->type_name("FOLDER");
  command
      ->add_option("--map-grid", options->map_grid,
                   "places of the grid: the curves are given line by line from the lower left")
      ->type_name("COLUMNSxROWS");
  command->add_option("--map-size-nm", options->map_size, "size of the grid")->type_name("WIDTHxLENGTH");
  command->add_option("--threads", options->threads, "0: one per core; does not change the result")
      ->capture_default_str();
  command->add_flag("--force", options->force, "replace existing files");
  command->footer(
      "The model is the same as in curve: the scene's law on a flat sample with the lever in the "
      "loop, in both directions.\nThe lever's stiffness is never fitted, because no quasi-static "
      "curve determines it; --thermal and --reference-curve do.\nIntervals are 95 %, by profile "
      "likelihood with the noise's own correlation. A value that the curve does not determine\nis "
      "reported as open.");
  command->callback([options] { run(*options); });
}

}  // namespace telenano::app

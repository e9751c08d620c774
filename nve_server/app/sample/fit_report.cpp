#include "telenano/nve_server/app/sample/fit_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <system_error>

#include "telenano/common/base/error.h"
#include "telenano/common/plot/gnuplot.h"
#include "telenano/nve_server/app/sample/fit_files.h"
#include "telenano/nve_server/fit/fitted_scene.h"
#include "telenano/nve_server/scene/scene.h"

namespace telenano::app {
namespace {

std::string interval_of(const fit::Estimate& e) {
  return (e.low ? number_text(*e.low) : std::string("open")) + " to " +
         (e.high ? number_text(*e.high) : std::string("open"));
}

}  // namespace

void print_one(const FittedCurve& curve) {
  const fit::CurveFit& f = curve.fit;
  std::printf("%-14s %s (%s), %zu points in, %zu out\n", "curve", curve.name.c_str(), curve.what.c_str(),
              f.approach.model_nm.size(), f.retract.model_nm.size());
  std::printf("%-14s %-22s %-28s 1 %% of k, InvOLS, R moves it by\n", "estimate", "value", "95 % interval");
  for (const fit::Estimate& e : f.estimates) {
    std::printf("%-14s %-22s %-28s %.3g %%, %.3g %%, %.3g %%\n", e.name.c_str(),
                (number_text(e.value) + " " + e.unit).c_str(), interval_of(e).c_str(),
                e.sensitivity_stiffness, e.sensitivity_invols, e.sensitivity_radius);
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

std::string csv_table(const std::vector<FittedCurve>& curves) {
  std::string text =
      "curve,e_gpa,e_low_gpa,e_high_gpa,w_mj_m2,w_low_mj_m2,w_high_mj_m2,r_nm,r_low_nm,r_high_nm,z0_nm,z0_"
      "low_nm,"
      "z0_high_nm,h_aj,h_low_aj,h_high_aj,humidity_percent,humidity_low_percent,humidity_high_percent,film_"
      "nm,film_low_nm,film_high_nm,lambda,hamaker_aj,rms_nm,noise_nm,error\n";
  for (const FittedCurve& curve : curves) {
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
      text += "," + number_text(found->value, 9) + "," + (found->low ? number_text(*found->low, 9) : "") +
              "," + (found->high ? number_text(*found->high, 9) : "");
    }
    const fit::CurveFit& f = curve.fit;
    if (f.error.empty()) {
      text += "," + number_text(f.lambda, 9) + "," + number_text(f.hamaker_aj, 9) + "," +
              number_text(f.rms_nm, 9) + "," + number_text(f.noise_nm, 9) + ",\n";
    } else {
      std::string why = f.error;
      std::replace(why.begin(), why.end(), '"', '\'');
      text += ",,,,,\"" + why + "\"\n";
    }
  }
  return text;
}

std::string csv_residuals(const std::vector<FittedCurve>& curves) {
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

void draw(const FittedCurve& curve, const std::string& file) {
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

double median_of(const std::vector<FittedCurve>& curves, double fit::CurveFit::*what) {
  std::vector<double> values;
  for (const FittedCurve& curve : curves)
    if (curve.fit.error.empty()) values.push_back(curve.fit.*what);
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : std::sqrt(values[n / 2 - 1] * values[n / 2]);
}

std::string fitted_text(const FitOptions& options, const scene::Scene& scene, const fit::FitSetup& setup,
                        const std::vector<FittedCurve>& curves) {
  std::string text = read_curve_bytes(scene.path);
  const auto set = [&](const char* table, const char* key, double value) {
    text = fit::with_key(text, table, key, number_text(value, 9));
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

}  // namespace telenano::app

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "telenano/common/config/shared_files.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "tests/source_dir.h"
#include "tests/studies/elastic/ground_truth.h"
#include "tests/studies/precision/studies.h"
#include "tests/studies/report/page.h"

namespace telenano::studies {
namespace {

using elastic::ForceOf;
using elastic::Place;
using elastic::PlaceError;
using physics::BranchPotential;
using physics::ContactJet;
using physics::ScanFields;
using physics::SplineSurface;

constexpr double kRadiusNm = 20;
constexpr double kRangeNm = 0.165;
constexpr double kWorkNPerM = 0.4;

/// A ground whose forces are known by elasticity: tests/data/elastic/README.md.
struct Ground {
  const char* condition;
  const char* scan;
  double heights_times;
  double modulus_gpa;  // E*
  std::vector<const char*> tables;
};

const std::vector<Ground>& grounds() {
  static const std::vector<Ground> all{
      {"600 nm", "wsxm_600nm", 1, 52.5, {"adhesive_elastic_wsxm_600nm", "places_wsxm_600nm"}},
      {"1 um",
       "nanoscope_peakforce_1um",
       1,
       52.5,
       {"adhesive_elastic_nanoscope_peakforce_1um", "places_nanoscope_peakforce_1um"}},
      {"600 nm, 3 x higher: 30 to 45 deg", "wsxm_600nm", 3, 52.5, {"steep_wsxm_600nm"}},
      {"1 um, 6 x higher: 30 to 45 deg",
       "nanoscope_peakforce_1um",
       6,
       52.5,
       {"steep_nanoscope_peakforce_1um"}},
      {"600 nm, soft: E* 10 GPa, lambda 2.2", "wsxm_600nm", 1, 10, {"soft_wsxm_600nm"}}};
  return all;
}

/// In an installed package beside the scenes, in a build where they are kept.
std::filesystem::path table_file(const std::string& name) {
  const std::filesystem::path installed = config::shared_folder() / "elastic" / (name + ".csv");
  if (std::filesystem::exists(installed)) return installed;
  return std::filesystem::path(TELENANO_SOURCE_DIR) / "tests" / "data" / "elastic" / (name + ".csv");
}

/// The ground under one place, by all methods.
struct Under {
  double x, y, touch_nm;
  SplineSurface surface;
  ScanFields fields;
  Under(const surface::HeightGrid& scan, const Place& place, double modulus_gpa)
      : x(scan.x_first_nm + place.column * scan.dx_nm),
        y(scan.y_first_nm + place.row * scan.dy_nm),
        touch_nm(place.touch_nm),
        surface(elastic::piece_round(scan, place.column, place.row), kRadiusNm),
        fields(elastic::piece_round(scan, place.column, place.row), kRadiusNm,
               physics::softening_rule(kRadiusNm, kWorkNPerM, modulus_gpa, kRangeNm)) {}
};

/// One way to see the ground; the law over it is the same for all. Adding one is adding an entry.
struct Method {
  std::string family;
  std::string setting;
  bool is_default;
  std::function<void(const Under&, double above_touch_nm, physics::FootMemory&, ContactJet&)> place;
};

std::vector<Method> methods(bool quick) {
  std::vector<Method> all{{"nearest point", "one foot", false,
                           [](const Under& u, double z, physics::FootMemory& memory, ContactJet& jet) {
                             const physics::SurfaceContact foot =
                                 u.surface.nearest(Vec3(u.x, u.y, u.touch_nm + z + kRadiusNm),
                                                   physics::Search::kGlobal, memory);
                             jet.overlap_nm = kRadiusNm - foot.distance_nm;
                             jet.overlap_grad = -foot.normal_w;
                             jet.log_radius = std::log(foot.effective_radius_nm);
                           }},
                          {"potential, growing softening", "as served", true,
                           [](const Under& u, double z, physics::FootMemory&, ContactJet& jet) {
                             u.fields.contact_at({u.x, u.y, u.touch_nm + z}, jet);
                           }}};
  for (const double t : {1.0, 0.5, 0.25, 0.165, 0.09}) {
    if (quick && t != 0.25) continue;
    all.push_back({"potential, one softening", fmt::format("t = {} nm", t), false,
                   [t](const Under& u, double z, physics::FootMemory&, ContactJet& jet) {
                     u.fields.at_softening({u.x, u.y, u.touch_nm + z}, t, jet);
                   }});
  }
  return all;
}

std::string interval(const std::vector<double>& errors, double q) {
  const elastic::Interval range = elastic::bootstrap(errors, q);
  return fmt::format("{:.1f} ({:.1f} to {:.1f})", 100 * elastic::quantile(errors, q), 100 * range.low,
                     100 * range.high);
}

}  // namespace

Section ground_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "ground";
  section.title = "The ground under the tip: model error";
  section.lead =
      "Forces of one law (Maugis-Dugdale, R = 20 nm, w = 0.4 N/m) over real scans, against an elastic "
      "half-space with "
      "Lennard-Jones adhesion by boundary elements, at places chosen at random. This is the error of the "
      "model, which no faster or finer evaluation takes away: the other parts of this page tell what "
      "evaluation adds. Pull-off is that over the flat sample's, on both sides. Time is one evaluation of "
      "ground and law, its data warm in the cache. On the steep grounds the half-space with vertical "
      "displacements is itself formal.";
  section.choice =
      "Default: the potential with growing softening. A single softening suits either the pull-off (0.09 nm) "
      "or pressed contact (0.25 to 0.5 nm); the nearest point sees one foot and one pixel's curvature, and "
      "misses neighbouring feet that carry a part of the force.";
  std::string table =
      "<div class=\"scroll\"><table>\n<thead><tr><th>ground</th><th>method</th><th>places</th><th>pull-off: "
      "median error, % (95 %)</th><th>ninth decile, % (95 %)</th><th>pressed 0.2 nm and more: rms error, %"
      "</th></tr></thead>\n<tbody>\n";
  std::vector<Row> pull_off_rows, pressed_rows;
  for (const Ground& ground : grounds()) {
    surface::HeightGrid scan = surface::read_gsf(config::find_shared(ground.scan, "data", ".gsf")).grid;
    for (double& z : scan.z_nm) z *= ground.heights_times;
    physics::TipSampleParameters parameters;
    parameters.contact_modulus_gpa = ground.modulus_gpa * 4 / 3;
    parameters.work_of_adhesion_n_m = kWorkNPerM;
    const BranchPotential law(physics::TipSampleLaw(parameters), kRadiusNm);
    const ForceOf on_flat = elastic::flat_force(law, kRadiusNm);
    const std::vector<Method> all = methods(effort.quick);
    std::vector<std::vector<PlaceError>> errors(all.size());
    std::vector<Cost> costs(all.size());
    for (const char* name : ground.tables) {
      const std::vector<Place> places = elastic::read_places(table_file(name).string());
      const std::size_t last = effort.quick ? std::min<std::size_t>(4, places.size()) : places.size();
      for (std::size_t k = 1; k < last; ++k) {
        const Under under(scan, places[k], ground.modulus_gpa);
        for (std::size_t m = 0; m < all.size(); ++m) {
          physics::FootMemory memory;
          const auto force = [&](double z) {
            ContactJet jet;
            all[m].place(under, z, memory, jet);
            return elastic::retraction_force_nn(law, jet);
          };
          errors[m].push_back(elastic::place_error(places[0], on_flat, places[k], force));
          if (k != 1 || name != ground.tables.front()) continue;
          double sum = 0;
          costs[m] = measure(
              [&] {
                for (int i = 0; i < 100; ++i) sum += force(-0.8 + 0.01 * i);
              },
              100, effort);
          if (!std::isfinite(sum)) costs[m] = {};
        }
      }
    }
    for (std::size_t m = 0; m < all.size(); ++m) {
      std::vector<double> pull_off, pressed;
      for (const PlaceError& one : errors[m]) {
        pull_off.push_back(one.pull_off_error());
        pressed.push_back(std::sqrt(one.pressed_error_nn2 / one.pressed_square_nn2));
      }
      const bool is_knob = all[m].family == "potential, one softening";
      const auto row = [&](const char* what, const std::vector<double>& of) {
        return Row{std::string(ground.condition) + ", " + what,
                   all[m].family,
                   all[m].setting,
                   all[m].is_default,
                   summarise(of),
                   costs[m],
                   0,
                   is_knob};
      };
      pull_off_rows.push_back(row("pull-off", pull_off));
      pressed_rows.push_back(row("pressed", pressed));
      table +=
          fmt::format("<tr><td>{}</td><td>{}, {}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.1f}</td></tr>\n",
                      html_escaped(ground.condition), html_escaped(all[m].family),
                      html_escaped(all[m].setting), errors[m].size(), interval(pull_off, 0.5),
                      interval(pull_off, 0.9), 100 * elastic::pressed_error(errors[m]));
    }
  }
  section.tables.push_back(table + "</tbody></table></div>\n");
  // The figure shows what a place has as a rule; its outliers stand in the table and the rows.
  const auto medians = [](std::vector<Row> rows) {
    for (Row& row : rows) row.errors.largest = row.errors.median;
    return rows;
  };
  section.figures.push_back(work_precision_figure({"ground_pull_off", "Pull-off: error against time",
                                                   "Median over the places of the relative error.", ""},
                                                  medians(pull_off_rows), "median error", folder));
  section.figures.push_back(work_precision_figure({"ground_pressed", "Pressed: error against time",
                                                   "Median over the places of each one's rms error over the "
                                                   "rms force, pressed by 0.2 nm and more.",
                                                   ""},
                                                  medians(pressed_rows), "median error", folder));
  section.rows = std::move(pull_off_rows);
  section.rows.insert(section.rows.end(), pressed_rows.begin(), pressed_rows.end());
  return section;
}

}  // namespace telenano::studies

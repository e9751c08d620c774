#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "telenano/common/base/error.h"
#include "telenano/common/config/shared_files.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/potential/retraction.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "tests/source_dir.h"
#include "tests/studies/elastic/ground_truth.h"
#include "tests/studies/precision/ground_pictures.h"
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

/// The ground under one place.
struct Under {
  double x, y, touch_nm;
  ScanFields fields;
  Under(const surface::HeightGrid& scan, const Place& place, double modulus_gpa,
        const std::shared_ptr<const physics::RetractionKernel>& pull_off)
      : x(scan.x_first_nm + place.column * scan.dx_nm),
        y(scan.y_first_nm + place.row * scan.dy_nm),
        touch_nm(place.touch_nm),
        fields(elastic::piece_round(scan, place.column, place.row), kRadiusNm,
               physics::softening_rule(kRadiusNm, kWorkNPerM, modulus_gpa, kRangeNm), {}, {}, pull_off) {}
};

/// One way to see the ground; the law over it is the same for all. Adding one is adding an entry.
struct Method {
  std::string family;
  std::string setting;
  bool is_default;
  std::function<void(const Under&, double above_touch_nm, ContactJet&, double& cosine)> place;
};

std::vector<Method> methods(bool quick) {
  std::vector<Method> all{{"potential, growing softening", "as served", true,
                           [](const Under& u, double z, ContactJet& jet, double& cosine) {
                             elastic::contact_of(u.fields, u.x, u.y, u.touch_nm)(z, jet, cosine);
                           }}};
  for (const double t : {1.0, 0.5, 0.25, 0.165, 0.09}) {
    if (quick && t != 0.25) continue;
    all.push_back({"potential, one softening", fmt::format("t = {} nm", t), false,
                   [t](const Under& u, double z, ContactJet& jet, double& cosine) {
                     u.fields.at_softening({u.x, u.y, u.touch_nm + z}, t, jet);
                     cosine = -jet.overlap_grad.z();
                   }});
  }
  return all;
}

/// What the nearest point of the surface gave before the potential came:
/// tests/data/elastic/nearest_point.csv.
struct Recorded {
  int places = 0;
  double pull_off_median = 0, median_low = 0, median_high = 0;
  double pull_off_ninth = 0, ninth_low = 0, ninth_high = 0;
  double pressed_rms = 0, pull_off_largest = 0, pressed_median = 0, pressed_largest = 0;
  Cost cost;
};

Recorded nearest_point(const std::string& table) {
  const std::filesystem::path file = table_file("nearest_point");
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.rfind(table + ',', 0) != 0) continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream fields(line.substr(table.size()));
    Recorded r;
    fields >> r.places >> r.pull_off_median >> r.median_low >> r.median_high >> r.pull_off_ninth >>
        r.ninth_low >> r.ninth_high >> r.pressed_rms >> r.pull_off_largest >> r.pressed_median >>
        r.pressed_largest >> r.cost.p50_ns >> r.cost.p99_ns;
    if (fields) return r;
  }
  throw UserError(file.string() + ": expected a line for " + table);
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
      "ground and law, its data warm in the cache. Elements that move "
      "vertically only are too stiff on a slope, by its cosine to the power of 3/2; the law is given the "
      "ground as they see "
      "it (vertical_force in tests/studies/elastic/ground_truth.h). Where the feet are steeper than 30 "
      "degrees the elements "
      "are no reference: those places count for the pull-off only.";
  section.choice =
      "Default: the potential with growing softening. A single softening suits either the pull-off (0.09 nm) "
      "or pressed contact (0.25 to 0.5 nm). The nearest point of the surface (recorded: the product had it "
      "before) sees one foot and one pixel's curvature, and misses neighbouring feet that carry a part of "
      "the "
      "force.";
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
    const auto kernel = std::make_shared<const physics::RetractionKernel>(retraction_kernel(law, kRadiusNm));
    const std::vector<Method> all = methods(effort.quick);
    std::vector<std::vector<PlaceError>> errors(all.size());
    std::vector<Cost> costs(all.size());
    for (const char* name : ground.tables) {
      const std::vector<Place> places = elastic::read_places(table_file(name).string());
      const std::size_t last = effort.quick ? std::min<std::size_t>(4, places.size()) : places.size();
      for (std::size_t k = 1; k < last; ++k) {
        const Under under(scan, places[k], ground.modulus_gpa, kernel);
        for (std::size_t m = 0; m < all.size(); ++m) {
          const auto contact = [&](double z, ContactJet& jet, double& cosine) {
            all[m].place(under, z, jet, cosine);
          };
          errors[m].push_back(elastic::place_error(law, places[0], on_flat, places[k], contact));
          if (k != 1 || name != ground.tables.front()) continue;
          double sum = 0;
          costs[m] = measure(
              [&] {
                for (int i = 0; i < 100; ++i) {
                  ContactJet jet;
                  double cosine = 1;
                  contact(-0.8 + 0.01 * i, jet, cosine);
                  sum += elastic::retraction_force_nn(law, jet);
                }
              },
              100, effort);
          if (!std::isfinite(sum)) costs[m] = {};
        }
      }
    }
    {
      const Recorded r = nearest_point(ground.tables.front());
      const auto row = [&](const char* what, double median, double largest) {
        return Row{std::string(ground.condition) + ", " + what,
                   "nearest point (recorded)",
                   "one foot",
                   false,
                   {largest / 100, largest / 100, median / 100, 0, r.places},
                   r.cost,
                   0,
                   false};
      };
      pull_off_rows.push_back(row("pull-off", r.pull_off_median, r.pull_off_largest));
      pressed_rows.push_back(row("pressed", r.pressed_median, r.pressed_largest));
      table += fmt::format(
          "<tr><td>{}</td><td>nearest point (recorded)</td><td>{}</td><td>{:.1f} ({:.1f} to {:.1f})</td>"
          "<td>{:.1f} ({:.1f} to {:.1f})</td><td>{:.1f}</td></tr>\n",
          html_escaped(ground.condition), r.places, r.pull_off_median, r.median_low, r.median_high,
          r.pull_off_ninth, r.ninth_low, r.ninth_high, r.pressed_rms);
    }
    for (std::size_t m = 0; m < all.size(); ++m) {
      std::vector<double> pull_off, pressed;
      for (const PlaceError& one : errors[m]) {
        pull_off.push_back(one.pull_off_error());
        if (!elastic::is_steep(one))
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
      table += fmt::format(
          "<tr><td>{}</td><td>{}, {}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.1f}</td></tr>\n",
          html_escaped(ground.condition), html_escaped(all[m].family), html_escaped(all[m].setting),
          errors[m].size(), interval(pull_off, 0.5), interval(pull_off, 0.9),
          100 * elastic::pressed_error(elastic::without_steep(errors[m])));
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
  add_ground_pictures(section, table_file, effort.quick, folder);
  section.rows = std::move(pull_off_rows);
  section.rows.insert(section.rows.end(), pressed_rows.begin(), pressed_rows.end());
  return section;
}

}  // namespace telenano::studies

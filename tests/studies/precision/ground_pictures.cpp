#include "tests/studies/precision/ground_pictures.h"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "telenano/common/config/shared_files.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/potential/retraction.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "tests/studies/elastic/ground_truth.h"
#include "tests/studies/elastic/places.h"
#include "tests/studies/report/gnuplot.h"

namespace telenano::studies {
namespace {

using physics::ContactJet;
using physics::ScanFields;

constexpr double kRadiusNm = 20;
constexpr double kModulusGpa = 52.5;
constexpr double kWorkNPerM = 0.4;
constexpr double kCoarseNm = 1;  // softening beside the finest
constexpr const char* kScans[] = {"wsxm_600nm", "nanoscope_peakforce_1um"};
constexpr const char* kScanNames[] = {"600 nm scan", "1 um scan"};

physics::SofteningRule rule() {
  return physics::softening_rule(kRadiusNm, kWorkNPerM, kModulusGpa, 0.165);
}

surface::HeightGrid scan_of(const char* name) {
  return surface::read_gsf(config::find_shared(name, "data", ".gsf")).grid;
}

/// H and the radius of an apex on the ground at one softening: δ is 0 at H.
struct Felt {
  double height_nm, radius_nm;
};
Felt felt_at(const ScanFields& fields, double x, double y, double softening_nm) {
  ContactJet low, high;
  fields.at_softening({x, y, 0.0}, softening_nm, low);
  fields.at_softening({x, y, 1.0}, softening_nm, high);  // δ = (H − z) c
  return {low.overlap_nm / (low.overlap_nm - high.overlap_nm), std::exp(low.log_radius)};
}

void draw_fields(Section& section, bool quick, const FigureFolder& folder) {
  const surface::HeightGrid scan = scan_of(kScans[0]);
  const ScanFields fields(scan, kRadiusNm, rule());
  const int side = quick ? 24 : 160;
  const double width = (scan.columns - 1) * scan.dx_nm;
  std::string data = "# x_nm,y_nm,scan_nm,H_finest_nm,R_finest_nm,H_coarse_nm,R_coarse_nm\n";
  const double finest = rule().finest_nm;
  for (int j = 0; j < side; ++j) {
    for (int i = 0; i < side; ++i) {
      const double x = width * i / (side - 1), y = width * j / (side - 1);
      const Felt fine = felt_at(fields, scan.x_first_nm + x, scan.y_first_nm + y, finest);
      const Felt coarse = felt_at(fields, scan.x_first_nm + x, scan.y_first_nm + y, kCoarseNm);
      const auto column = static_cast<std::size_t>(std::lround(x / scan.dx_nm));
      const auto row = static_cast<std::size_t>(std::lround(y / scan.dy_nm));
      data += fmt::format("{:.5g},{:.5g},{:.5g},{:.5g},{:.5g},{:.5g},{:.5g}\n", x, y,
                          scan.z_nm[row * static_cast<std::size_t>(scan.columns) + column], fine.height_nm,
                          fine.radius_nm, coarse.height_nm, coarse.radius_nm);
    }
    data += '\n';
  }
  folder.write("ground_fields.csv", data);
  const auto panel = [&](const char* title, const char* what, const char* settings) {
    return fmt::format("set title \"{}\"\n{}\nplot 'ground_fields.csv' using 1:2:({}) with image pixels\n",
                       title, settings, what);
  };
  const char* const radius = "set logscale cb\nset cbrange [5:80]\nset cbtics (5,10,20,40,80)";
  const char* const height = "unset logscale cb\nset cbrange [*:*]\nset cbtics auto";
  std::string script =
      "unset key\nset size ratio -1\nset grid noxtics noytics\nset palette defined (0 '#222244', 1 "
      "'#0072B2', 2 '#9BB8CC', 3 '#F5F0E0', 4 '#D55E00')\nset tics out nomirror\n"
      "set xrange [0:" +
      fmt::format("{0:.4g}]\nset yrange [0:{0:.4g}]\n", width) + "set multiplot layout 2,2\n";
  script += panel("H where the tip touches, finest softening (nm)", "$4", height);
  script += panel("effective radius there (nm)", "$5", radius);
  script += panel("H at softening 1 nm less H at the finest (nm)", "$6-$4", height);
  script += panel("effective radius at softening 1 nm (nm)", "$7", radius);
  script += "unset multiplot\n";
  Figure figure{
      "ground_fields", "What the tip feels of a scan",
      fmt::format("The 600 nm scan dilated by a tip of {:g} nm, x and y in nm: the height H of the apex "
                  "at which it touches, and its effective radius of contact, at the finest softening "
                  "({:.2g} nm, the pull-off's) and at {:g} nm (of a pressed tip). On a peak the radius is "
                  "below the tip's, in "
                  "a groove, where two sides bear, above it.",
                  kRadiusNm, finest, kCoarseNm),
      ""};
  folder.draw(figure, 1000, 900, script);
  section.figures.push_back(figure);
}

void draw_lines(Section& section, const std::function<std::filesystem::path(const std::string&)>& table_file,
                const FigureFolder& folder) {
  physics::TipSampleParameters parameters;
  parameters.contact_modulus_gpa = kModulusGpa * 4 / 3;
  parameters.work_of_adhesion_n_m = kWorkNPerM;
  const physics::BranchPotential law(physics::TipSampleLaw(parameters), kRadiusNm);
  const elastic::ForceOf on_flat = elastic::flat_force(law, kRadiusNm);
  const auto pull_off = std::make_shared<const physics::RetractionKernel>(retraction_kernel(law, kRadiusNm));
  const std::vector<double> softenings = {rule().finest_nm, 0.25, 1.0};
  std::string data =
      "# along_nm,elastic_normal_nn,elastic_lateral_nn,served_normal,served_lateral,then each "
      "softening's normal,lateral\n";
  constexpr int kLines = 3;  // the table's first ones
  for (const char* const name : kScans) {
    const surface::HeightGrid scan = scan_of(name);
    const std::vector<elastic::Line> lines =
        elastic::read_lines(table_file(std::string("lines_") + name).string());
    const elastic::Place flat =
        elastic::read_places(table_file(std::string("places_") + name).string()).at(0);
    for (std::size_t k = 0; k < kLines; ++k) {
      const elastic::Line& line = lines.at(k);
      const ScanFields fields(elastic::piece_round(scan, line.column, line.row), kRadiusNm, rule(), {}, {},
                              pull_off);
      const double x = scan.x_first_nm + line.column * scan.dx_nm,
                   y = scan.y_first_nm + line.row * scan.dy_nm;
      for (const elastic::LineState& state : line.states) {
        // What Lennard and Jones' attraction differs from Dugdale's on the flat sample is taken out.
        const double above = state.z_nm - state.touch_nm;
        const double shift = elastic::same_flat_force_nm(flat, on_flat, above) - above;
        const Vec3 apex(x + state.along_nm, y, state.z_nm + shift);
        data += fmt::format("{:.4g},{:.5g},{:.5g}", state.along_nm, state.force_nn, state.lateral_nn);
        const auto put = [&](const ContactJet& jet) {
          data += fmt::format(",{:.5g},{:.5g}", elastic::retraction_force_nn(law, jet),
                              elastic::lateral_force_nn(law, jet));
        };
        ContactJet jet;
        fields.contact_at(apex, jet);
        put(jet);
        for (const double t : softenings) {
          fields.at_softening(apex, t, jet);
          put(jet);
        }
        data += '\n';
      }
      data += "\n\n";
    }
  }
  folder.write("ground_line.csv", data);
  std::string script =
      "set multiplot layout 4,3 margins 0.05,0.98,0.04,0.96 spacing 0.06,0.06\nset tics out nomirror\nset "
      "xrange [-3:3]\nset xtics 1\nset format x '%g'\n";
  const char* const colours[] = {kGreen, kPurple, kGrey};
  for (int scan = 0; scan < 2; ++scan) {
    for (const bool lateral : {false, true}) {
      for (int k = 0; k < kLines; ++k) {
        script +=
            fmt::format("set title \"{}, line {}: {} (nN)\"\n{}\n", kScanNames[scan], k + 1,
                        lateral ? "lateral force" : "normal force",
                        scan == 0 && !lateral && k == 0 ? "set key bottom left samplen 1.5" : "unset key");
        const auto curve_of = [&](int column, const std::string& how, const std::string& title) {
          return fmt::format("'ground_line.csv' index {} using 1:{} {} title \"{}\"", scan * kLines + k,
                             column + (lateral ? 1 : 0), how, title);
        };
        script +=
            "plot " + curve_of(2, fmt::format("with points pt 7 ps 0.4 lc rgb '{}'", kInk), "elasticity");
        script += ", " + curve_of(4, fmt::format("with lines lw 2.2 lc rgb '{}'", kBlue), "as served");
        for (std::size_t s = 0; s < softenings.size(); ++s) {
          script += ", " + curve_of(6 + 2 * static_cast<int>(s),
                                    fmt::format("with lines lw 1.2 lc rgb '{}'", colours[s]),
                                    fmt::format("t = {:.2g} nm", softenings[s]));
        }
        script += '\n';
      }
    }
  }
  script += "unset multiplot\n";
  Figure figure{
      "ground_line", "Raster lines: normal and lateral force beside elasticity",
      "A tip led along x at a constant height, 0.4 nm below first touch at the middle (x in nm from "
      "there), at the table's first three of 16 places chosen at random on each scan. Points: boundary "
      "elements of an elastic half-space with Lennard-Jones adhesion. Lines: the potential as it is served, "
      "and at one softening each, at the height where its flat sample pushes as the oracle's does.",
      ""};
  folder.draw(figure, 1000, 1080, script);
  section.figures.push_back(figure);
}

}  // namespace

void add_ground_pictures(Section& section,
                         const std::function<std::filesystem::path(const std::string&)>& table_file,
                         bool quick, const FigureFolder& folder) {
  draw_fields(section, quick, folder);
  draw_lines(section, table_file, folder);
}

}  // namespace telenano::studies

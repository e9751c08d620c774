#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/surface/gsf.h"
#include "tests/studies/elastic/places.h"
#include "tests/studies/elastic/self_affine.h"

// tests/data/elastic/README.md says which tables were made with this.

namespace {

using telenano::elastic::Ground;
using telenano::elastic::Probe;

constexpr double kPi = 3.14159265358979323846;

struct Shape {
  const char* name;
  double (*height)(double x, double y);
};

double groove(double x, double degrees) {
  return std::abs(x) * std::tan(degrees * kPi / 180);
}

// Far from the axis, where the patch repeats, the gap is too wide for a step to be felt.
constexpr Shape kShapes[] = {
    {"flat", [](double, double) { return 0.0; }},
    {"groove-15", [](double x, double) { return groove(x, 15); }},
    {"groove-8", [](double x, double) { return groove(x, 8); }},
    {"groove-30", [](double x, double) { return groove(x, 30); }},
    {"groove-15-one-side-lower",
     [](double x, double) { return x > 0 ? groove(x, 15) : std::max(groove(x, 15) - 0.15, -0.075); }},
    {"trench-24", [](double x, double) { return -1.2 * std::cos(2 * kPi * x / 24); }},
    {"trench-16", [](double x, double) { return -1.2 * std::cos(2 * kPi * x / 16); }},
    {"ridge-16", [](double x, double) { return 1.2 * std::cos(2 * kPi * x / 16); }},
    {"bumps-4",
     [](double x, double y) { return 0.15 * std::cos(2 * kPi * x / 4.166) * std::cos(2 * kPi * y / 4.166); }},
};

struct Options {
  std::vector<std::string> what;
  Probe probe;
  double heights_times = 1;
  double from_nm = -0.8, to_nm = 1.0, step_nm = 0.04;
  double line_nm = 0, depth_nm = 0.4;
  bool pull_off = false;
};

// CLI11's ranges let "nan" through: no comparison fails with it.
CLI::Validator between(double low, double high) {
  return {[low, high](const std::string& text) {
            double value = 0;
            if (CLI::detail::lexical_cast(text, value) && value >= low && value <= high) return std::string();
            return fmt::format("'{}' is no number between {} and {}", text, low, high);
          },
          fmt::format("{} to {}", low, high)};
}

void require_meaning(const Options& options) {
  if (!(options.from_nm < options.to_nm)) {
    throw telenano::UserError("--from-nm must be below --to-nm: the tip is led from the first to the last");
  }
}

void print_curve(const Options& options, const std::string& place, int column, int row,
                 const Ground& ground) {
  std::vector<double> heights;
  const int steps = static_cast<int>(std::lround((options.to_nm - options.from_nm) / options.step_nm));
  for (int k = 0; k <= steps; ++k) heights.push_back(options.from_nm + options.step_nm * k);
  const auto states = telenano::elastic::follow(options.probe, ground, heights);
  if (options.pull_off) {
    telenano::elastic::Place curve;
    curve.states = states;
    std::printf("%s,%d,%d,%.5f,%.5g\n", place.c_str(), column, row, ground.touch_nm, curve.pull_off_nn());
    std::fflush(stdout);
    return;
  }
  for (const auto& state : states) {
    std::printf("%s,%d,%d,%.5f,%.5f,%.5g\n", place.c_str(), column, row, ground.touch_nm, state.z_nm,
                state.force_nn);
  }
  std::fflush(stdout);
}

void print_line(const Options& options, const std::string& place, int column, int row,
                const telenano::surface::HeightGrid& scan) {
  for (const auto& state :
       along_line(options.probe, scan, scan.x_first_nm + column * scan.dx_nm,
                  scan.y_first_nm + row * scan.dy_nm, options.line_nm, options.step_nm, options.depth_nm)) {
    std::printf("%s,%d,%d,%.5f,%.5f,%.5f,%.5g,%.5g\n", place.c_str(), column, row, state.along_nm,
                state.touch_nm, state.z_nm, state.force_nn, state.lateral_nn);
  }
  std::fflush(stdout);
}

constexpr const char* kSelfAffine = "self-affine-";
bool is_self_affine(const std::string& name) {
  return name.rfind(kSelfAffine, 0) == 0;
}
const telenano::elastic::SelfAffine& self_affine_of(const std::string& name) {
  const auto& grounds = telenano::elastic::tabled_grounds();
  for (std::size_t k = 0; k < grounds.size(); ++k) {
    if (name == kSelfAffine + std::to_string(k)) return grounds[k];
  }
  throw telenano::UserError(fmt::format("{}: expected {}0 to {}", name, kSelfAffine, grounds.size() - 1));
}

void run_scan(const Options& options) {
  if (options.what.size() < 2) {
    throw telenano::UserError(options.what.front() + ": name at least one place of it, as COLUMN,ROW");
  }
  auto scan = is_self_affine(options.what.front())
                  ? telenano::elastic::self_affine(self_affine_of(options.what.front()))
                  : telenano::surface::read_gsf(options.what.front()).grid;
  for (double& z : scan.z_nm) z *= options.heights_times;
  for (std::size_t k = 1; k < options.what.size(); ++k) {
    int column = 0, row = 0, read = 0;
    if (std::sscanf(options.what[k].c_str(), "%d,%d%n", &column, &row, &read) != 2 ||
        options.what[k].size() != static_cast<std::size_t>(read) || column < 0 || row < 0 ||
        column >= scan.columns || row >= scan.rows) {
      throw telenano::UserError(options.what[k] + ": expected COLUMN,ROW within the scan");
    }
    if (options.line_nm > 0) {
      print_line(options, std::to_string(k - 1), column, row, scan);
      continue;
    }
    print_curve(options, std::to_string(k - 1), column, row,
                ground_of(options.probe, scan, scan.x_first_nm + column * scan.dx_nm,
                          scan.y_first_nm + row * scan.dy_nm));
  }
}

void run_shapes(const Options& options) {
  const telenano::testing::ElasticPatch patch(
      options.probe.elements, options.probe.elements * options.probe.spacing_nm, options.probe.modulus_gpa);
  for (const std::string& name : options.what) {
    const auto* shape = std::find_if(std::begin(kShapes), std::end(kShapes),
                                     [&](const Shape& one) { return name == one.name; });
    if (shape == std::end(kShapes)) throw telenano::UserError(name + ": no such shape");
    print_curve(options, shape->name, 0, 0, ground_of(options.probe, patch, shape->height));
  }
}

}  // namespace

// What flags are made of throws for want of memory only. NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  Options options;
  CLI::App app{
      "Retraction curves (CSV) of a sphere from an adhesive elastic half-space, by boundary elements"};
  std::string shapes;
  for (const Shape& shape : kShapes) shapes += std::string(" ") + shape.name;
  app.add_option("what", options.what,
                 "FILE.gsf COLUMN,ROW ...   or self-affine-0 to 3 COLUMN,ROW ...   or shapes:" + shapes)
      ->required();
  app.add_option("--radius-nm", options.probe.radius_nm, "of the tip")
      ->check(between(0.1, 1e4))
      ->capture_default_str();
  app.add_option("--modulus-gpa", options.probe.modulus_gpa, "E*, plane strain")
      ->check(between(1e-3, 1e4))
      ->capture_default_str();
  app.add_option("--adhesion-n-m", options.probe.adhesion.work_n_per_m, "work of adhesion")
      ->check(between(0, 10))
      ->capture_default_str();
  app.add_option("--spacing-nm", options.probe.spacing_nm, "of the elements")
      ->check(between(1e-3, 100))
      ->capture_default_str();
  app.add_option("--elements", options.probe.elements, "along each side: a power of two")
      ->check(CLI::IsMember({64, 128, 256, 512}))
      ->capture_default_str();
  app.add_flag(
      "--short-range", options.probe.short_range,
      "adhesion of no range (JKR), for soft samples: elements come off where their pull lets go of the "
      "work of adhesion");
  app.add_option("--heights-times", options.heights_times, "makes a scan steeper")
      ->check(between(0, 1e3))
      ->capture_default_str();
  app.add_option("--from-nm", options.from_nm, "first height, above first touch")
      ->check(between(-100, 100))
      ->capture_default_str();
  app.add_option("--to-nm", options.to_nm, "last height")->check(between(-100, 100))->capture_default_str();
  app.add_flag("--pull-off", options.pull_off,
               "a line a place: place, column, row, height of first touch (nm), greatest attraction (nN)");
  app.add_option("--line-nm", options.line_nm,
                 "instead of heights: normal and lateral force along a line of this length along x at a "
                 "constant height")
      ->check(between(0, 1e3));
  app.add_option("--depth-nm", options.depth_nm, "of that line, below first touch at its middle")
      ->check(between(-10, 10))
      ->capture_default_str();
  app.add_option("--step-nm", options.step_nm, "between heights, or along a line")
      ->check(between(1e-4, 1.0))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  if (options.probe.short_range) options.probe.axis_x = 0.37, options.probe.axis_y = 0.21;
  try {
    require_meaning(options);
    const std::string& first = options.what.front();
    if (is_self_affine(first) || (first.size() > 4 && first.substr(first.size() - 4) == ".gsf"))
      run_scan(options);
    else
      run_shapes(options);
    return 0;
  } catch (const telenano::UserError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "common/base/error.h"
#include "common/surface/gsf.h"
#include "tests/studies/elastic/places.h"

// telenano-elastic-oracle FILE.gsf COLUMN,ROW ...   or   telenano-elastic-oracle NAME ...
//
// Retraction curves (CSV) of a sphere of 20 nm, E* = 52.5 GPa, w = 0.4 N/m, z0 = 0.165 nm, at samples of a
// scan or over shapes whose formula is below. tests/data/elastic/README.md says which tables were made with
// it.

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

int run(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: telenano-elastic-oracle FILE.gsf COLUMN,ROW ... | SHAPE ...\nshapes:");
    for (const Shape& shape : kShapes) std::fprintf(stderr, " %s", shape.name);
    std::fprintf(stderr, "\n");
    return 2;
  }
  const Probe probe;
  const telenano::testing::ElasticPatch patch(probe.elements, probe.elements * probe.spacing_nm,
                                              probe.modulus_gpa);
  std::vector<double> heights;
  for (int k = -20; k <= 25; ++k) heights.push_back(0.04 * k);
  const auto print = [&](const std::string& place, int column, int row, const Ground& ground) {
    for (const auto& state : telenano::elastic::follow(probe, ground, heights)) {
      std::printf("%s,%d,%d,%.5f,%.5f,%.5g\n", place.c_str(), column, row, ground.touch_nm, state.z_nm,
                  state.force_nn);
    }
    std::fflush(stdout);
  };
  std::printf("place,column,row,touch_nm,z_nm,force_nn\n");
  const std::string first = argv[1];
  if (first.size() > 4 && first.substr(first.size() - 4) == ".gsf") {
    const auto scan = telenano::surface::read_gsf(first).grid;
    for (int k = 2; k < argc; ++k) {
      int column = 0, row = 0;
      if (std::sscanf(argv[k], "%d,%d", &column, &row) != 2 || column < 0 || row < 0 ||
          column >= scan.columns || row >= scan.rows) {
        throw telenano::UserError(std::string(argv[k]) + ": expected COLUMN,ROW within the scan");
      }
      print(
          std::to_string(k - 2), column, row,
          ground_of(probe, scan, scan.x_first_nm + column * scan.dx_nm, scan.y_first_nm + row * scan.dy_nm));
    }
    return 0;
  }
  for (int k = 1; k < argc; ++k) {
    const auto* shape = std::find_if(std::begin(kShapes), std::end(kShapes),
                                     [&](const Shape& one) { return argv[k] == std::string(one.name); });
    if (shape == std::end(kShapes)) throw telenano::UserError(std::string(argv[k]) + ": no such shape");
    print(shape->name, 0, 0, ground_of(probe, patch, shape->height));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const telenano::UserError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}

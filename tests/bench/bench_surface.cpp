#include <benchmark/benchmark.h>

#include <cmath>
#include <string>
#include <vector>

#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/surface/dilation.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"
#include "tests/source_dir.h"

// Time of the surface's part of a step, on the scan of deploy/data (256×256, 2.34 nm, some 10 nm deep) under
// a tip of 20 nm: the apex goes on a wide Lissajous figure.

namespace {

using telenano::Vec3;
using telenano::physics::SplineSurface;

constexpr double kRadius = 20;
constexpr int kPath = 20000;

const telenano::physics::HeightGrid& scan() {
  static const telenano::physics::HeightGrid grid =
      telenano::surface::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf").grid;
  return grid;
}

const SplineSurface& surface() {
  static const SplineSurface surface(scan());
  return surface;
}

void height_jet(benchmark::State& bench) {
  double x = 100;
  for (auto _ : bench) {
    benchmark::DoNotOptimize(surface().jet(x, 300 - 0.5 * x));
    x = x > 500 ? 100 : x + 0.37;
  }
}

/// A mark with its rim at range(0) tenths of a nanometre: nodes and spline.
void press(benchmark::State& bench) {
  SplineSurface pressed(surface());
  double x = 100;
  for (auto _ : bench) {
    pressed.press({x, 300 - 0.5 * x, 1e-6, 0.1 * static_cast<double>(bench.range(0))});
    x = x > 500 ? 100 : x + 0.37;
  }
}

const telenano::physics::SofteningRule& rule() {
  static const telenano::physics::SofteningRule rule =
      telenano::physics::softening_rule(kRadius, 0.4, 52.5, 0.165);
  return rule;
}

const telenano::physics::ScanFields& fields() {
  static const telenano::physics::ScanFields fields(scan(), kRadius, rule());
  return fields;
}

/// One evaluation of the fields with gradients and Hessians, `range(0)` hundredths of a nanometre above touch
/// (negative: pressed) on a path of 0.1 nm a step. 0: the finest softening alone.
void fields_contact(benchmark::State& bench) {
  std::vector<Vec3> apexes;
  double t = 0;
  for (int i = 0; i < kPath; ++i) {
    const double x = 300 + 230 * std::sin(t), y = 300 + 230 * std::sin(1.37 * t + 0.4);
    apexes.emplace_back(x, y, fields().touch_height_nm(x, y) + 0.01 * static_cast<double>(bench.range(0)));
    t += 0.1 / 250;
  }
  std::size_t i = 0;
  telenano::physics::ContactJet jet;
  for (auto _ : bench) {
    fields().contact_at(apexes[i], jet);
    benchmark::DoNotOptimize(jet);
    if (++i == apexes.size()) i = 0;
  }
}

/// At a fixed softening of 0.35 nm.
void fields_at_softening(benchmark::State& bench) {
  telenano::physics::ContactJet jet;
  double x = 100;
  for (auto _ : bench) {
    fields().at_softening(Vec3(x, 300 - 0.5 * x, 5), 0.35, jet);
    benchmark::DoNotOptimize(jet);
    x = x > 500 ? 100 : x + 0.1;
  }
}

/// Set-up of all levels; of the 256² scan.
void fields_made(benchmark::State& bench) {
  for (auto _ : bench) {
    const telenano::physics::ScanFields made(scan(), kRadius, rule());
    benchmark::DoNotOptimize(made.bytes());
  }
}

/// One tile of 64 × 64 nodes of the finest level.
void fields_tile(benchmark::State& bench) {
  using telenano::physics::Dilation;
  const auto height = telenano::physics::BicubicSpline::interpolating(scan());
  const double t = rule().finest_nm;
  const auto lattice =
      telenano::physics::dilation_lattice(height, 0.5 * scan().dx_nm, 0.65 * std::sqrt(kRadius * t));
  const Dilation dilation(height, lattice, kRadius, t, 20);
  std::vector<telenano::physics::DilatedNode> nodes;
  int tile = 0;
  for (auto _ : bench) {
    dilation.make_tile(tile % dilation.tile_columns(), tile / dilation.tile_columns() % dilation.tile_rows(),
                       nodes);
    benchmark::DoNotOptimize(nodes.data());
    ++tile;
  }
}

BENCHMARK(fields_contact)->Arg(-300)->Arg(-30)->Arg(0)->Arg(100)->Arg(1000);
BENCHMARK(fields_at_softening);
BENCHMARK(fields_made)->Unit(benchmark::kMillisecond)->Iterations(2);
BENCHMARK(fields_tile)->Unit(benchmark::kMillisecond);
BENCHMARK(press)->Arg(30)->Arg(100)->Arg(300);
BENCHMARK(height_jet);

}  // namespace

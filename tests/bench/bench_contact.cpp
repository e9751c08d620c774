#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <random>
#include <vector>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "tests/support/contact_paths.h"

// Time of one TipSampleLaw::advance. Paths are smooth oscillations as a hand makes them: about a hundredth of
// the depth a step, which is fast for 1 kHz.

namespace {

using telenano::physics::ContactLaw;
using telenano::physics::Equilibrium;
using telenano::physics::Held;
using telenano::physics::MaugisDugdale;
using telenano::physics::MaugisMethod;
using telenano::physics::MaugisTable;
using telenano::physics::TipSampleLaw;
using telenano::physics::TipSampleState;
using telenano::testing::material_of;
using telenano::testing::silicon_on;

constexpr int kPath = 4096;

std::vector<double> oscillation(double low, double high) {
  std::vector<double> path;
  for (int i = 0; i < kPath; ++i)
    path.push_back(0.5 * (low + high) + 0.5 * (high - low) * std::sin(0.0123 * i));
  return path;
}

/// Material 0..2: silicon oxide, polystyrene, PDMS under a silicon tip of 20 nm.
TipSampleLaw law_of(std::int64_t material) {
  constexpr double kSamples[3][3] = {{70, 0.2, 0.27}, {2, 0.066, 0.4}, {0.001, 0.022, 0.5}};
  const double* s = kSamples[material];
  return TipSampleLaw(silicon_on(s[0], s[1], s[2], true));
}

void walk(benchmark::State& bench, double low, double high, double stiffness, bool radius_changes) {
  const TipSampleLaw law = law_of(bench.range(0));
  const double unit = law.scales(20).overlap_nm;
  const std::vector<double> path = oscillation(low * unit, high * unit);
  const std::vector<double> radius = oscillation(18, 22);
  TipSampleState state;
  law.advance(high * unit, 1 / stiffness, 20, state);
  std::size_t i = 0;
  for (auto _ : bench) {
    const Equilibrium e = law.advance(path[i], 1 / stiffness, radius_changes ? radius[i] : 20, state);
    benchmark::DoNotOptimize(e);
    i = (i + 1) % kPath;
  }
}

void warm_in_contact(benchmark::State& bench) {
  walk(bench, 0.5, 8, 42, false);
}
void warm_in_contact_changing_radius(benchmark::State& bench) {
  walk(bench, 0.5, 8, 42, true);
}
void warm_with_snap_in_and_pull_off(benchmark::State& bench) {
  walk(bench, -40, 5, 42, false);
}
void warm_everything_changes(benchmark::State& bench) {
  walk(bench, -40, 5, 42, true);
}
void outside(benchmark::State& bench) {
  walk(bench, -400, -40, 42, false);
}

void cold_in_contact(benchmark::State& bench) {
  const TipSampleLaw law = law_of(bench.range(0));
  const MaugisDugdale curve(law.lambda(20));
  const std::vector<double> path = oscillation(0.5, 8);
  std::size_t i = 0;
  for (auto _ : bench) {
    benchmark::DoNotOptimize(curve.solve(path[i], {1.0, 0.0}).point);
    i = (i + 1) % kPath;
  }
}

/// A fresh state, one long step into contact: scales, handover, jump and solution.
void from_nothing(benchmark::State& bench) {
  const TipSampleLaw law = law_of(bench.range(0));
  const double unit = law.scales(20).overlap_nm;
  for (auto _ : bench) {
    TipSampleState state;
    benchmark::DoNotOptimize(law.advance(2 * unit, 1.0 / 42, 20, state));
  }
}

void one_curve_evaluation(benchmark::State& bench) {
  const MaugisDugdale curve(law_of(bench.range(0)).lambda(20));
  double u = 1.5 * (1 + curve.lambda() * curve.lambda());
  for (auto _ : bench) {
    benchmark::DoNotOptimize(u);
    benchmark::DoNotOptimize(curve.contact(u));
  }
}

void fold(benchmark::State& bench) {
  const MaugisDugdale curve(law_of(bench.range(0)).lambda(20));
  for (auto _ : bench) benchmark::DoNotOptimize(curve.fold({1.0, 0.3}));
}

/// The laws and the table on the same path, flat sample: polystyrene, argument the ContactLaw; 7 is
/// Maugis–Dugdale by table.
void warm_by_law(benchmark::State& bench) {
  telenano::physics::TipSampleParameters p = silicon_on(2, 0.066, 0.4, true);
  const bool table = bench.range(0) == 7;
  p.model = table ? ContactLaw::kMaugisDugdale : static_cast<ContactLaw>(bench.range(0));
  if (table) p.method = MaugisMethod::kTable;
  p.van_der_waals = p.model != ContactLaw::kHertz;
  const TipSampleLaw law(p, 20);
  const double unit = law.scales(20).overlap_nm;
  const std::vector<double> path = oscillation(0.5 * unit, 8 * unit);
  const double compliance = bench.range(1) == 0 ? 0.0 : 1.0 / 42;
  TipSampleState state;
  law.advance(8 * unit, compliance, 20, state);
  std::size_t i = 0;
  for (auto _ : bench) {
    benchmark::DoNotOptimize(law.advance(path[i], compliance, 20, state));
    i = (i + 1) % kPath;
  }
}

/// The table alone, overlap given: square root, segment, cubics.
void table_evaluation(benchmark::State& bench) {
  const MaugisTable table(law_of(bench.range(0)).lambda(20));
  const std::vector<double> path = oscillation(0.5, 8);
  std::size_t i = 0;
  for (auto _ : bench) {
    benchmark::DoNotOptimize(table.solve(path[i], {1.0, 0.0}).point.load);
    i = (i + 1) % kPath;
  }
}

/// The force alone, and a floor: a cubic of a uniform grid over the overlap, without square root.
void table_force(benchmark::State& bench) {
  const MaugisTable table(law_of(bench.range(0)).lambda(20));
  const std::vector<double> path = oscillation(0.5, 8);
  std::size_t i = 0;
  for (auto _ : bench) {
    benchmark::DoNotOptimize(table.load_at(path[i]));
    i = (i + 1) % kPath;
  }
}
void table_force_floor(benchmark::State& bench) {
  const MaugisTable table(law_of(0).lambda(20));
  std::vector<std::array<double, 4>> cubics;
  for (int k = 0; k < 832; ++k) cubics.push_back({table.load_at(0.01 * k), 0.015, 1e-5, 1e-7});
  const std::vector<double> path = oscillation(0.5, 8);
  std::size_t i = 0;
  for (auto _ : bench) {
    const double place = path[i] * 100.0;
    const auto cell = static_cast<std::size_t>(place);
    const double x = place - static_cast<double>(cell);
    const std::array<double, 4>& c = cubics[cell];
    benchmark::DoNotOptimize(c[0] + x * (c[1] + x * (c[2] + x * c[3])));
    i = (i + 1) % kPath;
  }
}

/// The worst input that 20 000 random ones hold: lambda, overlap, compliance, and the step since the last
/// state, whose parameter is the guess (one in four: none). Those that take the most evaluations are timed,
/// and the greatest of their medians is reported.
void worst_input(benchmark::State& bench) {
  struct Input {
    double lambda, z, guess;
    Held held;
    int evaluations;
  };
  std::mt19937_64 bits(20240607);
  const auto uniform = [&] { return static_cast<double>(bits() >> 11) * 0x1p-53; };
  const auto between = [&](double low, double high) { return low * std::pow(high / low, uniform()); };
  std::vector<Input> inputs;
  for (int i = 0; i < 20000; ++i) {
    Input in{};
    in.lambda = between(1e-3, 1.2e4);
    in.held = {1.0, i % 2 == 0 ? 0.0 : between(1e-3, 1e2)};
    const MaugisDugdale curve(in.lambda);
    const double end = curve.fold(in.held).held(in.held);
    const double above = between(1e-9, 1e4);
    in.z = end + above;
    const double last = end + above * between(0.01, 100);
    if (i % 4 != 0) in.guess = curve.solve(last, in.held).point.parameter;
    if (!(in.guess > 0)) in.guess = 0;
    in.evaluations = curve.solve(in.z, in.held, in.guess).evaluations;
    inputs.push_back(in);
  }
  std::sort(inputs.begin(), inputs.end(),
            [](const Input& a, const Input& b) { return a.evaluations > b.evaluations; });
  inputs.resize(20);
  double worst = 0;
  Input found = inputs.front();
  for (auto _ : bench) {
    for (const Input& in : inputs) {
      const MaugisDugdale curve(in.lambda);
      std::array<double, 31> times{};
      for (double& t : times) {
        const auto start = std::chrono::steady_clock::now();
        for (int k = 0; k < 32; ++k) benchmark::DoNotOptimize(curve.solve(in.z, in.held, in.guess).point);
        t = std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - start).count() / 32;
      }
      std::nth_element(times.begin(), times.begin() + 15, times.end());
      if (times[15] > worst) {
        worst = times[15];
        found = in;
      }
    }
  }
  bench.counters["ns"] = worst;
  bench.counters["most_evaluations"] = inputs.front().evaluations;
  bench.counters["lambda"] = found.lambda;
  bench.counters["z"] = found.z;
  bench.counters["compliance"] = found.held.load;
}

void table_construction(benchmark::State& bench) {
  const double lambda = law_of(bench.range(0)).lambda(20);
  for (auto _ : bench) {
    const MaugisTable table(lambda);
    benchmark::DoNotOptimize(table.contact(1.0).load);
  }
}

BENCHMARK(warm_by_law)->ArgsProduct({benchmark::CreateDenseRange(0, 7, 1), {0, 1}});
BENCHMARK(table_evaluation)->DenseRange(0, 2);
BENCHMARK(table_force)->DenseRange(0, 2);
BENCHMARK(table_force_floor);
BENCHMARK(worst_input)->Iterations(1);
BENCHMARK(table_construction)->DenseRange(0, 2);
BENCHMARK(warm_in_contact)->DenseRange(0, 2);
BENCHMARK(warm_in_contact_changing_radius)->DenseRange(0, 2);
BENCHMARK(warm_with_snap_in_and_pull_off)->DenseRange(0, 2);
BENCHMARK(warm_everything_changes)->DenseRange(0, 2);
BENCHMARK(outside)->DenseRange(0, 2);
BENCHMARK(cold_in_contact)->DenseRange(0, 2);
BENCHMARK(from_nothing)->DenseRange(0, 2);
BENCHMARK(one_curve_evaluation)->DenseRange(0, 2);
BENCHMARK(fold)->DenseRange(0, 2);

}  // namespace

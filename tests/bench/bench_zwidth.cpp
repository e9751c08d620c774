#include <benchmark/benchmark.h>

#include "tests/studies/zwidth/wall_simulation.h"

// Steps a second of the simulated virtual wall; target 10 M a core. The wall is stable, so that a run takes
// its whole time. Argument: 0 ideal, 1 with encoder and quantised force command, 2 with dry friction besides,
// 3 with three samples of delay.

namespace {

using telenano::studies::PushingHand;
using telenano::studies::simulate_wall;
using telenano::studies::WallPlant;

void wall(benchmark::State& bench) {
  WallPlant plant;
  plant.display = {20.0, 2.0, 1e-3};
  plant.damper.damping_n_s_m = 5;
  plant.damper.filter_s = 5.3e-3;
  if (bench.range(0) == 1 || bench.range(0) == 2) {
    plant.encoder_quantum_m = 1.18e-4;
    plant.force_quantum_n = 0.01;
  }
  if (bench.range(0) == 2) plant.coulomb_friction_n = 0.1;
  if (bench.range(0) == 3) plant.damper.delay_samples = 3;
  std::int64_t steps = 0;
  for (auto _ : bench) {
    const telenano::studies::WallRun run = simulate_wall(plant, 4000, PushingHand{{}, 10});
    benchmark::DoNotOptimize(run.peak_to_peak_m);
    steps += run.steps;
  }
  bench.SetItemsProcessed(steps);
}
BENCHMARK(wall)->DenseRange(0, 3);

}  // namespace

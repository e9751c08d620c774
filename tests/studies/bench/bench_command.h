#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// Adds `bench net|codec|server|memory`: the product beside its floor in one run, CSV on standard output.
void add_bench_command(CLI::App& app);

}  // namespace telenano::studies

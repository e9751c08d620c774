#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// Adds `net`, `codec`, `server` and `memory` to `bench`: the product beside its floor in one run, CSV on
/// standard output, what misses its target on standard error.
void add_throughput_benches(CLI::App& bench);

}  // namespace telenano::studies

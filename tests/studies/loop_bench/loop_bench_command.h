#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// `telenano-lab bench loop`: how late the station's loop wakes, beside cyclictest. CSV on standard output,
/// medians and ratios on standard error.
void add_loop_bench(CLI::App& bench);

}  // namespace telenano::studies

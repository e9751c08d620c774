#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "telenano/common/control/method.h"

namespace CLI {
class App;
}

namespace telenano::studies {

struct MethodsOptions {
  std::filesystem::path out = "methods";
  std::vector<control::Method> methods;  ///< empty: all that this build has
  std::vector<double> rtt_ms{0, 10, 20, 50, 100, 200, 500, 1000};
  std::string only;  ///< "press" or "attack"; empty: both
  bool quick = false;
  std::uint64_t seed = 1;
};

/// Compares the methods that keep a station's port passive: what they show of a wall at each round trip, and
/// what hands that mean harm get out of them. Writes into `out`: index.html (self-contained), CSV files and
/// the figures with their scripts. On standard output CSV: what is shown, one row a method and round trip;
/// with only "attack" instead the worst attacks, one row a method, round trip and channel.
void run_methods(const MethodsOptions& options);

void add_methods_command(CLI::App& app);

}  // namespace telenano::studies

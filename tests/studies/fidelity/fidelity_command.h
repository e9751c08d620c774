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

struct FidelityOptions {
  std::filesystem::path out = "fidelity";
  std::vector<std::string> scenes;       ///< "flakes" or "flakes/raster"; empty: all
  std::vector<control::Method> methods;  ///< empty: none, tank, wave, tdpa, model, twin
  std::vector<double> rtt_ms;            ///< empty: 0, 20, 50, 100, 200, 500
  std::vector<double> loss;              ///< empty: 0, 0.1
  std::uint64_t seed = 1;
  bool quick = false;
  bool check_sensitivity = false;
  double reply_permille = 0;  ///< > 0: each cell once more with this deadband of replies, in replies.csv
  bool real = false;          ///< the real programs instead of virtual time
};

/// Felt force against true force. Writes into `out`: index.html (self-contained), fidelity.csv (one row a
/// cell), the figures with their scripts; sensitivity.csv where that is checked. CSV on standard output too.
/// False: a wrong renderer was not found out, or the right one was.
bool run_fidelity(const FidelityOptions& options);

void add_fidelity_command(CLI::App& app, int& exit_code);

}  // namespace telenano::studies

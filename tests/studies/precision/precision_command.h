#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace telenano::studies {

struct PrecisionOptions {
  std::filesystem::path out = "precision";
  bool quick = false;
  std::vector<std::string> only;  ///< names of parts; empty: all
};

/// Measures error against run time of every method that the product has a choice of, and writes into `out`:
/// index.html (self-contained), a CSV a part, and the figures with their scripts under data/. Says on stderr
/// what it is doing. Throws UserError before anything is measured if `out` cannot be written into or a name
/// is unknown.
void run_precision(const PrecisionOptions& options);

void add_precision_command(CLI::App& app);

}  // namespace telenano::studies

#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace CLI {
class App;
}

namespace telenano::studies {

struct AfmOptions {
  std::filesystem::path out = "afm";
  int trials = 1000;
  std::string only;  ///< faults, touch or tasks; empty: all
  std::uint64_t seed = 1;
};

void run_afm(const AfmOptions& options);
/// `telenano-lab afm`.
void add_afm_command(CLI::App& app);

}  // namespace telenano::studies

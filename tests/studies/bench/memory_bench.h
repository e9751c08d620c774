#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tests/studies/bench/result_rows.h"

namespace telenano::studies {

struct MemoryBenchOptions {
  std::string program;  ///< telenano-nve
  std::string flat;     ///< scene
  std::string scan;
  std::size_t from = 64;
  std::size_t to = 256;
};

/// What one more session takes of a real server's memory (resident, /proc/PID/statm), in the clear and over
/// DTLS.
std::vector<BenchRow> run_memory_bench(const MemoryBenchOptions& options);

}  // namespace telenano::studies

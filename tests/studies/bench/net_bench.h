#pragma once

#include <string>
#include <vector>

#include "tests/studies/bench/result_rows.h"

namespace telenano::studies {

struct NetBenchOptions {
  std::string scene;
  int rounds = 15;
  int exchanges = 2000;  ///< of each round, mode and side
  int server_cpu = 0;
  int client_cpu = 1;
  bool low_latency = false;  ///< hold /dev/cpu_dma_latency at 0 meanwhile
};

/// Round trip of an exchange — command made, sent, served by the scene, reply read — beside a ping-pong of
/// the same bytes by plain calls.
std::vector<BenchRow> run_net_bench(const NetBenchOptions& options);

}  // namespace telenano::studies

#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace telenano::studies {

/// What the real-time loop's wake-ups are compared with: the same machine, priority and load, by cyclictest.
struct LoopBenchConfig {
  std::filesystem::path nve;  ///< the programs
  std::filesystem::path master;
  std::vector<double> rates_hz{1000, 4000};
  double seconds = 10;  ///< of each run
  int pairs = 5;        ///< product and floor, one after the other
  int priority = 80;
  bool load = true;                        ///< a busy thread on another core
  std::vector<std::string> station_flags;  ///< handed to `telenano-master run`, e.g. the viewer's
};

struct LoopBenchRow {
  double rate_hz = 0;
  int pair = 0;
  std::string who;  ///< station | cyclictest
  double p50_us = 0, p99_us = 0, p999_us = 0, max_us = 0;
  long wakes = 0;
};

/// Runs a server and a recording station, then `cyclictest --laptop` (which leaves the processors free to
/// sleep, as the station does), in turns, pinned to one core; the load, the server, the recorder and a viewer
/// share the rest. Lateness of the station is the recording's own column, cut to whole µs as cyclictest's.
/// Throws UserError where cyclictest is missing, RunError where a program fails. `row` is called as they
/// come.
template <class OnRow>
std::vector<LoopBenchRow> run_loop_bench(const LoopBenchConfig& config, OnRow&& row);

LoopBenchRow run_station(const LoopBenchConfig& config, double rate_hz);
LoopBenchRow run_cyclictest(const LoopBenchConfig& config, double rate_hz);

template <class OnRow>
std::vector<LoopBenchRow> run_loop_bench(const LoopBenchConfig& config, OnRow&& row) {
  std::vector<LoopBenchRow> rows;
  for (const double rate_hz : config.rates_hz) {
    for (int pair = 1; pair <= config.pairs; ++pair) {
      for (const auto run : {&run_cyclictest, &run_station}) {
        rows.push_back(run(config, rate_hz));
        rows.back().rate_hz = rate_hz;
        rows.back().pair = pair;
        row(rows.back());
      }
    }
  }
  return rows;
}

/// Median over the pairs of station / cyclictest, for one rate and one of the fields.
double median_ratio(const std::vector<LoopBenchRow>& rows, double rate_hz, double LoopBenchRow::*field);

}  // namespace telenano::studies

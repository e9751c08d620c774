#include "tests/studies/loop_bench/loop_bench_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "tests/studies/loop_bench/loop_bench.h"

namespace telenano::studies {
namespace {

constexpr double kRatioMax = 1.2;

void run(const LoopBenchConfig& config) {
  std::printf("rate_hz,pair,who,p50_us,p99_us,p999_us,max_us,wakes\n");
  const auto rows = run_loop_bench(config, [&](const LoopBenchRow& row) {
    std::printf("%g,%d,%s,%g,%g,%g,%g,%ld\n", row.rate_hz, row.pair, row.who.c_str(), row.p50_us, row.p99_us,
                row.p999_us, row.max_us, row.wakes);
    std::fflush(stdout);
    std::fprintf(stderr, "bench loop: %g Hz, pair %d of %d, %s done\n", row.rate_hz, row.pair, config.pairs,
                 row.who.c_str());
  });
  for (const double rate_hz : config.rates_hz) {
    const double p50 = median_ratio(rows, rate_hz, &LoopBenchRow::p50_us);
    const double p99 = median_ratio(rows, rate_hz, &LoopBenchRow::p99_us);
    const double p999 = median_ratio(rows, rate_hz, &LoopBenchRow::p999_us);
    std::fprintf(
        stderr,
        "%g Hz: station / cyclictest --laptop, median of %d pairs: p50 %.2f, p99 %.2f, p99.9 %.2f (at most "
        "%.1f asked: %s)\n",
        rate_hz, config.pairs, p50, p99, p999, kRatioMax,
        p50 <= kRatioMax && p99 <= kRatioMax && p999 <= kRatioMax ? "holds" : "missed");
  }
}

}  // namespace

void add_loop_bench(CLI::App& bench) {
  CLI::App* command = bench.add_subcommand(
      "loop", "Wake-up latency of the station's loop, compared with cyclictest --laptop");
  const auto config = std::make_shared<LoopBenchConfig>();
  const auto no_load = std::make_shared<bool>(false);
  command->add_option("--rates", config->rates_hz, "Hz")
      ->delimiter(',')
      ->capture_default_str()
      ->check(CLI::Range(100.0, 8000.0));
  command->add_option("--seconds", config->seconds, "of each run")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 3600.0));
  command->add_option("--pairs", config->pairs, "runs of each, in turns")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  command->add_option("--rt-priority", config->priority, "SCHED_FIFO priority of both; 0 = ordinary")
      ->capture_default_str()
      ->check(CLI::Range(0, 99));
  command->add_flag("--no-load", *no_load, "No busy thread on another core");
  command->add_option("--station-flag", config->station_flags,
                      "Handed to telenano-master run, e.g. --view; may be given again");
  command->callback([config, no_load] {
    config->load = !*no_load;
    const auto programs = std::filesystem::read_symlink("/proc/self/exe").parent_path();
    config->nve = programs / "telenano-nve";
    config->master = programs / "telenano-master";
    run(*config);
  });
}

}  // namespace telenano::studies

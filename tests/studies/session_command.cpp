#include "tests/studies/session_command.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/config/completion.h"
#include "telenano/common/control/method.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies {
namespace {

struct Options {
  std::string scene;
  std::string task = "indent";
  std::string method = "model";
  station::StationConfig station{};
  device::TaskOptions task_options{};
  double delay_ms = 0;
  double jitter_ms = 0;
  double loss = 0;
  double burst = 1;
  std::uint64_t seed = 1;
};

void print_header() {
  bool first = true;
  for (const recording::Column& column : recording::sample_columns()) {
    for (int i = 0; i < column.components; ++i) {
      std::printf("%s%s%s", first ? "" : ",", column.name,
                  column.components > 1 ? (i == 0   ? "_x"
                                           : i == 1 ? "_y"
                                                    : "_z")
                                        : "");
      first = false;
    }
  }
  std::printf("\n");
}

void print_row(const recording::Sample& sample) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(&sample);
  bool first = true;
  for (const recording::Column& column : recording::sample_columns()) {
    for (int i = 0; i < column.components; ++i) {
      const unsigned char* at = bytes + column.offset + static_cast<std::size_t>(i) * column.element_bytes();
      if (!first) std::printf(",");
      first = false;
      switch (column.type) {
        case recording::ColumnType::kFloat64:
          std::printf("%.9g", *reinterpret_cast<const double*>(at));
          break;
        case recording::ColumnType::kInt64:
          std::printf("%lld", static_cast<long long>(*reinterpret_cast<const std::int64_t*>(at)));
          break;
        case recording::ColumnType::kUint32:
          std::printf("%u", *reinterpret_cast<const std::uint32_t*>(at));
          break;
      }
    }
  }
  std::printf("\n");
}

void require_finite(const Options& options) {
  // CLI11's ranges let "nan" through: no comparison fails with it.
  const std::pair<const char*, double> values[] = {{"--duration-s", options.task_options.duration_s},
                                                   {"--depth-nm", options.task_options.depth_nm},
                                                   {"--rtt-ms", options.delay_ms},
                                                   {"--jitter-ms", options.jitter_ms},
                                                   {"--loss", options.loss},
                                                   {"--burst", options.burst}};
  for (const auto& [flag, value] : values) {
    if (!std::isfinite(value))
      throw UserError(std::string("session: ") + flag + " is not a finite number; see --help for its range");
  }
}

int run(Options options) {
  require_finite(options);
  options.station.method = control::parse_method(options.method);
  options.station.allow_unsafe_scaling = true;
  options.station.validate("command line");
  support::VirtualSessionConfig config;
  config.scene = scene::load_scene(options.scene);
  config.station = options.station;
  config.task = device::parse_task(options.task);
  config.task_options = options.task_options;
  config.seed = options.seed;
  for (net::SimPath* path : {&config.to_server, &config.to_station}) {
    path->delay_ns = static_cast<std::int64_t>(options.delay_ms * 0.5e6);
    path->jitter_ns = static_cast<std::int64_t>(options.jitter_ms * 0.5e6);
    path->loss = options.loss;
    path->burst_datagrams = options.burst;
  }
  support::VirtualSession session(config);
  print_header();
  session.run(10'000'000, print_row);
  return 0;
}

}  // namespace

void add_session_command(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<Options>();
  CLI::App* const command = app.add_subcommand(
      "session",
      "Run a whole session in virtual time (device, hand, station, link, server); CSV with one row per tick");
  command
      ->add_option("--scene", options->scene,
                   "Scene: a file (TOML) or the name of a supplied scene, e.g. flakes")
      ->required()
      ->type_name(config::kSceneOrFile);
  command->add_option("--task", options->task, "Task of the simulated hand")
      ->capture_default_str()
      ->type_name("{position,contact,indent,scan}");
  command->add_option("--method", options->method, "Control method that keeps the session passive")
      ->capture_default_str()
      ->type_name("{none,ks,ks-clamp,tdpa,wave,tank,model}");
  command->add_option("--rate", options->station.rate_hz, "Rate of the station, Hz")
      ->capture_default_str()
      ->check(CLI::Range(100.0, 8000.0));
  command->add_option("--velocity-scale", options->station.scaling.velocity, "Velocity scale alpha_v")
      ->capture_default_str();
  command->add_option("--force-scale", options->station.scaling.force, "Force scale alpha_F")
      ->capture_default_str();
  command->add_option("--allowance-j", options->station.allowance_j, "Energy allowance E0, J")
      ->capture_default_str();
  command->add_option("--duration-s", options->task_options.duration_s, "Duration of the task")
      ->capture_default_str()
      ->check(CLI::Range(0.5, 3600.0));
  command->add_option("--depth-nm", options->task_options.depth_nm, "Intended depth of --task indent")
      ->capture_default_str();
  command->add_option("--rtt-ms", options->delay_ms, "Round-trip time of the link")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 5000.0));
  command
      ->add_option("--jitter-ms", options->jitter_ms,
                   "Random additional delay, uniform from 0 to this value, both directions together")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 5000.0));
  command->add_option("--loss", options->loss, "Probability of loss in each direction")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1.0));
  command->add_option("--burst", options->burst, "Mean length of a loss burst, datagrams")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 1e6));
  command->add_option("--seed", options->seed, "Random seed; the same seed gives the same bits")
      ->capture_default_str();
  command->callback([options, &exit_code] { exit_code = run(*options); });
}

}  // namespace telenano::studies

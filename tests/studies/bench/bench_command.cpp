#include "tests/studies/bench/bench_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/config/shared_files.h"
#include "tests/studies/bench/codec_bench.h"
#include "tests/studies/bench/memory_bench.h"
#include "tests/studies/bench/net_bench.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {
namespace {

struct Processors {
  int server = 0;
  int client = 1;
  void add_flags(CLI::App& c) {
    c.add_option("--server-cpu", server, "Processor of the server's thread")->capture_default_str();
    c.add_option("--client-cpu", client, "Processor of the stations")->capture_default_str();
  }
  void check() const {
    const auto n = static_cast<int>(std::thread::hardware_concurrency());
    for (const int cpu : {server, client}) {
      if (cpu < 0 || cpu >= n)
        throw UserError(fmt::format("--server-cpu, --client-cpu: this machine has processors 0 to {}, not {}",
                                    n - 1, cpu));
    }
    if (server == client) {
      throw UserError(
          "--server-cpu and --client-cpu: are the same; the stations would take the server's time (bench net "
          "measures one core by itself)");
    }
  }
};

std::string scenes_folder() {
  return (config::shared_folder() / "scenes" / "").string();
}
std::string flat_table() {
  return scenes_folder() + "flat_table.toml";
}

std::string nve_beside_this() {
  std::error_code ignored;
  return (std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path() / "telenano-nve").string();
}

void add_net(CLI::App& bench) {
  struct All {
    NetBenchOptions o;
    Processors cpus;
  };
  auto all = std::make_shared<All>();
  all->o.scene = flat_table();
  CLI::App* const c = bench.add_subcommand("net",
                                           "Round trip of an exchange, compared with a UDP ping-pong of the "
                                           "same size: polling, blocking on one core, blocking across cores");
  c->add_option("--scene", all->o.scene, "Scene file")->capture_default_str();
  c->add_option("--rounds", all->o.rounds, "Of product and floor in turn")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  c->add_option("--exchanges", all->o.exchanges, "A round")
      ->capture_default_str()
      ->check(CLI::Range(100, 1000000));
  c->add_flag("--low-latency", all->o.low_latency,
              "Keep the processors awake meanwhile (/dev/cpu_dma_latency = 0)");
  all->cpus.add_flags(*c);
  c->callback([all] {
    all->cpus.check();
    all->o.server_cpu = all->cpus.server;
    all->o.client_cpu = all->cpus.client;
    print_rows("net", run_net_bench(all->o));
  });
}

void add_codec(CLI::App& bench) {
  auto rounds = std::make_shared<int>(25);
  CLI::App* const c = bench.add_subcommand(
      "codec", "Encoding and decoding of command and reply, compared with copying the structs");
  c->add_option("--rounds", *rounds, "Of product and floor in turn")
      ->capture_default_str()
      ->check(CLI::Range(1, 10000));
  c->callback([rounds] { print_rows("codec", run_codec_bench(*rounds)); });
}

std::vector<BenchRow> rows_of(const std::string& what, const PacedResult& r) {
  const auto seconds = static_cast<double>(r.seconds_that_hold) / static_cast<double>(r.seconds);
  return {{what, "service_p50_us", r.p50_us, {}, {}, false},
          {what, "service_p99_us", r.p99_us, {}, kServiceTargetUs, false},
          {what, "service_p999_us", r.p999_us, {}, {}, false},
          {what, "service_max_us", r.max_us, {}, {}, false},
          {what, "median_second_p99_us", r.median_second_p99_us, {}, {}, false},
          {what, "seconds_with_p99_in_target_part", seconds, {}, {}, true},
          {what, "answered_part", r.answered_part(), {}, 0.999, true},
          {what, "sent_part", r.sent_part(), {}, 0.99, true},
          {what, "since_due_p99_us", r.since_due_p99_us, {}, {}, false},
          {what, "sent_late_p99_us", r.late_p99_us, {}, {}, false},
          {what, "server_core_share", r.server_share, {}, {}, false}};
}

/// What the machine gives to a bare echo.
std::vector<BenchRow> floor_rows(const std::string& what, const PacedResult& r) {
  std::vector<BenchRow> rows = rows_of(what, r);
  for (BenchRow& row : rows) {
    row.quantity = "echo_" + row.quantity;
    row.target.reset();
  }
  return rows;
}

/// The largest number of sessions that holds: doubling, then halving the gap to 5 %.
std::vector<BenchRow> find_max(PacedOptions o) {
  std::size_t good = 0, bad = 0;
  PacedResult best;
  const auto holds = [&](std::size_t sessions) {
    o.sessions = sessions;
    const PacedResult r = run_paced(o);
    fmt::print(
        stderr,
        "telenano-lab: {} sessions: p99 {:.0f} us, answered {:.5f}, server {:.0f} %, sent {:.0f}/s{}\n",
        sessions, r.p99_us, r.answered_part(), 100 * r.server_share, r.sent_rate_hz,
        r.keeps_time() ? "" : ", the stations themselves are late");
    if (r.holds()) best = r;
    return r.holds();
  };
  for (std::size_t n = 50; n <= 4096 && bad == 0; n *= 2) {
    if (holds(n)) {
      good = n;
    } else {
      bad = n;
    }
  }
  while (bad > good + std::max<std::size_t>(good / 20, 1)) {
    const std::size_t middle = (good + bad) / 2;
    (holds(middle) ? good : bad) = middle;
  }
  std::vector<BenchRow> rows = rows_of("largest", best);
  rows.insert(rows.begin(), {"largest", "sessions", static_cast<double>(good), {}, 200.0, true});
  return rows;
}

void add_server(CLI::App& bench) {
  struct All {
    ServerBenchOptions capacity;
    PacedOptions paced;
    Processors cpus;
    std::size_t sessions = 0;
    bool find_max = false;
  };
  auto all = std::make_shared<All>();
  all->capacity.flat = all->paced.scene = flat_table();
  all->capacity.scan = scenes_folder() + "flakes.toml";
  CLI::App* const c = bench.add_subcommand(
      "server",
      "Exchanges per second of one core, compared with an echo of the same size; --sessions: test whether so "
      "many sessions run at --rate; --find-max: find the largest number");
  c->add_option("--flat", all->capacity.flat, "Scene file of the flat sample")->capture_default_str();
  c->add_option("--scan", all->capacity.scan, "Scene file of the scan")->capture_default_str();
  c->add_option("--rounds", all->capacity.rounds, "Of product and floor in turn")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  c->add_option("--round-s", all->capacity.round_s, "Seconds a round")
      ->capture_default_str()
      ->check(CLI::Range(0.01, 60.0));
  c->add_option("--case", all->capacity.only, "Only this one")
      ->check(CLI::IsMember({"flat", "flat_model", "scan", "scan_model", "reply_gate"}));
  CLI::Option* const sessions =
      c->add_option("--sessions", all->sessions, "Stations at --rate instead, for --seconds")
          ->check(CLI::Range(1, 4096));
  c->add_flag("--find-max", all->find_max,
              "Largest number of stations at --rate that holds, --seconds each try")
      ->excludes(sessions);
  c->add_option("--rate", all->paced.rate_hz, "Commands per second of each station")
      ->capture_default_str()
      ->check(CLI::Range(100, 8000));
  c->add_option("--together", all->paced.together, "So many stations share a socket and send at once")
      ->capture_default_str()
      ->check(CLI::Range(1, 64));
  c->add_option("--server-priority", all->paced.server_priority,
                "SCHED_FIFO priority of the server, as serve --rt-priority, for --sessions and --find-max")
      ->capture_default_str()
      ->check(CLI::Range(0, 99));
  c->add_option("--seconds", all->paced.seconds, "How long")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0));
  c->add_option("--scene", all->paced.scene, "Scene file for --sessions and --find-max")
      ->capture_default_str();
  all->cpus.add_flags(*c);
  c->callback([all] {
    all->cpus.check();
    // CLI11's ranges let "nan" through: no comparison fails with it.
    if (!std::isfinite(all->paced.seconds) || !std::isfinite(all->capacity.round_s))
      throw UserError("--seconds, --round-s: expected a number, not nan");
    all->capacity.server_cpu = all->paced.server_cpu = all->cpus.server;
    all->capacity.client_cpu = all->paced.client_cpu = all->cpus.client;
    if (all->find_max) {
      print_rows("server", find_max(all->paced));
    } else if (all->sessions > 0) {
      all->paced.sessions = all->sessions;
      const PacedResult r = run_paced(all->paced);
      if (!r.keeps_time()) {
        fmt::print(
            stderr,
            "telenano-lab: the stations themselves sent {:.0f} us late (p99) and left out {:.2f} %: this "
            "machine is busy, or their core is the limit\n",
            r.late_p99_us, 100 * (1 - r.sent_part()));
      }
      const std::string what = fmt::format("{}_sessions", all->sessions);
      std::vector<BenchRow> rows = rows_of(what, r);
      for (BenchRow& row : floor_rows(what, run_paced_echo(all->paced))) rows.push_back(std::move(row));
      print_rows("server", rows);
    } else {
      std::vector<BenchRow> rows = run_capacity_bench(all->capacity);
      for (BenchRow& row : run_gate_bench(all->capacity)) rows.push_back(std::move(row));
      print_rows("server", rows);
    }
  });
}

void add_memory(CLI::App& bench) {
  auto o = std::make_shared<MemoryBenchOptions>();
  o->program = nve_beside_this();
  o->flat = flat_table();
  o->scan = scenes_folder() + "flakes.toml";
  CLI::App* const c =
      bench.add_subcommand("memory", "Memory of the server per session, unencrypted and encrypted");
  c->add_option("--program", o->program, "telenano-nve")->capture_default_str();
  c->add_option("--flat", o->flat, "Scene file of the flat sample")->capture_default_str();
  c->add_option("--scan", o->scan, "Scene file of the scan")->capture_default_str();
  c->add_option("--from", o->from, "Sessions at the first look")
      ->capture_default_str()
      ->check(CLI::Range(1, 2000));
  c->add_option("--to", o->to, "Sessions at the second")->capture_default_str()->check(CLI::Range(2, 4096));
  c->callback([o] {
    if (o->to <= o->from) throw UserError("--to: more than --from, please");
    print_rows("memory", run_memory_bench(*o));
  });
}

}  // namespace

void add_throughput_benches(CLI::App& bench) {
  add_net(bench);
  add_codec(bench);
  add_server(bench);
  add_memory(bench);
}

}  // namespace telenano::studies

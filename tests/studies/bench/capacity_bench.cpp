#include <fmt/format.h>

#include <cstdio>
#include <memory>

#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/studies/bench/closed_loop.h"
#include "tests/studies/bench/served.h"
#include "tests/studies/bench/server_bench.h"

namespace telenano::studies {
namespace {

struct EchoServer {
  EchoServer(std::size_t reply_bytes, std::int64_t work_ns, int cpu) {
    socket.blocking(false);
    thread = std::make_unique<PinnedThread>(cpu, [this, reply_bytes, work_ns](const std::atomic<bool>& stop) {
      echo_batched(socket, reply_bytes, work_ns, stop, answered);
    });
  }
  net::Address address() const {
    return net::parse_address("127.0.0.1:" + std::to_string(socket.port()), "bench");
  }
  RawUdp socket;
  std::atomic<std::uint64_t> answered{0};
  std::unique_ptr<PinnedThread> thread;
};

/// Mean time of the scene's step over the motion of the stations.
double step_ns(const std::shared_ptr<const scene::Scene>& scene, bool model, int cpu) {
  const PinnedHere pinned(cpu);
  slave::NveSlave slave(scene);
  link::Welcome welcome;
  welcome.start_pos_w_nm = slave.limits().start_pos_w_nm;
  welcome.surface_z_w_nm = slave.limits().surface_z_w_nm;
  const Motion motion = Motion::of(welcome, model);
  slave::SlaveInput input;
  slave::SlaveOutput output;
  input.wants_model = model;
  link::Command command;
  constexpr int kSteps = 8000;  // two rounds of the motion
  std::int64_t begin_ns = 0;
  for (int i = 0; i < 2 * kSteps; ++i) {
    if (i == kSteps) begin_ns = clock_ns(CLOCK_THREAD_CPUTIME_ID);
    motion.fill(command, i);
    input.tip_target_pos_w_nm = command.tip_pos_w_nm;
    input.tip_target_vel_w_nm_s = command.tip_vel_w_nm_s;
    slave.step(input, 1e-3, output);
  }
  return static_cast<double>(clock_ns(CLOCK_THREAD_CPUTIME_ID) - begin_ns) / kSteps;
}

/// Exchanges for a second of the server's time on its processor, and how much of it was used.
struct Capacity {
  std::vector<double> per_cpu_s;
  std::vector<double> share;
  void measure(ClosedLoop& load, const auto& cpu_ns, double seconds) {
    const std::int64_t cpu_before = cpu_ns(), before = clock_ns(CLOCK_MONOTONIC);
    const std::uint64_t n = load.run(static_cast<std::int64_t>(1e9 * seconds));
    const auto cpu = static_cast<double>(cpu_ns() - cpu_before);
    const auto wall = static_cast<double>(clock_ns(CLOCK_MONOTONIC) - before);
    per_cpu_s.push_back(1e9 * static_cast<double>(n) / cpu);
    share.push_back(cpu / wall);
  }
};

}  // namespace

std::vector<BenchRow> run_capacity_bench(const ServerBenchOptions& o) {
  struct Case {
    const char* name;
    std::string scene;
    bool model;
    bool with_work;  ///< the floor spins for the scene's step
  };
  const std::vector<Case> cases = {{"flat", o.flat, false, false},
                                   {"flat_model", o.flat, true, false},
                                   {"scan", o.scan, false, true},
                                   {"scan_model", o.scan, true, true}};
  const std::size_t sessions = o.sockets * o.sessions_each;
  std::vector<BenchRow> rows;
  for (const Case& c : cases) {
    if (!o.only.empty() && o.only != c.name) continue;
    const auto scene = scene::load_scene(c.scene);
    const double work_ns = c.with_work ? step_ns(scene, c.model, o.server_cpu) : 0;
    Served served(scene, o.server_cpu, false, sessions);
    const PinnedHere pinned(o.client_cpu);
    ClosedLoop stations(served.address(), o.sockets, o.sessions_each, c.model, false);
    stations.run(100'000'000);
    EchoServer echo(stations.reply_bytes(), static_cast<std::int64_t>(work_ns), o.server_cpu);
    ClosedLoop pings(echo.address(), o.sockets, o.sessions_each, c.model, true);
    pings.run(100'000'000);
    Capacity product, floor;
    for (int round = 0; round < o.rounds; ++round) {
      floor.measure(
          pings, [&] { return echo.thread->cpu_ns(); }, o.round_s);
      product.measure(
          stations, [&] { return served.cpu_ns(); }, o.round_s);
    }
    fmt::print(
        stderr,
        "telenano-lab: server {}: {} sessions, {} B there, {} B back{}; processor used {:.0f} % (floor "
        "{:.0f} %), lost {}\n",
        c.name, sessions, stations.command_bytes(), stations.reply_bytes(),
        c.with_work ? fmt::format(", step {:.0f} ns", work_ns) : "", 100 * median(product.share),
        100 * median(floor.share), stations.lost());
    rows.push_back(
        {c.name, "exchanges_per_core_s", median(product.per_cpu_s), median(floor.per_cpu_s), 0.8, true});
  }
  return rows;
}

}  // namespace telenano::studies

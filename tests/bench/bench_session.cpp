// What one tick costs: the station's step, the server's exchange without its socket, and the whole loop in
// virtual time. Floors: 5 us for each of the first two, 300 000 ticks/s a core for the third.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/master/twin/scene_twin.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/virtual_session.h"

namespace telenano {
namespace {

std::shared_ptr<const scene::Scene> scene_of(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

void whole_session(benchmark::State& state, const std::string& scene_name, device::Task task) {
  support::VirtualSessionConfig config;
  config.scene = scene_of(scene_name);
  config.task = task;
  config.task_options.duration_s = 1e6 * 1e-3;  // long: the benchmark decides when it ends
  auto session = std::make_unique<support::VirtualSession>(config);
  for (auto _ : state) {
    benchmark::DoNotOptimize(session->step());
    if (session->done()) {
      state.PauseTiming();
      session = std::make_unique<support::VirtualSession>(config);
      state.ResumeTiming();
    }
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK_CAPTURE(whole_session, flat_indent, "flat_silicon_oxide", device::Task::kIndent);
BENCHMARK_CAPTURE(whole_session, scan_in_contact, "flakes", device::Task::kScan);

void station_step(benchmark::State& state) {
  device::DeviceInfo device;
  device.force_max_n = 12;
  device.position_quantum_m = 1e-5;
  device.damping_n_s_m = 2;
  device.workspace_radius_m = 0.08;
  station::Station station(station::StationConfig{}, device, station::SlavePort{13.3, 0, 500});
  link::Welcome welcome;
  welcome.workspace_min_w_nm = Vec3(0, 0, -50);
  welcome.workspace_max_w_nm = Vec3(600, 600, 200);
  welcome.start_pos_w_nm = Vec3(300, 300, 20);
  station.begin_session(welcome);
  station::StationInput input;
  station::StationOutput output;
  link::Reply reply;
  input.session_up = true;
  input.buttons = device::kButtonDeadman;
  for (auto _ : state) {
    input.time_ns += 1'000'000;
    reply.sequence += 1;
    reply.force_w_nn = Vec3(0.1, -0.2, static_cast<double>(reply.sequence % 100));
    input.reply = &reply;
    input.hand_pos_h_m.z() = 1e-5 * static_cast<double>(reply.sequence % 50);
    input.applied_force_h_n = output.hand_force_h_n;
    station.step(input, 1e-3, output);
    benchmark::DoNotOptimize(output);
  }
}
BENCHMARK(station_step);

// Encoded command in, encoded reply out: scan, decode, look up, step the slave, encode. The tip goes up and
// down between two heights above where it touches, and 50 nm to the side and back, 25 nm/s at 1 kHz. Pausing
// the clock costs some hundred nanoseconds, which are in the figure.
void server_exchange(benchmark::State& state, const std::string& scene_name, double high_nm, double low_nm) {
  const auto scene = scene_of(scene_name);
  server::ServerConfig config;
  config.secret = link::SipKey{1, 2};
  server::ServedScene served;
  served.name = server::scene_name(scene->name);
  served.hash = scene->hash;
  served.make_slave = [scene] { return std::make_unique<slave::NveSlave>(scene); };
  server::Server server(config, served);
  link::ClientSession client(link::ClientConfig{});
  net::Address station;
  station.port = 4000;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out, in;
  std::int64_t now_ns = 1'000'000;
  client.start(now_ns);
  for (int i = 0; i < 10 && client.state() != link::ClientState::kEstablished; ++i) {
    const std::size_t n = client.poll(now_ns, out);
    const std::size_t m = server.on_datagram(std::span(out).first(n), station, now_ns, in);
    if (m > 0) client.on_datagram(std::span(in).first(m), now_ns);
    now_ns += 200'000'000;
  }
  if (client.state() != link::ClientState::kEstablished) {
    state.SkipWithError("no session");
    return;
  }
  link::Command command;
  Vec3 start = client.welcome().start_pos_w_nm;
  start.z() = client.welcome().surface_z_w_nm;
  std::int64_t k = 0;
  for (auto _ : state) {
    state.PauseTiming();
    const double phase = static_cast<double>(k % 4000) / 2000;  // 0 … 2
    const double up = phase < 1 ? phase : 2 - phase;
    command.flags = link::kFlagClutch | link::kFlagDeadman;
    command.tip_pos_w_nm = start + Vec3(50 * up, 20 * up, high_nm + (low_nm - high_nm) * up);
    const std::size_t n = client.make_command(command, now_ns, out);
    state.ResumeTiming();
    const std::size_t m = server.on_datagram(std::span(out).first(n), station, now_ns, in);
    benchmark::DoNotOptimize(m);
    state.PauseTiming();
    if (m == 0) state.SkipWithError("no reply");
    client.on_datagram(std::span(in).first(m), now_ns + 1000);
    ++k;
    now_ns += 1'000'000;
    state.ResumeTiming();
  }
}
BENCHMARK_CAPTURE(server_exchange, flat, "flat_silicon_oxide", 20, -6)->Iterations(20000);
BENCHMARK_CAPTURE(server_exchange, flat_pressed, "flat_silicon_oxide", -2, -6)->Iterations(20000);
BENCHMARK_CAPTURE(server_exchange, scan, "flakes", 20, -6)->Iterations(20000);
BENCHMARK_CAPTURE(server_exchange, scan_pressed, "flakes", -2, -6)->Iterations(20000);

// What a twin adds to a station's tick: the scene's own step, the hash of the state after it and its account.
// Down, along at the speed given, up. p99_us: of single ticks, of this thread's processor time, the clock's own
// 0.2 us left out: who else uses the machine does not make a tick dearer. Asked: 10 us, ploughing 100 us at 1 kHz.
double processor_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

void twin_tick(benchmark::State& state, const std::string& scene_name, double rate_hz, double deep_nm,
               double speed_nm_s) {
  const auto scene = scene_of(scene_name);
  station::TwinRunConfig config;
  config.rate_hz = rate_hz;
  station::TwinRun twin(config, std::make_unique<twin::SceneTwin>(scene),
                        std::make_unique<twin::SceneTwin>(scene));
  link::StepReport report;
  report.state_hash = twin::SceneTwin(scene).state_hash();
  twin.begin(report, true, 0.5, 0);
  const Vec3 start = scene->start_apex_w_nm;
  const double down_nm = start.z() - scene->start_touch_w_nm + deep_nm;
  const double tick_nm = speed_nm_s / rate_hz;
  const double along_nm = 100;
  const auto steps_down = std::ceil(down_nm / tick_nm), steps_along = std::ceil(along_nm / tick_nm);
  const double cycle = 2 * (steps_down + steps_along);
  std::vector<double> us;
  us.reserve(1 << 20);
  std::uint64_t number = 0;
  double touching = 0;
  double clock_us = 1e9;
  for (int i = 0; i < 1000; ++i) {
    const double begin_us = processor_us();
    clock_us = std::min(clock_us, processor_us() - begin_us);
  }
  for (auto _ : state) {
    const double k = std::fmod(static_cast<double>(number), cycle);
    const double back = cycle - k;
    const double down = std::clamp(std::min(k, back) / steps_down, 0.0, 1.0);
    const double along = std::clamp((std::min(k, back) - steps_down) / steps_along, 0.0, 1.0);
    const link::LoggedStep step = link::logged_step(start + Vec3(along_nm * along, 0, -down_nm * down),
                                                    link::kFlagClutch | link::kFlagDeadman, 1 / rate_hz);
    ++number;
    const double begin_us = processor_us();
    twin.step(number, step, static_cast<std::int64_t>(1e9 * static_cast<double>(number) / rate_hz));
    const double took_us = processor_us() - begin_us - clock_us;
    if (us.size() < us.capacity()) us.push_back(took_us);
    touching += twin.answer().contact_state == static_cast<std::uint32_t>(link::ContactState::kContact);
    benchmark::DoNotOptimize(twin.answer());
  }
  std::sort(us.begin(), us.end());
  state.counters["most_us"] = us.back();
  state.counters["p50_us"] = us[us.size() / 2];
  state.counters["p99_us"] = us[static_cast<std::size_t>(0.99 * static_cast<double>(us.size() - 1))];
  state.counters["touching"] = touching / static_cast<double>(number);
}
BENCHMARK_CAPTURE(twin_tick, flat_1khz, "flat_silicon_oxide", 1000, 2, 200)->Iterations(20000);
BENCHMARK_CAPTURE(twin_tick, scan_1khz, "flakes", 1000, 2, 200)->Iterations(20000);
BENCHMARK_CAPTURE(twin_tick, scan_4khz, "flakes", 4000, 2, 200)->Iterations(40000);
BENCHMARK_CAPTURE(twin_tick, scan_8khz, "flakes", 8000, 2, 200)->Iterations(80000);
BENCHMARK_CAPTURE(twin_tick, moist_1khz, "humid_flakes", 1000, 2, 200)->Iterations(20000);
BENCHMARK_CAPTURE(twin_tick, particle_1khz, "particle", 1000, 2, 200)->Iterations(20000);
BENCHMARK_CAPTURE(twin_tick, ploughing_1khz, "lithography", 1000, 10, 100)->Iterations(20000);

}  // namespace
}  // namespace telenano

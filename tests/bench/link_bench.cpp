// What an exchange costs without its socket, next to the floor: copying packed structs.
#include <benchmark/benchmark.h>

#include <array>
#include <cstring>

#include "common/link/codec.h"
#include "common/link/wire_scan.h"
#include "common/net/sim_link.h"
#include "nve_server/server/server.h"
#include "tests/unit/link/golden_messages.h"
#include "tests/unit/server/virtual_session.h"

namespace telenano {
namespace {

using Buffer = std::array<std::uint8_t, link::kMaxDatagramBytes>;

void floor_copy_command_and_reply(benchmark::State& state) {
  link::GoldenMessages m;
  Buffer buffer{};
  link::Command c;
  link::Reply r;
  for (auto _ : state) {
    std::memcpy(buffer.data(), &m.command, sizeof m.command);
    benchmark::DoNotOptimize(buffer);
    std::memcpy(static_cast<void*>(&c), buffer.data(), sizeof c);
    benchmark::DoNotOptimize(c);
    std::memcpy(buffer.data(), &m.reply, sizeof m.reply);
    benchmark::DoNotOptimize(buffer);
    std::memcpy(static_cast<void*>(&r), buffer.data(), sizeof r);
    benchmark::DoNotOptimize(r);
  }
}
BENCHMARK(floor_copy_command_and_reply);

void codec_command(benchmark::State& state) {
  link::Codec codec;
  link::Incoming in;
  Buffer buffer{};
  auto m = link::GoldenMessages{}.command;
  for (auto _ : state) {
    benchmark::DoNotOptimize(m);
    const std::size_t n = codec.encode(m, buffer);
    benchmark::DoNotOptimize(codec.decode({buffer.data(), n}, in));
    benchmark::DoNotOptimize(in);
  }
}
BENCHMARK(codec_command);

void codec_reply(benchmark::State& state) {
  link::Codec codec;
  link::Incoming in;
  Buffer buffer{};
  auto m = link::GoldenMessages{}.reply;
  for (auto _ : state) {
    benchmark::DoNotOptimize(m);
    const std::size_t n = codec.encode(m, buffer);
    benchmark::DoNotOptimize(codec.decode({buffer.data(), n}, in));
    benchmark::DoNotOptimize(in);
  }
}
BENCHMARK(codec_reply);

void wire_scan_reply(benchmark::State& state) {
  const auto bytes = link::GoldenMessages{}.encoded()[5];
  link::WireFrame frame;
  for (auto _ : state) {
    benchmark::DoNotOptimize(bytes.data());
    benchmark::DoNotOptimize(link::scan(bytes, frame));
  }
}
BENCHMARK(wire_scan_reply);

void server_exchange(benchmark::State& state) {
  server::Server server(server::test_config(), server::spring_scene());
  server::VirtualSession s(&server, {}, {}, {}, 1);
  s.client.start(0);
  s.ticks(10);
  Buffer in{};
  Buffer out{};
  link::Codec codec;
  link::Command c = s.command;
  c.session_id = s.client.welcome().session_id;
  c.epoch = s.client.welcome().epoch;
  c.sequence = 1000;
  for (auto _ : state) {
    // The command's making is not the server's; it is measured apart as half of codec_command, and is
    // included here.
    ++c.sequence;
    c.send_time_ns += 1'000'000;
    const std::size_t n = codec.encode(c, in);
    benchmark::DoNotOptimize(server.on_datagram({in.data(), n}, s.link.address_a(), s.now_ns, out));
  }
  if (server.drops().total() != 0) state.SkipWithError("dropped");
}
BENCHMARK(server_exchange);

void whole_tick_over_sim_link(benchmark::State& state) {
  server::Server server(server::test_config(), server::spring_scene());
  net::SimPath path;
  path.delay_ns = 2'500'000;
  server::VirtualSession s(&server, {}, path, path, 1);
  s.client.start(0);
  s.ticks(100);
  for (auto _ : state) s.tick();
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()));
}
BENCHMARK(whole_tick_over_sim_link);

void sim_link_datagram(benchmark::State& state) {
  net::SimPath path;
  path.delay_ns = 20'000'000;  // 20 on the way at 1 kHz
  if (state.range(0) == 1) {
    path.jitter_ns = 5'000'000;
    path.in_order = false;
    path.loss = 0.01;
    path.duplicate = 0.01;
    path.reorder = 0.01;
  }
  net::SimLink link(path, path, 1);
  const auto bytes = link::GoldenMessages{}.encoded()[5];
  Buffer buffer{};
  net::Received received;
  std::int64_t now_ns = 0;
  for (auto _ : state) {
    link.advance_to(now_ns += 1'000'000);
    link.a().send(bytes, {});
    while (link.b().receive(buffer, received)) benchmark::DoNotOptimize(buffer);
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(link.counts_a_to_b().delivered));
}
BENCHMARK(sim_link_datagram)->Arg(0)->Arg(1);

}  // namespace
}  // namespace telenano

BENCHMARK_MAIN();

// What an exchange costs without its socket, next to the floor: copying packed structs.
#include <benchmark/benchmark.h>

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstring>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/wire_scan.h"
#include "telenano/common/net/sim_link.h"
#include "telenano/common/net/udp.h"
#include "telenano/nve_server/server/server.h"
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

void codec_command_with_features(benchmark::State& state) {
  link::Codec codec;
  link::Incoming in;
  Buffer buffer{};
  auto m = link::GoldenMessages{}.command_with_features;
  for (auto _ : state) {
    benchmark::DoNotOptimize(m);
    const std::size_t n = codec.encode(m, buffer);
    benchmark::DoNotOptimize(codec.decode({buffer.data(), n}, in));
    benchmark::DoNotOptimize(in);
  }
}
BENCHMARK(codec_command_with_features);

void codec_command_with_recent(benchmark::State& state) {
  link::Codec codec;
  link::Incoming in;
  Buffer buffer{};
  auto m = link::GoldenMessages{}.command_with_features;
  auto recent = link::GoldenMessages{}.recent;
  for (auto _ : state) {
    benchmark::DoNotOptimize(m);
    benchmark::DoNotOptimize(recent);
    const std::size_t n = codec.encode(m, recent, buffer);
    benchmark::DoNotOptimize(codec.decode({buffer.data(), n}, in));
    benchmark::DoNotOptimize(in);
  }
}
BENCHMARK(codec_command_with_recent);

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

void codec_reply_with_features(benchmark::State& state) {
  link::Codec codec;
  link::Incoming in;
  Buffer buffer{};
  auto m = link::GoldenMessages{}.reply_with_features;
  for (auto _ : state) {
    benchmark::DoNotOptimize(m);
    const std::size_t n = codec.encode(m, buffer);
    benchmark::DoNotOptimize(codec.decode({buffer.data(), n}, in));
    benchmark::DoNotOptimize(in);
  }
}
BENCHMARK(codec_reply_with_features);

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

// Over loopback UDP, both ends on one thread: four system calls an exchange and no wake-ups, so that what the
// product adds to the floor is not lost in the scheduler's noise. The floor moves the same bytes by plain
// calls.
struct LoopbackPair {
  net::Udp server = net::Udp::listen(net::parse_address("127.0.0.1:0", "bench"));
  net::Udp client = net::Udp::open_for(server.local());
  net::Address at = server.local();
};

void floor_udp_one_thread(benchmark::State& state) {
  const int server = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0);
  const int client = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof at;
  if (bind(server, reinterpret_cast<sockaddr*>(&at), sizeof at) != 0) state.SkipWithError("bind");
  getsockname(server, reinterpret_cast<sockaddr*>(&at), &length);
  const auto golden = link::GoldenMessages{}.encoded();
  const auto& command = golden[4];
  const auto& reply = golden[5];
  Buffer buffer{};
  for (auto _ : state) {
    sockaddr_in from{};
    socklen_t n = sizeof from;
    sendto(client, command.data(), command.size(), 0, reinterpret_cast<sockaddr*>(&at), sizeof at);
    benchmark::DoNotOptimize(
        recvfrom(server, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &n));
    sendto(server, reply.data(), reply.size(), 0, reinterpret_cast<sockaddr*>(&from), n);
    benchmark::DoNotOptimize(
        recvfrom(client, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &n));
  }
  close(server);
  close(client);
}
BENCHMARK(floor_udp_one_thread);

void exchange_udp_one_thread(benchmark::State& state) {
  LoopbackPair pair;
  server::Server server(server::test_config(), server::spring_scene());
  link::ClientSession client({});
  client.start(0);
  Buffer buffer{};
  Buffer out{};
  net::Received received;
  std::int64_t now_ns = 0;
  std::uint64_t replies = 0;
  const auto exchange = [&] {
    now_ns += 1'000'000;
    if (const std::size_t n = client.poll(now_ns, buffer)) pair.client.send({buffer.data(), n}, pair.at);
    link::Command c = server::VirtualSession::engaged();
    if (const std::size_t n = client.make_command(c, now_ns, buffer))
      pair.client.send({buffer.data(), n}, pair.at);
    if (pair.server.receive(buffer, received)) {
      const std::size_t n = server.on_datagram({buffer.data(), received.size}, received.from, now_ns, out);
      if (n > 0) pair.server.send({out.data(), n}, received.from);
    }
    if (pair.client.receive(buffer, received)) {
      replies +=
          client.on_datagram({buffer.data(), received.size}, now_ns) == link::ClientEvent::kReply ? 1 : 0;
    }
  };
  for (int i = 0; i < 10; ++i) exchange();
  const std::uint64_t before = replies;
  for (auto _ : state) exchange();
  if (replies - before != static_cast<std::uint64_t>(state.iterations()))
    state.SkipWithError("an exchange was lost");
}
BENCHMARK(exchange_udp_one_thread);

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

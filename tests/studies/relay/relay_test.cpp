// The relay over real sockets on loopback, in virtual time: what is due is decided by the test's clock.
#include "tests/studies/relay/relay.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "tests/studies/relay/relay_options.h"
#include "tests/studies/relay/trace_file.h"
#include "tests/support/alloc_guard.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kMs = 1'000'000;
using Bytes = std::vector<std::uint8_t>;

net::Address loopback() {
  return net::parse_address("127.0.0.1:0", "test");
}

/// A server, a relay to it, and clients.
struct Bench {
  explicit Bench(RelayConfig config = {}) : server(net::Udp::listen(loopback())) {
    config.listen = loopback();
    config.to = server.local();
    config.capacity = 256;
    relay.emplace(config, clock);
  }
  net::Udp client() const { return net::Udp::open_for(relay->local()); }
  /// On loopback a datagram is there as soon as send() has returned.
  void at_ms(std::int64_t now_ms) {
    clock.advance_to(now_ms * kMs);
    relay->step(0);
  }
  void send(net::Udp& from, const Bytes& bytes) const {
    EXPECT_EQ(from.send(bytes, relay->local()), net::SendStatus::kSent);
  }
  static std::vector<Bytes> all(net::Udp& at, net::Address* from = nullptr) {
    std::vector<Bytes> got;
    Bytes buffer(4096);
    net::Received received;
    while (at.receive(buffer, received)) {
      got.emplace_back(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(received.size));
      if (from != nullptr) *from = received.from;
    }
    return got;
  }

  rt::VirtualClock clock;
  net::Udp server;
  std::optional<Relay> relay;
};

TEST(Relay, CarriesBothWaysAndKeepsClientsApart) {
  Bench bench;
  net::Udp a = bench.client();
  net::Udp b = bench.client();
  bench.send(a, {1, 2, 3});
  bench.at_ms(1);
  net::Address seen_a, seen_b;
  EXPECT_EQ(Bench::all(bench.server, &seen_a), (std::vector<Bytes>{{1, 2, 3}}));
  bench.send(b, {4});
  bench.at_ms(2);
  EXPECT_EQ(Bench::all(bench.server, &seen_b), (std::vector<Bytes>{{4}}));
  EXPECT_NE(seen_a.port, seen_b.port);
  bench.server.send(Bytes{5, 6}, seen_a);
  bench.server.send(Bytes{7}, seen_b);
  bench.at_ms(3);
  net::Address from;
  EXPECT_EQ(Bench::all(a, &from), (std::vector<Bytes>{{5, 6}}));
  EXPECT_EQ(from, bench.relay->local());
  EXPECT_EQ(Bench::all(b), (std::vector<Bytes>{{7}}));
  // A stranger on the server's side is not let through, as by a NAT.
  net::Udp stranger = net::Udp::listen(loopback());
  seen_a.ip = bench.server.local().ip;
  stranger.send(Bytes{8}, seen_a);
  bench.at_ms(4);
  EXPECT_TRUE(Bench::all(a).empty());
  EXPECT_EQ(bench.relay->clients().seen, 2u);
  EXPECT_EQ(bench.relay->to_server().impairment.counts.delivered, 2u);
  EXPECT_EQ(bench.relay->to_client().impairment.counts.delivered, 2u);
}

TEST(Relay, EachDirectionHasItsOwnDelay) {
  RelayConfig config;
  config.to_server.delay_ns = 20 * kMs;
  config.to_client.delay_ns = 50 * kMs;
  Bench bench(config);
  net::Udp a = bench.client();
  bench.at_ms(1000);
  bench.send(a, {1});
  // Taken at 1000 ms less its age in the kernel, which is real time: far below the 19 ms left before.
  bench.at_ms(1000);
  net::Address seen;
  bench.at_ms(1001);
  EXPECT_TRUE(Bench::all(bench.server).empty());
  bench.at_ms(1020);
  ASSERT_EQ(Bench::all(bench.server, &seen).size(), 1u);
  bench.server.send(Bytes{2}, seen);
  bench.at_ms(1020);
  bench.at_ms(1030);
  EXPECT_TRUE(Bench::all(a).empty());
  bench.at_ms(1070);
  EXPECT_EQ(Bench::all(a).size(), 1u);
}

TEST(Relay, TheImpairmentsReachTheBytes) {
  RelayConfig config;
  config.to_server.duplicate = 1;
  config.to_server.corrupt = 1;
  config.to_client.truncate = 1;
  Bench bench(config);
  net::Udp a = bench.client();
  bench.send(a, Bytes(100, 0));
  bench.at_ms(1);
  net::Address seen;
  const auto up = Bench::all(bench.server, &seen);
  ASSERT_EQ(up.size(), 2u);
  for (const Bytes& bytes : up) {
    EXPECT_EQ(bytes.size(), 100u);
    EXPECT_EQ(std::count(bytes.begin(), bytes.end(), 0), 99);
  }
  bench.server.send(Bytes(100, 7), seen);
  bench.at_ms(2);
  const auto down = Bench::all(a);
  ASSERT_EQ(down.size(), 1u);
  EXPECT_LT(down[0].size(), 100u);
  EXPECT_EQ(down[0], Bytes(down[0].size(), 7));
}

TEST(Relay, TheWaysDrawApartAndASeedRepeats) {
  // Which of 200 datagrams each way survive a loss of one half; equal by chance once in 2^200.
  const auto survivors = [](std::uint64_t seed, std::vector<Bytes>& up, std::vector<Bytes>& down) {
    RelayConfig config;
    config.to_server.loss = config.to_client.loss = 0.5;
    config.seed = seed;
    Bench bench(config);
    net::Udp a = bench.client();
    net::Address outside;
    for (std::uint8_t i = 0; i < 200; ++i) {
      bench.send(a, {i});
      bench.at_ms(i + 1);
      const auto got = Bench::all(bench.server, &outside);
      up.insert(up.end(), got.begin(), got.end());
    }
    for (std::uint8_t i = 0; i < 200; ++i) {
      bench.server.send(Bytes{i}, outside);
      bench.at_ms(300 + i);
      const auto got = Bench::all(a);
      down.insert(down.end(), got.begin(), got.end());
    }
  };
  std::vector<Bytes> up, down, up_again, down_again, up_other, down_other;
  survivors(1, up, down);
  survivors(1, up_again, down_again);
  survivors(2, up_other, down_other);
  EXPECT_NEAR(static_cast<double>(up.size()), 100, 5 * std::sqrt(200 * 0.25));
  EXPECT_NE(up, down);
  EXPECT_EQ(up, up_again);
  EXPECT_EQ(down, down_again);
  EXPECT_NE(up, up_other);
}

TEST(Relay, PlacesAreBoundedAndIdleOnesGivenUp) {
  RelayConfig config;
  config.max_clients = 2;
  config.idle_ns = 1000 * kMs;
  config.to_client.delay_ns = 5000 * kMs;
  Bench bench(config);
  net::Udp a = bench.client();
  net::Udp b = bench.client();
  net::Udp c = bench.client();
  bench.send(a, {1});
  bench.at_ms(1);
  net::Address seen_a;
  Bench::all(bench.server, &seen_a);
  bench.server.send(Bytes{9}, seen_a);  // on its way for longer than a stays
  bench.at_ms(1);
  bench.send(b, {2});
  bench.send(c, {3});
  bench.at_ms(500);
  EXPECT_EQ(Bench::all(bench.server), (std::vector<Bytes>{{2}}));
  EXPECT_EQ(bench.relay->clients().refused, 1u);
  bench.send(b, {2});
  bench.at_ms(900);
  Bench::all(bench.server);
  bench.at_ms(1300);
  bench.send(c, {3});
  bench.at_ms(1400);
  EXPECT_EQ(Bench::all(bench.server), (std::vector<Bytes>{{3}}));
  EXPECT_EQ(bench.relay->clients().now, 2u);
  EXPECT_EQ(bench.relay->clients().idled, 1u);
  // c has the place that a had: what was for a does not reach it.
  for (int ms = 1500; ms < 5000; ms += 400) {
    bench.send(c, {3});
    bench.at_ms(ms);
  }
  bench.at_ms(5100);
  EXPECT_TRUE(Bench::all(a).empty());
  EXPECT_TRUE(Bench::all(c).empty());
  EXPECT_EQ(bench.relay->to_client().not_sent, 1u);
}

TEST(Relay, WhatIsTooLongIsDroppedAndCounted) {
  Bench bench;
  net::Udp a = bench.client();
  bench.send(a, Bytes(Relay::kDatagramBytes, 1));
  bench.send(a, Bytes(Relay::kDatagramBytes + 1, 1));
  bench.at_ms(1);
  const auto got = Bench::all(bench.server);
  ASSERT_EQ(got.size(), 1u);
  EXPECT_EQ(got[0].size(), Relay::kDatagramBytes);
  EXPECT_EQ(bench.relay->to_server().too_long, 1u);
}

TEST(Relay, NoAllocationForADatagram) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "a sanitizer owns malloc";
  RelayConfig config;
  config.to_server.jitter_ns = config.to_client.jitter_ns = 3 * kMs;
  config.to_server.loss = config.to_server.duplicate = 0.1;
  config.to_client.outage_gap_ns = 100 * kMs;
  config.to_client.outage_length_ns = 10 * kMs;
  Bench bench(config);
  net::Udp a = bench.client();
  bench.send(a, {1});
  bench.at_ms(5);
  net::Address seen;
  for (int ms = 6; seen.port == 0 && ms < 50; ++ms) {
    bench.send(a, {1});
    bench.at_ms(ms);
    Bench::all(bench.server, &seen);
  }
  ASSERT_NE(seen.port, 0);
  const Bytes bytes(200, 5);
  const support::AllocGuard guard;
  for (int ms = 50; ms < 1050; ++ms) {
    a.send(bytes, bench.relay->local());
    bench.server.send(bytes, seen);
    bench.at_ms(ms);
  }
  EXPECT_EQ(guard.allocations(), 0u);
  EXPECT_GT(bench.relay->to_server().impairment.counts.delivered, 900u);
  EXPECT_GT(bench.relay->to_client().impairment.counts.delivered, 700u);
}

RelayOptions addresses() {
  RelayOptions options;
  options.listen = "127.0.0.1:0";
  options.to = "127.0.0.1:5100";
  return options;
}

TEST(RelayOptions, OneNumberIsForBothWaysTwoAreApart) {
  RelayOptions o = addresses();
  o.delay_ms = "5,30";
  o.loss = "0.1";
  o.burst_ms = "0,40";
  o.rate_bit_s = "1e6,0";
  o.jitter = "exponential";
  o.outage = "5:0.5,20:2";
  o.random_outage = "30:0.25";
  const RelayConfig config = relay_config(o);
  EXPECT_EQ(config.to_server.delay_ns, 5 * kMs);
  EXPECT_EQ(config.to_client.delay_ns, 30 * kMs);
  EXPECT_EQ(config.to_server.loss, 0.1);
  EXPECT_EQ(config.to_client.loss, 0.1);
  EXPECT_EQ(config.to_server.burst_ns, 0);
  EXPECT_EQ(config.to_client.burst_ns, 40 * kMs);
  EXPECT_EQ(config.to_server.rate_bit_s, 1e6);
  EXPECT_EQ(config.to_client.rate_bit_s, 0);
  EXPECT_EQ(config.to_client.jitter, net::ImpairmentConfig::Jitter::kExponential);
  ASSERT_EQ(config.to_server.outages.size(), 2u);
  EXPECT_EQ(config.to_server.outages[1].start_ns, 20'000 * kMs);
  EXPECT_EQ(config.to_server.outages[0].length_ns, 500 * kMs);
  EXPECT_EQ(config.to_client.outage_gap_ns, 30'000 * kMs);
  EXPECT_EQ(config.to_client.outage_length_ns, 250 * kMs);
}

TEST(RelayOptions, ATraceIsReadAndItsMistakesAreNamed) {
  const auto file = std::filesystem::temp_directory_path() / ("telenano_trace_" + std::to_string(::getpid()));
  const auto load = [&](const std::string& text) {
    std::ofstream(file, std::ios::trunc) << text;
    return load_trace(file);
  };
  const auto rows = load("time_s,delay_ms,lost\n100,5,0\r\n100.25,1.5,1\n\n");
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0].time_ns, 0);
  EXPECT_EQ(rows[1].time_ns, 250 * kMs);
  EXPECT_EQ(rows[1].delay_ns, 1'500'000);
  EXPECT_FALSE(rows[0].lost);
  EXPECT_TRUE(rows[1].lost);
  const std::pair<std::string, std::string> bad[] = {{"", "empty"},
                                                     {"t,d,l\n", "header"},
                                                     {"time_s,delay_ms,lost\n", "no rows"},
                                                     {"time_s,delay_ms,lost\n0,1\n", "line 2: 2 cells"},
                                                     {"time_s,delay_ms,lost\n0,x,0\n", "'x'"},
                                                     {"time_s,delay_ms,lost\n0,nan,0\n", "delay_ms: nan"},
                                                     {"time_s,delay_ms,lost\n0,-1,0\n", "0 to 60000"},
                                                     {"time_s,delay_ms,lost\ninf,1,0\n", "time_s: inf"},
                                                     {"time_s,delay_ms,lost\n0,1,0.5\n", "0 or 1"},
                                                     {"time_s,delay_ms,lost\n1,1,0\n1,1,0\n", "line 3"}};
  for (const auto& [text, named] : bad) {
    try {
      load(text);
      ADD_FAILURE() << "accepted: " << text;
    } catch (const UserError& error) {
      EXPECT_NE(std::string(error.what()).find(named), std::string::npos) << error.what();
    }
  }
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace telenano::studies

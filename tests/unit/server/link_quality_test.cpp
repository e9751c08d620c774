// What both ends say of a link, against a simulated one whose delays, losses and clocks are known.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "virtual_session.h"

namespace telenano::server {
namespace {

/// A session whose server has a clock of its own.
struct TwoClocks {
  static constexpr std::int64_t kTickNs = 1'000'000;
  static constexpr double kOriginNs = 7.5e12;

  TwoClocks(Server& server_in, const net::SimPath& up, const net::SimPath& down, double ppm_in,
            const link::ClientConfig& config = {})
      : server(server_in), client(config), link(up, down, 5), ppm(ppm_in) {
    client.start(0);
  }

  std::int64_t at_server(std::int64_t t_ns) const {
    return std::llround(kOriginNs + static_cast<double>(t_ns) * (1 + ppm * 1e-6));
  }

  void run_until(std::int64_t to_ns) {
    net::Received received;
    while (link.next_arrival_ns() <= to_ns) {
      link.advance_to(link.next_arrival_ns());
      const std::int64_t t_ns = link.now_ns();
      while (link.b().receive(buffer, received)) {
        const std::uint64_t before = server.counters().exchanges;
        const std::size_t n =
            server.on_datagram({buffer.data(), received.size}, received.from, at_server(t_ns), answer);
        if (server.counters().exchanges > before) accepted_ns.push_back(t_ns);
        if (n > 0) link.b().send({answer.data(), n}, received.from);
      }
      while (link.a().receive(buffer, received)) {
        if (client.on_datagram({buffer.data(), received.size}, t_ns) != link::ClientEvent::kReply) continue;
        const link::Reply& r = client.reply();
        const std::int64_t server_at_ns = accepted_ns[r.sequence - 1];
        up_ns = server_at_ns - static_cast<std::int64_t>(r.command_send_time_ns);
        down_ns = t_ns - server_at_ns;
        if (on_reply) on_reply(t_ns);
      }
    }
    link.advance_to(to_ns);
  }

  void tick() {
    run_until(now_ns += kTickNs);
    server.poll(at_server(now_ns));
    if (const std::size_t n = client.poll(now_ns, buffer)) {
      link.a().send({buffer.data(), n}, {});
      ++hellos;
    }
    link::Command c = VirtualSession::engaged();
    if (const std::size_t n = client.make_command(c, now_ns, buffer)) link.a().send({buffer.data(), n}, {});
  }
  void ticks(int n) {
    for (int i = 0; i < n; ++i) tick();
  }

  Server& server;
  link::ClientSession client;
  net::SimLink link;
  double ppm;
  std::int64_t now_ns = 0;
  std::uint64_t hellos = 0;
  std::int64_t up_ns = 0, down_ns = 0;  ///< of the newest exchange, as they really were
  std::vector<std::int64_t> accepted_ns;
  std::function<void(std::int64_t)> on_reply;
  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> buffer{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> answer{};
};

net::SimPath path(std::int64_t delay_ns, std::int64_t jitter_ns) {
  net::SimPath p;
  p.delay_ns = delay_ns;
  p.jitter_ns = jitter_ns;  // uniform, less than a tick: nothing overtakes
  return p;
}

TEST(LinkQuality, TimesAndClockAreThoseOfTheLink) {
  for (const double ppm : {-200.0, 0.0, 200.0}) {
    Server server(test_config(), spring_scene());
    constexpr double kWidthNs = 400e3;
    TwoClocks s(server, path(4'000'000, 400'000), path(9'000'000, 400'000), ppm);
    double jitter_sum_us = 0, worst_excess_us = 0, rtt_sum_us = 0;
    int samples = 0;
    s.on_reply = [&](std::int64_t t_ns) {
      if (t_ns < 20'000'000'000) return;
      const link::LinkQuality q = s.client.quality(t_ns);
      jitter_sum_us += q.jitter_us;
      rtt_sum_us += q.rtt_us;
      ++samples;
      worst_excess_us = std::max(
          {worst_excess_us, std::fabs(q.up_excess_us - static_cast<double>(s.up_ns - 4'000'000) * 1e-3),
           std::fabs(q.down_excess_us - static_cast<double>(s.down_ns - 9'000'000) * 1e-3)});
    };
    s.ticks(60'000);
    const link::LinkQuality q = s.client.quality(s.now_ns);
    ASSERT_GT(samples, 30'000);
    // The sum of two uniform delays: the least of 60 000 is sqrt(2/60 000)·0.4 ms = 2 us above 13 ms.
    EXPECT_GE(q.rtt_min_us, 13'000);
    EXPECT_LT(q.rtt_min_us, 13'020);
    EXPECT_NEAR(rtt_sum_us / samples, 13'400, 5);
    // |D| of two independent uniform delays of width w is w/3 on average. Its estimate wanders by some 4 %;
    // 40 000 of them, each 16 long, leave 0.1 %. The drift adds 0.2 us of 133.
    EXPECT_NEAR(jitter_sum_us / samples, kWidthNs * 1e-3 / 3, 2);
    EXPECT_NEAR(q.drift_ppm, ppm, 0.2);
    // The ways differ by 5 ms, of which nobody can know: 2.5 ms of offset, within the stated bound.
    const double true_offset_us = static_cast<double>(s.at_server(s.now_ns) - s.now_ns) * 1e-3;
    EXPECT_NEAR(q.offset_us - true_offset_us, -2'500, 20);
    EXPECT_LT(std::fabs(q.offset_us - true_offset_us), 0.5 * q.rtt_min_us);
    // Base: least of a block's thousands of uniform delays, 0.4 ms/1000, plus 0.2 ppm over a minute.
    EXPECT_LT(worst_excess_us, 20) << ppm;

    // The server's side, without a reply's times: commands alone, and which replies they acknowledge.
    const link::PeerStats& peer = server.sessions()[s.client.welcome().session_id & 0xff].peer_stats;
    EXPECT_NEAR(peer.jitter_ns(), kWidthNs / 3, 0.3 * kWidthNs / 3);
    EXPECT_GE(peer.rtt_ns(), 13e6);
    EXPECT_LT(peer.rtt_ns(), 15e6) << "the wait for the next tick is in it";
  }
}

TEST(LinkQuality, AgeOfTheForceIsSinceItWasMeasured) {
  for (const double ppm : {-200.0, 200.0}) {
    Server server(test_config(), spring_scene());
    TwoClocks s(server, path(5'000'000, 300'000), path(5'000'000, 300'000), ppm);
    double worst_ms = 0;
    s.ticks(20'000);
    for (int k = 0; k < 10'000; ++k) {
      s.tick();
      const std::int64_t measured_ns = s.accepted_ns[s.client.reply().sequence - 1];
      const double age_ms = static_cast<double>(s.now_ns - measured_ns) * 1e-6;
      worst_ms = std::max(worst_ms, std::fabs(s.client.quality(s.now_ns).force_age_ms - age_ms));
    }
    // Equal ways: the offset is right to half of the least exchange's asymmetry, microseconds, and its line
    // is carried on over at most 20 s.
    EXPECT_LT(worst_ms, 0.03) << ppm;
    s.link.path_b_to_a().down = true;
    s.ticks(300);
    const double silent_ms =
        static_cast<double>(s.now_ns - s.accepted_ns[s.client.reply().sequence - 1]) * 1e-6;
    EXPECT_GT(silent_ms, 290);
    EXPECT_NEAR(s.client.quality(s.now_ns).force_age_ms, silent_ms, 0.03) << "it goes on ageing";
  }
}

TEST(LinkQuality, CountsAreThoseOfTheLink) {
  Server server(test_config(), spring_scene());
  net::SimPath up = path(2'000'000, 500'000), down = path(3'000'000, 500'000);
  TwoClocks s(server, up, down, 30);
  s.ticks(200);
  ASSERT_EQ(s.client.state(), link::ClientState::kEstablished);
  ASSERT_EQ(s.client.quality(s.now_ns).commands_lost, 0u);
  s.link.path_a_to_b().loss = 0.05;
  s.link.path_b_to_a().loss = 0.10;
  s.link.path_a_to_b().duplicate = 0.03;
  s.link.path_b_to_a().duplicate = 0.02;
  s.ticks(30'000);
  s.link.path_a_to_b() = up;
  s.link.path_b_to_a() = down;
  s.ticks(100);
  const link::LinkQuality q = s.client.quality(s.now_ns);
  EXPECT_EQ(q.commands_lost, s.link.counts_a_to_b().lost);
  EXPECT_GT(q.commands_lost, 1'300u);
  EXPECT_EQ(q.replies_lost, s.link.counts_b_to_a().lost);
  EXPECT_GT(q.replies_lost, 2'500u);
  EXPECT_EQ(q.duplicates, s.link.counts_b_to_a().duplicated);
  EXPECT_EQ(q.reordered, 0u);
  EXPECT_EQ(q.commands_sent, s.client.commands_sent());
  // Each is 3 to 3.5 ms on its way back: three or four of them are.
  const std::uint64_t on_the_way = s.accepted_ns.size() - q.replies - q.replies_lost;
  EXPECT_TRUE(on_the_way >= 2 && on_the_way <= 4) << on_the_way;
  const link::Session& session = server.sessions()[s.client.welcome().session_id & 0xff];
  EXPECT_EQ(session.commands.lost(), s.link.counts_a_to_b().lost);
  EXPECT_EQ(session.commands.duplicate(), s.link.counts_a_to_b().duplicated);

  // Another session of the same station goes on counting.
  const std::uint64_t sent = q.commands_sent, lost = q.replies_lost;
  s.link.path_a_to_b().down = true;
  s.ticks(3000);
  s.link.path_a_to_b().down = false;
  s.ticks(1500);
  ASSERT_EQ(s.client.sessions(), 2u);
  EXPECT_GT(s.client.quality(s.now_ns).commands_sent, sent + 1000);
  EXPECT_GE(s.client.quality(s.now_ns).replies_lost, lost);
}

TEST(LinkQuality, ReorderedRepliesAreCountedAndHandedOn) {
  Server server(test_config(), spring_scene());
  net::SimPath down = path(3'000'000, 0);
  down.reorder = 0.1;
  down.reorder_ns = 2'500'000;
  down.in_order = false;
  TwoClocks s(server, path(2'000'000, 0), down, 0);
  s.ticks(10'000);
  const link::LinkQuality q = s.client.quality(s.now_ns);
  EXPECT_GT(q.reordered, 500u);
  // One that is held back behind those that are held back too is not overtaken.
  EXPECT_LE(q.reordered, s.link.counts_b_to_a().reordered);
  EXPECT_EQ(q.replies_lost, 0u);
}

}  // namespace
}  // namespace telenano::server

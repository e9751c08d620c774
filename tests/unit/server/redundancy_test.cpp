// Datagrams that repeat the last commands: what the slave is told over a link that loses them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "telenano/common/base/random.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

/// Writes down what it is told, and is a spring floor besides.
class PathSlave final : public slave::Slave {
 public:
  struct Step {
    Vec3 target_w_nm;
    double dt_s;
    bool follow;
    double energy_net_aj;
  };
  explicit PathSlave(std::vector<Step>& path) : path_(path) {}
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    spring_.step(input, dt_s, output);
    path_.push_back(
        {input.tip_target_pos_w_nm, dt_s, input.follow, output.energy_in_aj - output.energy_out_aj});
  }
  const slave::SlaveLimits& limits() const noexcept override { return spring_.limits(); }

 private:
  SpringSlave spring_;
  std::vector<Step>& path_;
};

struct Commanded {
  Vec3 pos_w_nm;
  bool follow;
  bool delivered;
};

/// A station that draws something over a link, and both ends of it.
struct Drawing {
  std::vector<PathSlave::Step> path;
  std::vector<Commanded> commanded;
  std::uint64_t recovered = 0;
  std::size_t datagram_max = 0;
  double energy_in_aj = 0;
  std::uint64_t accepted = 0;

  Drawing(double loss, std::size_t redundancy, std::uint64_t seed, std::uint32_t method = link::kMethodNone,
          int ticks = 2000) {
    path.reserve(static_cast<std::size_t>(ticks) + 200);
    ServedScene scene = spring_scene();
    scene.make_slave = [this] { return std::make_unique<PathSlave>(path); };
    Server server(test_config(), std::move(scene));
    link::ClientConfig config;
    config.redundancy = redundancy;
    net::SimPath way;
    way.delay_ns = 1'500'000;
    VirtualSession s(&server, config, way, way, seed);
    s.client.start(0);
    s.ticks(20);
    // The last two of the commands before are still on their way.
    const std::uint64_t first = s.client.commands_sent();
    const auto before = static_cast<std::ptrdiff_t>(first);
    s.link.path_a_to_b().loss = s.link.path_b_to_a().loss = loss;
    for (int k = 0; k < ticks; ++k) {
      if (k == ticks - 20) s.link.path_a_to_b().loss = s.link.path_b_to_a().loss = 0;
      const double t = 1e-3 * k;
      // Down into the floor and out again, ten times a second, with a drawing in the plane.
      s.command.tip_pos_w_nm = {10 * std::cos(20 * t), 10 * std::sin(30 * t), -3 * std::sin(63 * t)};
      s.command.flags = link::kFlagDeadman | (k % 97 < 80 ? std::uint32_t{link::kFlagClutch} : 0u);
      s.command.control.method = method;
      if (method == link::kMethodTank || method == link::kMethodTdpa) {
        s.command.control.energy_scale_aj_j = 1e4;
        s.command.control.energy_sent_j = 1e-4 * (k + 1) + (k % 3) * 1e-5;
      } else if (method == link::kMethodWave) {
        s.command.control.energy_scale_aj_j = 1e4;
        s.command.control.wave_impedance_n_s_m = 1e-3;
        s.command.control.wave_sum = {1e-3 * std::sin(t), 0, -1e-3 * t};
        s.command.control.wave_energy_aj = 10 * t;
      }
      const std::uint64_t lost = s.link.counts_a_to_b().lost;
      s.tick();
      commanded.push_back({s.command.tip_pos_w_nm, (s.command.flags & link::kFlagClutch) != 0,
                           s.link.counts_a_to_b().lost == lost});
    }
    EXPECT_EQ(s.client.commands_sent() - first, commanded.size());
    s.run_until(s.now_ns + 10'000'000);
    path.erase(path.begin(), path.begin() + before);
    recovered = server.counters().recovered;
    const link::Session& session = server.sessions()[s.client.welcome().session_id & 0xff];
    accepted = session.commands.received();
    energy_in_aj = s.client.slave_energy_aj().in();
    datagram_max = s.client.commands_sent() > 0 ? largest(method, redundancy) : 0;
  }

  /// The commands that any of the next `n` datagrams brought, besides their own.
  std::vector<Commanded> reachable(std::size_t n) const {
    std::vector<Commanded> all;
    for (std::size_t k = 0; k < commanded.size(); ++k) {
      bool there = false;
      for (std::size_t i = k; i <= k + n && i < commanded.size(); ++i)
        there = there || commanded[i].delivered;
      if (there) all.push_back(commanded[k]);
    }
    return all;
  }

  static std::size_t largest(std::uint32_t method, std::size_t redundancy) {
    link::Codec codec;
    std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
    link::Command c;
    c.session_id = c.sequence = c.send_time_ns = c.newest_reply = UINT64_MAX;
    c.epoch = c.flags = UINT32_MAX;
    c.tip_vel_w_nm_s = c.tip_pos_w_nm = {1, 2, 3};
    c.energy_in_j = c.energy_out_j = 1;
    c.control = {method, 1, 1, {1, 2, 3}, 1, 1};
    link::RecentCommands recent;
    recent.count = redundancy;
    return codec.encode(c, recent, out);
  }
};

TEST(Redundancy, TheSlaveIsToldTheWholePathOnce) {
  std::uint64_t lost_for_good = 0, lost_in_all = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    for (std::size_t n = 0; n <= link::kMaxRecent; ++n) {
      const Drawing d(0.2, n, seed);
      const auto expected = d.reachable(n);
      ASSERT_EQ(d.path.size(), expected.size()) << "seed " << seed << " n " << n;
      double time_s = 0;
      for (std::size_t i = 0; i < expected.size(); ++i) {
        ASSERT_EQ(d.path[i].target_w_nm, expected[i].pos_w_nm) << i;
        ASSERT_EQ(d.path[i].follow, expected[i].follow) << i;
        time_s += d.path[i].dt_s;
      }
      EXPECT_NEAR(time_s, 2.0, 1e-9) << "no time is lost or told twice";
      const std::uint64_t delivered = static_cast<std::uint64_t>(
          std::count_if(d.commanded.begin(), d.commanded.end(), [](const auto& c) { return c.delivered; }));
      EXPECT_EQ(d.recovered, expected.size() - delivered);
      if (n == link::kMaxRecent) {
        lost_for_good += d.commanded.size() - expected.size();
        lost_in_all += d.commanded.size() - delivered;
      }
    }
  }
  // A run of five: 0.2^5 = 3.2e-4 of the commands instead of 0.2; of 20 000 some 6, at most five times that.
  std::printf("of 20000 commands %llu lost, %llu for good\n", static_cast<unsigned long long>(lost_in_all),
              static_cast<unsigned long long>(lost_for_good));
  EXPECT_GT(lost_in_all, 3'500u);
  EXPECT_LE(lost_for_good, 32u);
}

TEST(Redundancy, WithNoRunTooLongThePathIsThatOfALinkWithoutLoss) {
  // Path, time steps and energies bit for bit, with the methods that look at every command's sums as well.
  int compared = 0;
  for (const std::uint32_t method :
       {link::kMethodNone, link::kMethodTdpa, link::kMethodTank, link::kMethodWave}) {
    const Drawing whole(0, 0, 1, method, 500);
    ASSERT_EQ(whole.path.size(), 500u);
    for (std::uint64_t seed = 1; seed <= 12; ++seed) {
      const Drawing d(0.2, link::kMaxRecent, seed, method, 500);
      if (d.reachable(link::kMaxRecent).size() != d.commanded.size()) continue;
      ++compared;
      EXPECT_GT(d.recovered, 50u);
      ASSERT_EQ(d.path.size(), whole.path.size());
      double worst_dt_s = 0;
      bool same_path = true;
      double worst_aj = 0;
      for (std::size_t i = 0; i < whole.path.size(); ++i) {
        worst_dt_s = std::max(worst_dt_s, std::fabs(d.path[i].dt_s - whole.path[i].dt_s));
        same_path = same_path && (d.path[i].target_w_nm - whole.path[i].target_w_nm).norm() < 1e-9;
        worst_aj = std::max(worst_aj, std::fabs(d.path[i].energy_net_aj - whole.path[i].energy_net_aj));
      }
      EXPECT_TRUE(same_path) << "method " << method << " seed " << seed;
      // Spacings are differences of ages in seconds: rounding only.
      EXPECT_LT(worst_dt_s, 1e-15);
      EXPECT_LT(worst_aj, 1e-9) << "method " << method << " seed " << seed;
      EXPECT_NEAR(d.energy_in_aj, whole.energy_in_aj, 1e-9 * whole.energy_in_aj);
    }
  }
  EXPECT_GE(compared, 30);
  // Without repetition the slave cuts corners: what it counts is another energy.
  const Drawing whole(0, 0, 1, link::kMethodNone, 500);
  double worst_aj = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const Drawing cut(0.2, 0, seed, link::kMethodNone, 500);
    worst_aj = std::max(worst_aj, std::fabs(cut.energy_in_aj - whole.energy_in_aj));
  }
  EXPECT_GT(worst_aj, 1e-4 * whole.energy_in_aj);
}

TEST(Redundancy, ADatagramStaysWithinItsBounds) {
  EXPECT_LE(Drawing::largest(link::kMethodWave, link::kMaxRecent), link::kMaxDatagramBytes);
  EXPECT_EQ(Drawing::largest(link::kMethodWave, link::kMaxRecent), 461u);
  EXPECT_EQ(Drawing::largest(link::kMethodWave, 0), 201u);
}

TEST(Redundancy, IsOnlyUsedWhereItWasAgreed) {
  ServerConfig old = test_config();
  old.feature_bits = link::kKnownFeatures & ~std::uint64_t{link::kFeatureRedundancy};
  Server server(old, spring_scene());
  link::ClientConfig config;
  config.redundancy = 4;
  VirtualSession s(&server, config, {}, {}, 1);
  s.client.start(0);
  s.ticks(500);
  EXPECT_EQ(s.client.features() & link::kFeatureRedundancy, 0u);
  EXPECT_EQ(server.drops().total(), 0u);
  EXPECT_EQ(server.counters().recovered, 0u);
  // One that repeats without having agreed is dropped, and changes nothing.
  link::Codec codec;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::Command c = VirtualSession::engaged();
  c.session_id = s.client.welcome().session_id;
  c.epoch = s.client.welcome().epoch;
  c.sequence = s.client.commands_sent() + 1;
  link::RecentCommands recent;
  recent.count = 1;
  const std::size_t n = codec.encode(c, recent, out);
  const auto steps = server.counters().exchanges;
  std::array<std::uint8_t, link::kMaxDatagramBytes> answer{};
  EXPECT_EQ(server.on_datagram({out.data(), n}, s.link.address_a(), s.now_ns, answer), 0u);
  EXPECT_EQ(server.drops()[link::DropCause::kUnexpected], 1u);
  EXPECT_EQ(server.counters().exchanges, steps);

  link::ClientConfig none;
  VirtualSession plain(&server, none, {}, {}, 2);
  plain.client.start(0);
  plain.ticks(50);
  EXPECT_EQ(plain.client.features() & link::kFeatureRedundancy, 0u) << "not asked for, not granted";
}

}  // namespace
}  // namespace telenano::server

// Two stations at one tip: what each hand feels when the tip goes from one to the other.
#include <gtest/gtest.h>

#include "pressed_wall.h"

namespace telenano::support {
namespace {

using control::Method;

struct Both {
  explicit Both(Method method, double delay_ms = 3) : a(method, 1), b(method, 2) {
    for (PressedWall* wall : {&a, &b}) {
      wall->config.to_server.delay_ns = wall->config.to_station.delay_ns =
          static_cast<std::int64_t>(1e6 * delay_ms);
      wall->config.share = server::Share::kOneTip;
    }
    a.config.port = 1001;
    b.config.port = 1002;
    a.config.standing.rights = net::Rights::kOperate;
    b.config.standing.rights = net::Rights::kAdminister;
    a.start();
  }
  void start_b() {
    b.config.server = a.session->shared_server();
    b.config.start_ns = a.session->now_ns();
    b.start();
  }
  void steps(int n) {
    for (int i = 0; i < n; ++i) {
      a.step();
      if (b.session) b.step();
      const double z_nm = a.watch->commanded_z_w_nm;
      if (has_z) worst_move_nm = std::max(worst_move_nm, std::abs(z_nm - last_z_nm));
      last_z_nm = z_nm;
      has_z = true;
    }
  }
  PressedWall a, b;
  bool has_z = false;
  double last_z_nm = 0;
  double worst_move_nm = 0;
};

TEST(SharedTip, TakenOverInContactWithoutAStepOfForceOrTip) {
  for (const Method method : {Method::kNone, Method::kKs, Method::kKsClamp, Method::kTdpa, Method::kWave,
                              Method::kTank, Method::kModel}) {
    SCOPED_TRACE(control::method_name(method));
    Both both(method);
    both.steps(2500);
    ASSERT_TRUE(both.a.session->station().holds_tip());
    ASSERT_GT(both.a.watch->force_nn, 5);
    both.start_b();
    both.steps(500);
    VirtualSession& a = *both.a.session;
    VirtualSession& b = *both.b.session;
    EXPECT_FALSE(b.station().holds_tip());
    EXPECT_EQ(b.station().mode(), station::Mode::kReady);
    EXPECT_EQ(both.b.most_force_n, 0) << "an observer feels nothing";
    EXPECT_GT(b.station().reply().force_w_nn.z(), 5) << "but sees it";
    EXPECT_EQ(b.client().slave_energy_aj().in() + b.client().slave_energy_aj().out(), 0);
    EXPECT_NEAR(b.loop().trace().tip_target_pos_w_nm.z(), both.a.watch->commanded_z_w_nm, 0.3);

    // b asks. From here on the tip may move by what hands do, nothing else.
    both.worst_move_nm = 0;
    both.a.most_force_n = both.a.last_force_n;
    const double a_in = both.a.watch->energy_in_aj, a_out = both.a.watch->energy_out_aj;
    b.loop().set_tip_wish(link::kFlagTakeOver);
    both.steps(6);
    both.steps(14);
    EXPECT_TRUE(b.station().holds_tip());
    EXPECT_FALSE(a.station().holds_tip());
    EXPECT_LE(both.worst_move_nm, 0.2) << "a hand makes 0.05 nm in a tick here, a wave twice that";
    both.steps(100);
    EXPECT_EQ(both.a.last_force_n, 0) << "faded";
    both.steps(3000);
    EXPECT_EQ(b.station().mode(), station::Mode::kEngaged);
    EXPECT_LE(both.worst_move_nm, 0.2);
    EXPECT_LE(both.a.worst_rise_n, both.a.slew_limit_n());
    EXPECT_LE(both.b.worst_rise_n, both.b.slew_limit_n());
    // Each has its own part of the slave's account, and both together no more than the slave.
    const auto& ea = a.client().slave_energy_aj();
    const auto& eb = b.client().slave_energy_aj();
    EXPECT_NEAR(ea.in(), a_in, 0.05 * a_in + 0.1);
    EXPECT_NEAR(ea.out(), a_out, 0.05 * a_in + 0.1);
    EXPECT_LE(ea.in() + eb.in(), both.a.watch->energy_in_aj + 1e-9 * a_in);
    EXPECT_LE(ea.out() + eb.out(), both.a.watch->energy_out_aj + 1e-9 * a_in);
    EXPECT_LE(eb.out(), eb.in() + 1e-9) << "b is not credited with a's";
    // And neither hand got more than the allowance, by its own account.
    if (promises(method)) {
      for (PressedWall* wall : {&both.a, &both.b})
        EXPECT_LE(wall->hand->account().most_extracted_j(), wall->config.station.allowance_j + 1e-9);
    }
  }
}

TEST(SharedTip, HandedToAndFroOverALongAndLossyWay) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    Both both(seed % 2 ? Method::kModel : Method::kKsClamp, 40);
    for (auto* path : {&both.a.session->link().path_a_to_b(), &both.a.session->link().path_b_to_a()}) {
      path->loss = 0.3;
      path->duplicate = 0.1;
      path->reorder = 0.1;
    }
    both.steps(2500);
    both.start_b();
    both.steps(300);
    VirtualSession& a = *both.a.session;
    VirtualSession& b = *both.b.session;
    both.worst_move_nm = 0;
    std::uint32_t changes = 0;
    bool b_held = false;
    for (int round = 0; round < 12; ++round) {
      const bool to_b = round % 2 == 0;
      b.loop().set_tip_wish(to_b ? std::uint32_t{link::kFlagTakeOver} : link::kFlagHandOver);
      a.loop().set_tip_wish(to_b ? 0u : std::uint32_t{link::kFlagTakeOver});
      both.steps(700);
      if (b.station().holds_tip() != b_held) ++changes;
      b_held = b.station().holds_tip();
      EXPECT_FALSE(a.station().holds_tip() && b.station().holds_tip());
    }
    EXPECT_GE(changes, 8u);
    EXPECT_LE(both.a.worst_rise_n, both.a.slew_limit_n());
    EXPECT_LE(both.b.worst_rise_n, both.b.slew_limit_n());
    // Lost commands make the next one bring the way of all of them; a hand of 50 mm/s makes 0.05 nm a tick.
    EXPECT_LE(both.worst_move_nm, 2.0);
  }
}

}  // namespace
}  // namespace telenano::support

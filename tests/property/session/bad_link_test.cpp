// Whatever the link does: no drift, no lost or invented energy, no step of the force, once it heals.
#include <gtest/gtest.h>

#include "bad_path.h"
#include "pressed_wall.h"

namespace telenano::support {
namespace {

using control::Method;

TEST(BadLink, NoDriftNoEnergyLostNoForceStepOnceItHeals) {
  constexpr Method kMethods[] = {Method::kKs,   Method::kKsClamp, Method::kTdpa,
                                 Method::kWave, Method::kTank,    Method::kModel};
  std::uint64_t resumed = 0, lost = 0, lossy = 0, pressed = 0;
  for (std::uint64_t seed = 1; seed <= 48; ++seed) {
    Random random(seed);
    PressedWall wall(kMethods[seed % 6], seed);
    make_bad(random, wall.config);
    wall.start();
    VirtualSession& s = *wall.session;
    wall.steps(8000);
    heal(s.link().path_a_to_b());
    heal(s.link().path_b_to_a());
    wall.steps(3000);
    SCOPED_TRACE(std::string(control::method_name(s.station().method())) + ", seed " + std::to_string(seed));
    // A hand that leans on a wall seconds away may swing for ever. With the clutch open the slave holds, and
    // after a round trip nothing is under way: then equal means equal.
    s.loop().set_buttons(device::kButtonClutch);
    wall.steps(3000);
    EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
    ASSERT_EQ(s.client().state(), link::ClientState::kEstablished);
    EXPECT_EQ(s.station().mode(), station::Mode::kReady);
    const auto& slave_account = s.client().slave_energy_aj();
    EXPECT_EQ(slave_account.in(), wall.watch->energy_in_aj);
    EXPECT_EQ(slave_account.out(), wall.watch->energy_out_aj);
    pressed += wall.watch->energy_in_aj > 1;
    // Methods that pay for motion lag by what they could not pay for; the others stand where they were told.
    if (!control::needs_port_control(s.station().method())) {
      EXPECT_EQ(wall.watch->commanded_z_w_nm, std::clamp(wall.target_z_nm(), -50.0, 100.0))
          << "no drift at all";
    }
    // The station's account at the server counts from the Welcome: with one session, all of it.
    const link::Session& at_server = s.server().sessions()[s.client().welcome().session_id & 0xff];
    const control::EnergyObserver& observer = s.station().observer();
    const double rounding = 1e-12 * (observer.energy_in_j() + observer.energy_out_j()) + 1e-18;
    if (s.client().sessions() == 1) {
      EXPECT_NEAR(at_server.station_energy.in(), observer.energy_in_j(), rounding);
      EXPECT_NEAR(at_server.station_energy.out(), observer.energy_out_j(), rounding);
    } else {
      EXPECT_LE(at_server.station_energy.in(), observer.energy_in_j() + rounding);
    }
    // The station's observer against the hand's own account, in long double.
    EXPECT_NEAR(observer.energy_j(), -wall.hand->account().given_j(), 1e3 * rounding);
    if (promises(s.station().method())) {
      EXPECT_LE(wall.hand->account().most_extracted_j(), wall.config.station.allowance_j + 1e-9);
    }
    resumed += s.server().counters().resumed;
    lost += s.link().counts_a_to_b().lost + s.link().counts_b_to_a().lost;
    lossy += wall.config.to_server.loss > 0.25;
  }
  EXPECT_GT(lost, 100'000u) << "of 768 000, or these links were not bad";
  EXPECT_GE(resumed, 1u);
  EXPECT_GT(lossy, 10u);
  EXPECT_GT(pressed, 40u);
}

TEST(BadLink, FlippedBitsNeitherStepTheForceNorEndTheSession) {
  // Without UDP's checksum and without DTLS, so that every flip arrives. Values may be wrong then; limits
  // hold, nothing is locked out, and the position heals.
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    PressedWall wall(seed % 2 ? Method::kKsClamp : Method::kModel, seed);
    wall.config.to_server.corrupt = wall.config.to_station.corrupt = 0.05;
    wall.config.to_server.delay_ns = wall.config.to_station.delay_ns = 5'000'000;
    wall.start();
    VirtualSession& s = *wall.session;
    wall.steps(10000);
    s.link().path_a_to_b().corrupt = s.link().path_b_to_a().corrupt = 0;
    wall.steps(3000);
    SCOPED_TRACE(seed);
    EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
    EXPECT_LE(wall.most_force_n, s.station().force_limit_n() * (1 + 1e-9));
    ASSERT_TRUE(s.client().has_session());
    EXPECT_EQ(s.client().state(), link::ClientState::kEstablished);
    EXPECT_GT(s.link().counts_a_to_b().corrupted + s.link().counts_b_to_a().corrupted, 500u);
    EXPECT_NEAR(wall.watch->commanded_z_w_nm, wall.target_z_nm(), 0.05);
    // A flipped sequence locks nobody out for longer than it takes to notice: of 13 000 replies far less than
    // one in three is missing, with one datagram in twenty flipped.
    EXPECT_GT(s.client().stats().samples(), 9000u);
  }
}

}  // namespace
}  // namespace telenano::support

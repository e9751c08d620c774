// Whatever the link does: no drift, no lost or invented energy, no step of the force, once it heals.
#include <gtest/gtest.h>

#include "common/base/random.h"
#include "pressed_wall.h"

namespace telenano::support {
namespace {

using control::Method;

/// Anything up to what the protocol is made for: 50 % loss, bursts of 500 ms, reordering, duplicates, cuts,
/// a round trip of 1 s, a clock 200 ppm off (the other way's delay shrinks as this one's grows).
void make_bad(Random& random, VirtualSessionConfig& config) {
  net::SimPath up;
  const double round_trip_ms = random.chance(0.3) ? 1000 : random.uniform(0, 300);
  up.delay_ns = static_cast<std::int64_t>(0.5e6 * round_trip_ms);
  up.jitter_ns = static_cast<std::int64_t>(random.uniform(0, 20e6));
  up.jitter = net::SimPath::Jitter::kExponential;
  up.in_order = random.chance(0.5);
  up.loss = random.uniform(0, 0.5);
  up.burst_ns = random.chance(0.5) ? static_cast<std::int64_t>(random.uniform(1e6, 500e6)) : 0;
  up.duplicate = random.uniform(0, 0.2);
  up.reorder = random.uniform(0, 0.2);
  up.reorder_ns = static_cast<std::int64_t>(random.uniform(1e6, 30e6));
  up.truncate = random.uniform(0, 0.05);
  up.drift_ppm = random.uniform(-200, 200);
  config.to_server = config.to_station = up;
  config.to_station.drift_ppm = -up.drift_ppm;
  if (random.chance(0.5)) std::swap(config.to_server, config.to_station);
}

void heal(net::SimPath& path) {
  net::SimPath good;
  good.delay_ns = path.delay_ns;
  path = good;
}

TEST(BadLink, NoDriftNoEnergyLostNoForceStepOnceItHeals) {
  constexpr Method kMethods[] = {Method::kNone, Method::kKsClamp, Method::kTdpa,
                                 Method::kWave, Method::kTank,    Method::kModel};
  int resumed = 0, lossy = 0;
  for (std::uint64_t seed = 1; seed <= 36; ++seed) {
    Random random(seed);
    PressedWall wall(kMethods[seed % 6], seed);
    make_bad(random, wall.config);
    wall.start();
    VirtualSession& s = *wall.session;
    const std::uint32_t epoch = s.client().welcome().epoch;
    wall.steps(8000);
    heal(s.link().path_a_to_b());
    heal(s.link().path_b_to_a());
    wall.steps(6000);  // and what is under way comes to rest
    SCOPED_TRACE(seed);
    EXPECT_LE(wall.worst_rise_n, wall.slew_limit_n());
    ASSERT_EQ(s.client().state(), link::ClientState::kEstablished);
    EXPECT_EQ(s.client().welcome().epoch, epoch) << "the same book throughout";
    EXPECT_EQ(s.station().mode(), station::Mode::kEngaged);
    // The commanded end stands where the station says, but for what one round trip holds of a hand at rest.
    // tdpa, tank and wave lag by what they could not pay for; what they must not do is walk away.
    const control::Method method = s.station().method();
    const double lag_nm = std::abs(wall.watch->commanded_z_w_nm - wall.target_z_nm());
    EXPECT_LE(lag_nm, control::needs_port_control(method) && method != Method::kModel ? 3.0 : 0.05)
        << control::method_name(method);
    // The slave's book at the station, against the wall's own: the last reply is on its way for a round trip,
    // in which a hand at rest moves nothing.
    const auto& known = s.client().slave_energy_aj();
    const double turned_aj = wall.watch->energy_in_aj + wall.watch->energy_out_aj + 1;
    EXPECT_NEAR(known.in(), wall.watch->energy_in_aj, 1e-3 * turned_aj);
    EXPECT_NEAR(known.out(), wall.watch->energy_out_aj, 1e-3 * turned_aj);
    resumed += static_cast<int>(s.server().counters().resumed);
    lossy += wall.config.to_server.loss > 0.25;
  }
  EXPECT_GT(resumed, 10) << "or these links were not bad";
  EXPECT_GT(lossy, 10);
}

TEST(BadLink, BooksAreEqualToTheLastBitOnceNothingMoves) {
  // The hand lets go at the end: then nothing is under way, and equal means equal.
  for (std::uint64_t seed = 100; seed < 112; ++seed) {
    Random random(seed);
    PressedWall wall(Method::kKsClamp, seed);
    make_bad(random, wall.config);
    wall.start();
    VirtualSession& s = *wall.session;
    wall.steps(6000);
    heal(s.link().path_a_to_b());
    heal(s.link().path_b_to_a());
    wall.steps(3000);
    const auto still = wall.hand->pos_m();
    s.loop().set_buttons(device::kButtonClutch);  // the slave holds
    wall.steps(3000);
    SCOPED_TRACE(seed);
    ASSERT_EQ(s.client().state(), link::ClientState::kEstablished);
    EXPECT_EQ(s.client().slave_energy_aj().in(), wall.watch->energy_in_aj);
    EXPECT_EQ(s.client().slave_energy_aj().out(), wall.watch->energy_out_aj);
    EXPECT_EQ(wall.target_z_nm(), wall.watch->commanded_z_w_nm) << "no drift at all";
    // The station's book at the server, since the Welcome: differences of the totals, and the hand's own book
    // in long double over all of it.
    const link::Session& at_server = s.server().sessions()[s.client().welcome().session_id & 0xff];
    const auto& observer = s.station().observer();
    EXPECT_LE(at_server.station_energy.in(), observer.energy_in_j() + 1e-15);
    const double all_in = observer.energy_in_j() - observer.energy_out_j();
    const double rounding = 1e-12 * (observer.energy_in_j() + observer.energy_out_j()) + 1e-18;
    if (s.client().sessions() == 1) {
      EXPECT_NEAR(at_server.station_energy.in() - at_server.station_energy.out(), all_in, rounding);
    }
    EXPECT_NE(still, 0);
  }
}

TEST(BadLink, FlippedBitsNeitherStepTheForceNorEndTheSession) {
  // Without UDP's checksum and without DTLS, so that every flip arrives. Values may be wrong then; limits hold,
  // nothing is locked out, and the position heals.
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
    // A flipped sequence locks nobody out for longer than it takes to notice: far less than one reply in ten
    // is missing.
    EXPECT_LT(s.client().stats().samples() + 3000, 13000u);
    EXPECT_GT(s.client().stats().samples(), 9000u);
  }
}

}  // namespace
}  // namespace telenano::support

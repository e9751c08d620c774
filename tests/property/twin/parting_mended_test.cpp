// What a parting of twin and server costs the hand. The oracle is a second session whose server does not part.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "tests/property/twin/parting_sessions.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using station::TwinState;

/// What a parting cost the hand: times from the tick in which the station heard of it.
struct Mended {
  double agree_s = -1;  ///< until twin and server are the same again, and the hand feels that state's force
  double fastest_n_s = 0;   ///< of what is felt beyond the twin's own force
  double beyond_m = 0;      ///< of the hand's place beside one whose server does not stray
  double most_apart_n = 0;  ///< between what is felt and the new state's force
  std::size_t bytes = 0;    ///< of the state
};

Mended mended(const std::string& name, double rtt_ms, double arm_n_m, double grip_n_m) {
  const auto scene = deployed(name);
  const auto session_of = [&](std::vector<int> strays) {
    VirtualSessionConfig config = pressing(scene, rtt_ms);
    config.plant.arm_stiffness_n_m = arm_n_m;
    config.plant.arm_damping_n_s_m =
        1.4 * std::sqrt(arm_n_m * config.plant.arm_mass_kg);  // as damped as by default
    config.plant.grip_stiffness_n_m = grip_n_m;
    config.make_slave = [scene, strays] { return std::make_unique<StraySlave>(scene, strays, false); };
    return std::make_unique<VirtualSession>(config);
  };
  const auto strayed = session_of({1600}), straight = session_of({});
  const control::Scaling scaling = strayed->station().config().scaling;
  Mended out;
  int heard = -1;
  Vec3 last_beyond_n = Vec3::Zero();
  for (int tick = 0; tick < 3500; ++tick) {
    strayed->step();
    straight->step();
    const station::StationTrace& t = strayed->loop().trace();
    const station::TwinRun& twin = *strayed->station().twin();
    out.beyond_m = std::max(out.beyond_m, (t.hand_pos_h_m - straight->loop().trace().hand_pos_h_m).norm());
    if (heard < 0 && twin.state() == TwinState::kApart) heard = tick;
    if (heard < 0) continue;
    // What is felt, less what the twin in use says: nothing, until the state is another one; then it goes away.
    const Vec3 beyond_n = t.rendered_force_h_n - scaling.hand_force_n(twin.answer().force_w_nn);
    out.most_apart_n = std::max(out.most_apart_n, beyond_n.norm());
    if (out.most_apart_n > beyond_n.norm())
      out.fastest_n_s = std::max(out.fastest_n_s, (last_beyond_n - beyond_n).norm() / 1e-3);
    last_beyond_n = beyond_n;
    if (agrees(*strayed) && twin.snapshots() == 1 && beyond_n.norm() < 1e-9) {
      if (out.agree_s < 0) out.agree_s = 1e-3 * (tick - heard);
    }
  }
  EXPECT_EQ(strayed->station().twin()->partings(), 1u) << name;
  EXPECT_EQ(strayed->station().mode(), station::Mode::kEngaged) << name;
  out.bytes = strayed->client().snapshot().data().size();
  return out;
}

// Asked: a round trip, the state's transfer and 50 ms; 20 N/s; 1 mm. Transfer: at 2000 pieces a second, and a
// second round trip where there are more of them than the first guess asks for. The force goes over at 20 N/s,
// so that what is further apart than 50 ms of that takes its time. Loose and firm hands.
TEST(Parting, ForcesAgreeAgainSoonAndTheHandIsNotMoved) {
  struct Hand {
    double arm_n_m, grip_n_m;
  };
  for (const char* const name : {"flat_pdms", "flakes", "humid_flakes", "lithography"}) {
    for (const double rtt_ms : {20.0, 200.0}) {
      for (const Hand& hand : {Hand{50, 300}, Hand{400, 3000}, Hand{1200, 6000}}) {
        const Mended m = mended(name, rtt_ms, hand.arm_n_m, hand.grip_n_m);
        const double pieces = std::ceil(static_cast<double>(m.bytes) / link::kSnapshotPieceBytes);
        const double transfer_s = pieces / link::SnapshotFetch::kPerSecond + (pieces > 2 ? 1e-3 * rtt_ms : 0);
        const double asked_s = 1e-3 * rtt_ms + transfer_s + 0.05;
        const std::string what = std::string(name) + ", " + std::to_string(rtt_ms) + " ms, arm of " +
                                 std::to_string(hand.arm_n_m) + " N/m";
        EXPECT_GE(m.agree_s, 1e-3 * rtt_ms) << what;
        EXPECT_LE(m.agree_s, asked_s + std::max(0.0, m.most_apart_n / control::Twin::kGoOver_n_s - 0.05))
            << what;
        EXPECT_LE(m.fastest_n_s, control::Twin::kGoOver_n_s * (1 + 1e-9)) << what;
        EXPECT_LE(m.beyond_m, 1e-3) << what;
        std::printf(
            "%s: forces agree after %.0f ms (%.0f asked), %.4f N apart, %.1f N/s, hand %.3f mm beyond\n",
            what.c_str(), 1e3 * m.agree_s, 1e3 * asked_s, m.most_apart_n, m.fastest_n_s, 1e3 * m.beyond_m);
      }
    }
  }
}

}  // namespace
}  // namespace telenano::support

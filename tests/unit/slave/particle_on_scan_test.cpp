// A particle on a ground of heights: it lies where the ground holds it, sleeps while nothing moves it, and
// then costs no balance of its own. Counts, not times: they repeat exactly.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/support/slave_walk.h"

namespace telenano::slave {
namespace {

constexpr double kDt_s = SlaveWalk::kDt_s;

// A sinusoid of 1 nm, 57 × 57 heights; the ball is held by friction on a crest, at half a period.
const std::string kGround = R"(name = "ball on waves"
[sample]
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "grating"
profile = "sinusoid"
height_nm = 1.0
period_nm = 48.0
spacing_nm = 2.5
[friction]
shear_strength_mpa = 300.0
[probe]
tip_radius_nm = 10.0
stiffness_n_m = 40.0
lateral_stiffness_n_m = 100.0
[probe.tip]
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 500.0
half_width_nm = 70.0
margin_nm = 4.0
[start]
x_nm = -55.0
y_nm = 0.0
height_nm = 30.0
)";
const std::string kBall = R"([particle]
radius_nm = 12.0
x_nm = 24.0
y_nm = 0.0
[particle.material]
youngs_modulus_gpa = 2.0
poisson_ratio = 0.4
surface_energy_j_m2 = 0.066
[particle.friction]
sample_shear_strength_mpa = 30.0
tip_shear_strength_mpa = 30.0
rolling_length_nm = 0.3
)";

std::shared_ptr<const scene::Scene> with_ball() {
  static const auto scene = scene::parse_scene(kGround + kBall, "ball.toml");
  return scene;
}
std::shared_ptr<const scene::Scene> without_ball() {
  static const auto scene = scene::parse_scene(kGround, "waves.toml");
  return scene;
}
std::shared_ptr<const scene::Scene> changed(const std::function<void(scene::Particle&)>& change) {
  auto scene = std::make_shared<scene::Scene>(*with_ball());
  change(*scene->particle);
  return scene;
}

// 60 to 85 nm from the ball: above the ground, on it, over a summit and along it.
const std::vector<Vec3> kFarAway = {{-55, 0, 8}, {-55, 0, -3}, {-40, 10, -3}, {-40, -5, 6}, {-60, 3, 6}};

// Beside a ball that sleeps a step makes no balance of the ball, and of the server's work it takes what the
// same step takes without one, and 2 units more: on the same path, whose forces differ by the attraction of
// the ball, the balance is the same one and may end an evaluation or two earlier or later.
TEST(ParticleOnAScan, AsleepItCostsNoBalance) {
  SlaveWalk beside(with_ball()), alone(without_ball());
  int steps = 0, balances = 0, dearer = 0;
  std::uint64_t work = 0, work_alone = 0;
  std::vector<std::uint32_t> each;
  for (const Vec3& corner : kFarAway) {
    each.clear();
    alone.go_to(corner, 0.5, [&](const SlaveOutput& out) { each.push_back(out.work); });
    std::size_t i = 0;
    beside.go_to(corner, 0.5, [&](const SlaveOutput& out) {
      ASSERT_EQ(out.fault_bits, 0u);
      ++steps;
      balances += beside.particle().substeps > 0;
      dearer += out.work > each[i] + 2;
      work += out.work;
      work_alone += each[i++];
    });
  }
  std::printf("%d steps, %d of them balanced the ball; work %llu, without a ball %llu; %d steps dearer\n",
              steps, balances, static_cast<unsigned long long>(work),
              static_cast<unsigned long long>(work_alone), dearer);
  EXPECT_LE(balances, 3);  // as it comes to rest
  EXPECT_LE(dearer, 3);
  EXPECT_LE(static_cast<double>(work), 1.02 * static_cast<double>(work_alone) + 100);
}

double charged(const SlaveOutput& out) {
  return out.energy_in_aj - out.energy_out_aj;
}

// One that sleeps where it can, and one that never does, under the same tip: far away, pressed on the ground,
// to the ball, against it, off again. The forces differ by what a sleeper leaves out, 1e-6 of the pull-off of
// ball and sample (some 20 nN), and twice what the balance of both leaves open, 1e-9 of forces of 300 nN: so
// falling asleep and waking are no step of the force. After it was pushed the two balls lie apart by what
// their bristles have yielded differently (1e-6 nm as found), at stiffnesses of up to 30 N/m.
TEST(ParticleOnAScan, AsleepIsFeltAsAwake) {
  SlaveWalk sleeper(with_ball());
  SlaveWalk watcher(changed([](scene::Particle& p) { p.parameters.sleeps = false; }));
  int alone = 0, steps = 0, met = 0, woke = 0;
  bool was_alone = false;
  double most = 0, most_snapped = 0, most_later = 0, most_counted = 0;
  bool snapped = false;
  const auto both = [&](const Vec3& to, double step) {
    std::vector<SlaveOutput> a;
    std::vector<bool> held;
    sleeper.go_to(to, step, [&](const SlaveOutput& out) {
      a.push_back(out);
      const bool now = sleeper.particle().substeps == 0;
      alone += now;
      woke += was_alone && !now;
      was_alone = now;
      held.push_back(sleeper.particle().held_by_tip);
    });
    std::size_t i = 0;
    watcher.go_to(to, step, [&](const SlaveOutput& out) {
      met += held[i];
      double& worst = snapped ? most_snapped : met > 0 ? most_later : most;
      worst = std::max(worst, (a[i].force_w_nn - out.force_w_nn).norm());
      most_counted = std::max(most_counted, std::fabs(charged(a[i]) - charged(out)));
      ASSERT_EQ(a[i].fault_bits, out.fault_bits) << steps;
      ++i;
      ++steps;
    });
  };
  both({-50, 0, 8}, 0.5);
  snapped = true;
  both({-50, 0, -2}, 0.25);
  both({-47, 1.8, -2}, 0.25);
  snapped = false;
  both({-40, 6, -2}, 0.25);
  both({-40, 6, 8}, 0.5);
  const int before = alone;
  EXPECT_GT(before, steps - 5);
  both({3, 0, 8}, 0.25);  // to the ball, and a little against it
  const int met_by = alone;
  both({3, 0, 45}, 0.25);  // off upwards: sideways it would come along
  both({-20, 14, 45}, 0.25);
  // Pressed beside it while it is awake, and on along the ground as it falls asleep.
  both({-10, 14, 8}, 0.5);
  both({-10, 14, -3}, 0.25);
  both({-45, 14, -3}, 0.25);
  both({-10, 14, -3}, 0.25);  // and back, as it wakes
  EXPECT_GT(met, 3);
  EXPECT_GE(woke, 1);
  EXPECT_GT(alone, met_by + 50);
  std::printf(
      "forces apart by %.2g nN (while a snap is remembered %.2g), after meeting %.2g nN, charges by %.2g aJ; "
      "%d of %d steps alone\n",
      most, most_snapped, most_later, most_counted, alone, steps);
  EXPECT_LT(most, 2e-5);
  // Of the step in which the tip snaps in, down a slope, the one balance has friction from the end on, the
  // other holds it on the way: bristles differ until the contact has slipped some contact radii, by less
  // than a tenth of what friction holds (0.3 GPa × π nm²).
  EXPECT_LT(most_snapped, 0.1);
  EXPECT_LT(most_later, 1e-4);
  // Snaps of the tip into the ground are counted exactly by the one, by the trapezium by the other: of 30 nN
  // over half a step.
  EXPECT_LT(most_counted, 30 * 0.25);
}

// What the tip gives the ball the ground takes, but for the drag (1e-4 nN at 1 µm/s); and the apex is where
// the springs are under the force that is told.
TEST(ParticleOnAScan, ForcesBalanceWhilePushed) {
  SlaveWalk walk(with_ball());
  walk.go_to({-30, 0, 8}, 0.5);
  int pushed = 0;
  walk.go_to({20, 2, 7}, 0.25, [&](const SlaveOutput& out) {
    ASSERT_EQ(out.fault_bits, 0u) << walk.at().transpose();
    if (walk.particle().substeps == 0) return;
    const auto& contacts = walk.particle().contacts;
    const Vec3 from_tip = contacts[physics::kTipParticle].force_w_nn;
    const Vec3 from_sample = contacts[physics::kParticleSample].force_w_nn;
    ASSERT_LT((from_tip + from_sample).norm(), 1e-3) << walk.at().transpose();
    const Vec3 on_tip = contacts[physics::kTipSample].force_w_nn - from_tip;
    ASSERT_LT((on_tip - out.force_w_nn).norm(), 1e-6);
    const Vec3 f = out.force_w_nn;
    const Vec3 bent(f.x() * (1 / 20.0 + 1 / 100.0), f.y() / 20, f.z() * (1 / 20.0 + 1 / 40.0));
    // The lever's tilt is not in this scene; along y it is rigid.
    ASSERT_LT((out.tip_pos_w_nm - out.commanded_pos_w_nm - bent).norm(), 1e-6) << walk.at().transpose();
    pushed += from_tip.norm() > 1;
  });
  EXPECT_GT(pushed, 30);
  EXPECT_GT(walk.particle().particle_centre_w_nm.x(), 30);  // off its crest
}

// The account against an integral of its own over the forces that were told, by the trapezium. Its error where
// nothing ends is of second order; meeting and parting add half a step's force each, 20 nN × 0.025 nm.
TEST(ParticleOnAScan, ChargesTheWorkOfTheCommandedEnd) {
  SlaveWalk walk(with_ball());
  SlaveOutput before = walk.go_to({-15, 0, 8}, 0.5);
  const double counted_at_start = charged(before);
  double work = 0, most = 0;
  Vec3 at = walk.at();
  const auto add = [&](const SlaveOutput& out) {
    ASSERT_EQ(out.fault_bits, 0u);
    work -= 0.5 * (out.force_w_nn + before.force_w_nn).dot(walk.at() - at);
    most = std::max(most, std::fabs(charged(out) - counted_at_start - work));
    at = walk.at();
    before = out;
  };
  walk.go_to({30, 0, 8}, 0.05, add);
  walk.go_to({-15, 0, 8}, 0.05, add);
  std::printf("work %.4g aJ, account apart from it by %.3g at most\n", work, most);
  EXPECT_GT(work, 10.0);
  EXPECT_LT(most, 0.02 * work);
}

/// "Few" terms; "All": a bias and a liquid bridge, on steeper waves, every border of a branch that there is;
/// or another law of contact.
std::shared_ptr<const scene::Scene> with_terms(const std::string& which) {
  std::string text = kGround;
  const auto put = [&](const std::string& what, const std::string& instead) {
    text.replace(text.find(what), what.size(), instead);
  };
  if (which == "All") {
    put("height_nm = 1.0", "height_nm = 3.0");
    put("[friction]",
        "[forces]\nvan_der_waals = true\n[forces.electrostatic]\ntip_bias_v = 1.0\n"
        "[forces.capillary]\nhumidity_percent = 40.0\n"
        "contact_angle_tip_deg = 20.0\ncontact_angle_sample_deg = 20.0\n[friction]");
  } else if (which != "Few") {
    put("[friction]", "[contact]\nlaw = \"" + which + "\"\n[friction]");
  }
  return scene::parse_scene(text + kBall, "ball.toml");
}

class Terms : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(ParticleOnAScan, Terms,
                         ::testing::Values("Few", "All", "jkr", "dmt", "pietrement-troyon"),
                         [](const auto& which) { return which.param.substr(0, which.param.find('-')); });

// Saved at any time, asleep, as it wakes, pushed and asleep again, and taken up by another slave, a session
// goes on to the bit: state hash, force and energies. And while the ball sleeps nothing of it changes.
TEST_P(Terms, ItsStateIsAllThatLaterStepsDependOn) {
  const auto scene = with_terms(GetParam());
  NveSlave played(scene), again(scene);
  std::vector<std::uint8_t> bytes(played.snapshot_bytes_max());
  Vec3 at = played.limits().start_pos_w_nm;
  SlaveOutput out, repeated;
  int steps = 0, asleep = 0, awake = 0;
  Vec3 lay = Vec3::Zero();
  bool slept = false;
  const std::vector<Vec3> corners = {{-50, 0, 8},   {-50, 2, -2},  {-40, 6, -2}, {-30, 0, 8},   {3, 0, 8},
                                     {3, 0, 45},    {-20, 14, 45}, {-10, 14, 8}, {-10, 14, -3}, {-45, 14, -3},
                                     {-10, 14, -3}, {-50, 5, 8},   {-50, 5, -2}};
  for (const Vec3& corner : corners) {
    const Vec3 from = at;
    const int count = static_cast<int>(std::ceil((corner - from).norm() / 0.4));
    for (int i = 1; i <= count; ++i, ++steps) {
      if (steps % 7 == 0) {
        bytes.resize(played.snapshot_bytes_max());
        bytes.resize(played.save(bytes));
        ASSERT_TRUE(again.load(bytes)) << steps;
        ASSERT_EQ(again.state_hash(), played.state_hash()) << steps;
      }
      at = from + (corner - from) * (1.0 * i / count);
      SlaveInput input;
      input.tip_target_pos_w_nm = at;
      played.step(input, kDt_s, out);
      again.step(input, kDt_s, repeated);
      ASSERT_EQ(played.state_hash(), again.state_hash()) << steps;
      ASSERT_EQ(out.force_w_nn, repeated.force_w_nn) << steps;
      ASSERT_EQ(out.energy_in_aj, repeated.energy_in_aj) << steps;
      ASSERT_EQ(out.energy_out_aj, repeated.energy_out_aj) << steps;
      const bool sleeps = played.sample().particle()->substeps == 0;
      const Vec3 lies = played.sample().particle()->particle_centre_w_nm;
      if (sleeps && slept) {
        ASSERT_EQ(lies, lay) << steps;
      }
      slept = sleeps;
      lay = lies;
      (sleeps ? asleep : awake)++;
    }
  }
  EXPECT_GT(asleep, 100);
  EXPECT_GT(awake, 50);
}

// Whatever the path, with leaps of some nm: the account is stored plus lost, and neither loss nor account runs
// backwards; every step finds its balance.
TEST_P(Terms, NoPathDrawsEnergy) {
  SlaveWalk walk(with_terms(GetParam()));
  NveSlave& slave = walk.slave();
  const double stored_at_start = slave.trace().stored_aj;
  std::uint64_t random = 31;
  const auto unit = [&] {
    random = random * 6364136223846793005u + 1442695040888963407u;
    return static_cast<double>(random >> 11) * 0x1p-52 - 1.0;
  };
  double dissipated = 0, in = 0, gave = 0;
  int touched = 0, steps = 0, without = 0;
  const auto check = [&](const SlaveOutput& out) {
    ASSERT_TRUE(is_finite(out.force_w_nn) && is_finite(out.tip_pos_w_nm));
    without += (out.fault_bits & link::kFaultNoEquilibrium) != 0;
    ++steps;
    ASSERT_NEAR(charged(out), slave.trace().stored_aj - stored_at_start + slave.trace().dissipated_aj,
                1e-9 * out.energy_in_aj + 1e-9);
    ASSERT_GE(slave.trace().dissipated_aj, dissipated);
    ASSERT_GE(out.energy_in_aj, in);
    ASSERT_GE(out.energy_out_aj, gave);
    dissipated = slave.trace().dissipated_aj;
    in = out.energy_in_aj;
    gave = out.energy_out_aj;
    touched += walk.particle().held_by_tip;
  };
  for (int loop = 0; loop < 5; ++loop) {
    for (int i = 0; i < 120; ++i) {
      Vec3 target = walk.particle().particle_centre_w_nm + Vec3(18 * unit(), 18 * unit(), 0);
      target = target.cwiseMax(Vec3(-50, -50, 0)).cwiseMin(Vec3(50, 50, 100));
      target.z() = 9 + 9 * unit();
      const Vec3 step = target - walk.at();
      walk.go_to(walk.at() + step * std::min(1.0, 3.0 / step.norm()), 3.0, check);
    }
    walk.go_to({walk.at().x(), walk.at().y(), 60}, 2.0, check);
    const SlaveOutput out = walk.go_to(slave.limits().start_pos_w_nm, 5.0, check);
    ASSERT_GE(charged(out), -1e-6) << loop;
  }
  std::printf("%d steps, %d in touch, %d without a balance, lost %.4g aJ\n", steps, touched, without,
              dissipated);
  EXPECT_GT(touched, 100);
  EXPECT_GT(dissipated, 100);
  EXPECT_EQ(without, 0);
}

}  // namespace
}  // namespace telenano::slave

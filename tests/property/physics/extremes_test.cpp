// The whole range that a scene may ask for, and steps that no hand makes: the force is a number, the branch
// is the right one, the balance holds, energy is not made.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "telenano/nve_server/physics/law/tip_sample_law.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/property/physics/extreme_samples.h"
#include "tests/source_dir.h"
#include "tests/support/md_walk.h"

namespace telenano::physics {
namespace {

using testing::log_uniform;
using testing::random_sample;
using testing::Sample;

/// What the next step's branch is, from where the last one left the tip and the ends of the two segments.
class Memory {
 public:
  explicit Memory(const oracle::MdWalk& walk) : walk_(walk) {}
  /// False if z lies so near to an end that rounding decides.
  bool move_to(long double z, long double rounding) {
    const long double end = inside_ ? walk_.leaves_inside() : walk_.leaves_outside();
    if (std::fabs(z - end) <= rounding) return false;
    inside_ = inside_ ? z > end : z > end;
    return true;
  }
  bool inside() const { return inside_; }
  void believe(bool inside) { inside_ = inside; }

 private:
  const oracle::MdWalk& walk_;
  bool inside_ = false;
};

bool is_inside(Branch branch) {
  return branch == Branch::kContact || branch == Branch::kNonContact;
}

struct Spread {
  int materials;
  int steps;
  int force_every;  ///< the oracle's bisection takes 30 us
  double tip_bias_v = 0;
};

void walk_at_random(std::uint64_t seed, const Spread& spread) {
  Random random(seed);
  long decided = 0, undecided = 0, jumps = 0;
  double lambda_least = 1e9, lambda_most = 0, deepest = 0;
  for (int material = 0; material < spread.materials; ++material) {
    Sample sample = random_sample(random, material % 2 == 0);
    sample.parameters.long_range.tip_bias_v = spread.tip_bias_v;
    // Probe and coupling in series, from the softest pair to none at all.
    const double c =
        material % 7 == 0 ? 0.0 : 1 / log_uniform(random, 0.01, 1000) + 1 / log_uniform(random, 1e-3, 1e6);
    const TipSampleLaw law(sample.parameters);
    const double unit = sample.force_nn / sample.overlap_nm;
    const oracle::MdWalk walk(sample.lambda, c * unit, sample.parameters.van_der_waals);
    lambda_least = std::min(lambda_least, sample.lambda);
    lambda_most = std::max(lambda_most, sample.lambda);
    Memory memory(walk);
    TipSampleState state;
    const double near = 0.165 + 3 * sample.overlap_nm + 3 * c * sample.force_nn;
    for (int i = 0; i < spread.steps; ++i) {
      // At the scale of the forces; anywhere within a micrometre; or to either side of the end of the
      // segment.
      double base = random.uniform(-near, near);
      if (i % 4 == 1) base = random.uniform(-1000, 5);
      if (i % 4 == 3) {
        const auto end = memory.inside() ? walk.leaves_inside() : walk.leaves_outside();
        const double off = log_uniform(random, 1e-9, 1) * (random.chance(0.5) ? 1 : -1);
        base = (static_cast<double>(end) + off) * sample.overlap_nm;
      }
      if (i % 32 == 6) base = random.uniform(0, 1e4) * (sample.overlap_nm + c * sample.force_nn);
      const Equilibrium e = law.advance(base, c, sample.radius_nm, state);
      ASSERT_EQ(e.status, SolveStatus::kOk) << sample.lambda << ' ' << c << ' ' << base;
      ASSERT_TRUE(std::isfinite(e.force_nn) && std::isfinite(e.stiffness_n_m) &&
                  std::isfinite(e.potential_aj) && std::isfinite(e.overlap_nm) &&
                  std::isfinite(e.contact_radius_nm));
      ASSERT_GE(e.dissipated_aj, 0);
      jumps += e.jumps;
      const long double z = static_cast<long double>(base) / sample.overlap_nm;
      deepest = std::max(deepest, e.overlap_nm / sample.overlap_nm);
      // Rounding: a few ulp of what makes up Z. Ends are known to the root of the long double's precision in
      // their position, which is its square in Z.
      const long double size = std::fabs(z) + std::fabs(e.overlap_nm / sample.overlap_nm) +
                               c * unit * std::fabs(e.force_nn / sample.force_nn) + walk.range();
      if (!memory.move_to(z, 1e-13L * size)) {
        ++undecided;
        memory.believe(is_inside(e.branch));
        continue;
      }
      ++decided;
      ASSERT_EQ(is_inside(e.branch), memory.inside())
          << "material " << material << " step " << i << " lambda " << sample.lambda << " c " << c * unit
          << " Z " << static_cast<double>(z) << " ends " << static_cast<double>(walk.leaves_outside()) << ' '
          << static_cast<double>(walk.leaves_inside());
      if (i % spread.force_every != 0) continue;
      const oracle::MdWalk::State exact = memory.inside() ? walk.inside(z) : walk.outside(z);
      // 1e-10 is the law's claim near folds; the rest is what a few ulp of Z do to the force.
      const double tolerance =
          static_cast<double>(1e-10L * (std::fabs(exact.load) + 2) + 2e-15L * size * exact.gain);
      ASSERT_NEAR(e.force_nn / sample.force_nn, static_cast<double>(exact.load), tolerance)
          << "material " << material << " step " << i << " lambda " << sample.lambda << " c " << c * unit
          << " Z " << static_cast<double>(z) << " inside " << memory.inside();
    }
  }
  std::printf("lambda %.3g ... %.4g, overlap to %.3g u_delta, %ld steps decided, %ld on an end, %ld jumps\n",
              lambda_least, lambda_most, deepest, decided, undecided, jumps);
  EXPECT_LT(undecided, decided / 100);
  EXPECT_GT(jumps, decided / 100);
}

// 1.2 million steps over six thousand pairs of tip and sample.
TEST(Extremes, RightBranchAndForceAnywhere) {
  walk_at_random(20260214, {6000, 200, 16});
}

// The walk that long-range forces take, with one of next to nothing, so that the oracle knows branch and
// force of it as well: 1e-11 V is 1e-20 of any adhesion here (pi eps0 V^2 R/d against pi w R), which the
// softest spring (c up to 1e7 u_delta/u_F) makes less than rounding of Z.
TEST(Extremes, LongRangeWalkTakesTheSameBranchesAnywhere) {
  walk_at_random(20260215, {1500, 200, 16, 1e-11});
}

double stored_aj(const Equilibrium& e, double compliance) {
  return e.potential_aj + 0.5 * compliance * e.force_nn * e.force_nn;
}

// Along a path without jumps, the work of the spring's base is what is stored: Gauss–Legendre quadrature of
// the force against the difference of the potentials.
TEST(Extremes, WorkIsStoredWhereNothingJumps) {
  Random random(515);
  int compared = 0;
  for (int material = 0; material < 20000; ++material) {
    const Sample sample = random_sample(random, material % 2 == 0);
    const double c =
        material % 5 == 0 ? 0.0 : 1 / log_uniform(random, 0.01, 1000) + 1 / log_uniform(random, 1e-3, 1e6);
    const TipSampleLaw law(sample.parameters);
    const double reach = sample.overlap_nm + c * sample.force_nn;
    TipSampleState state;
    // Inside: from deep contact. Outside: from far away.
    const bool inside = random.chance(0.5);
    const double from = inside ? random.uniform(0.0, 20) * reach : -0.165 - random.uniform(3, 20) * reach;
    if (inside) law.advance(30 * reach, c, sample.radius_nm, state);
    const double to = from + 0.05 * random.uniform(-1, 1) * reach;
    Equilibrium first = law.advance(from, c, sample.radius_nm, state);
    const Equilibrium last = [&] {
      TipSampleState copy = state;
      return law.advance(to, c, sample.radius_nm, copy);
    }();
    if (last.jumps > 0 || last.branch != first.branch) continue;
    constexpr double kNode[3] = {0.23861918608319690863, 0.66120938646626451366, 0.93246951420315202781};
    constexpr double kWeight[3] = {0.46791393457269104739, 0.36076157304813860757, 0.17132449237917034504};
    double work = 0;
    double greatest = 0;
    for (int i = 0; i < 6; ++i) {
      const double node = i < 3 ? kNode[i] : -kNode[i - 3];
      TipSampleState copy = state;
      const Equilibrium e =
          law.advance(0.5 * (from + to) + 0.5 * (to - from) * node, c, sample.radius_nm, copy);
      work += kWeight[i % 3] * e.force_nn * 0.5 * (to - from);
      greatest = std::max(greatest, std::fabs(e.force_nn));
    }
    // Six points over a twentieth of the scale on which the force bends leave some 1e-9 of the work; the
    // accounts hold 1e-13 of what they add up (far above the work where the contact is deep).
    const double accounts =
        std::fabs(stored_aj(first, c)) + std::fabs(stored_aj(last, c)) + sample.force_nn * reach;
    ASSERT_NEAR(stored_aj(last, c) - stored_aj(first, c), work,
                1e-8 * greatest * std::fabs(to - from) + 3e-13 * accounts)
        << "material " << material << " lambda " << sample.lambda << " inside " << inside;
    ++compared;
  }
  EXPECT_GT(compared, 15000);
}

// A jump at a base that hardly moves: what the store loses is what is counted as dissipated.
TEST(Extremes, JumpDissipatesWhatTheStoreLoses) {
  Random random(616);
  int seen = 0;
  for (int material = 0; material < 6000; ++material) {
    const Sample sample = random_sample(random, material % 2 == 0);
    const double c =
        material % 5 == 0 ? 0.0 : 1 / log_uniform(random, 0.01, 1000) + 1 / log_uniform(random, 1e-3, 1e6);
    const TipSampleLaw law(sample.parameters);
    const oracle::MdWalk walk(sample.lambda, c * sample.force_nn / sample.overlap_nm,
                              sample.parameters.van_der_waals);
    const bool retract = random.chance(0.5);
    const double end =
        static_cast<double>(retract ? walk.leaves_inside() : walk.leaves_outside()) * sample.overlap_nm;
    // Room for the rounding of the end, in nm.
    const double room = 1e-9 * (std::fabs(end) + sample.overlap_nm + c * sample.force_nn);
    const double side = retract ? 1 : -1;
    TipSampleState state;
    law.advance(retract ? 30 * (sample.overlap_nm + c * sample.force_nn) : -1e4, c, sample.radius_nm, state);
    const Equilibrium before = law.advance(end + side * room, c, sample.radius_nm, state);
    const Equilibrium after = law.advance(end - side * room, c, sample.radius_nm, state);
    ASSERT_NE(is_inside(before.branch), is_inside(after.branch)) << material << ' ' << sample.lambda;
    const double moved = 2 * room * (std::fabs(before.force_nn) + std::fabs(after.force_nn));
    const double lost = stored_aj(before, c) - stored_aj(after, c);
    const double accounts = std::fabs(stored_aj(before, c)) + sample.force_nn * sample.overlap_nm;
    ASSERT_NEAR(after.dissipated_aj, lost, moved + 1e-12 * accounts) << material << ' ' << sample.lambda;
    seen += after.jumps;
  }
  EXPECT_GT(seen, 3000);  // the others pass from van der Waals to Dugdale without a jump
}

// The whole slave on a flat sample: any scene, any tick from 100 Hz to 10 kHz, targets a micrometre apart.
TEST(Extremes, SlaveStaysSound) {
  Random random(717);
  const auto deployed =
      scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flat_silicon_oxide.toml");
  for (int trial = 0; trial < 1000; ++trial) {
    auto scene = std::make_shared<scene::Scene>(*deployed);
    const Sample sample = random_sample(random, trial % 2 == 0);
    scene->law_parameters = sample.parameters;
    scene->probe.tip_radius_nm = sample.radius_nm;
    const double probe_stiffness = log_uniform(random, 0.01, 1000);
    ProbeParameters probe;
    probe.stiffness_n_m = probe_stiffness;
    scene->cantilever = Probe(probe);
    scene->coupling.stiffness_n_m = log_uniform(random, 1e-3, 1e6);
    scene->coupling.damping_n_s_m =
        trial % 3 == 0 ? 0.0 : scene->coupling.stiffness_n_m * log_uniform(random, 1e-5, 0.1);
    // Room enough above to let go on the softest spring.
    const double compliance = 1 / probe_stiffness + 1 / scene->coupling.stiffness_n_m;
    const double top = 100 + 4 * compliance * sample.force_nn + 10 * sample.overlap_nm;
    scene->limits.workspace_max_w_nm.z() = top;
    scene->limits.speed_max_nm_s = std::max(1e5, top);
    scene->limits.force_max_nn = 2.5 * sample.force_nn * log_uniform(random, 1, 1e4);
    scene->level = std::make_shared<LevelEquilibrium>(std::make_shared<TipSampleLaw>(sample.parameters),
                                                      sample.radius_nm);
    slave::NveSlave slave(scene);
    const double dt = log_uniform(random, 1e-4, 1e-2);
    slave::SlaveInput input;
    slave::SlaveOutput last;
    const auto step = [&](double z, double dt_s) {
      input.tip_target_pos_w_nm = Vec3(random.uniform(-500, 500), random.uniform(-500, 500), z);
      slave::SlaveOutput out;
      slave.step(input, dt_s, out);
      return out;
    };
    // Far away and at rest: where the loop begins and ends.
    for (int i = 0; i < 100; ++i) last = step(top, 0.1);
    const double first_aj = last.energy_in_aj - last.energy_out_aj;
    const double first_rest_aj = slave.trace().stored_aj;
    const double first_dissipated_aj = slave.trace().dissipated_aj;
    double stored_most = std::fabs(first_rest_aj);
    for (int i = 0; i < 60; ++i) {
      // At the limit of 100 um/s a tick of 10 ms moves a micrometre: the whole workspace in one step.
      const slave::SlaveOutput out = step(i % 2 == 0 ? random.uniform(-60, 100) : random.uniform(-2, 5), dt);
      ASSERT_TRUE(is_finite(out.force_w_nn) && is_finite(out.tip_pos_w_nm) &&
                  std::isfinite(out.energy_in_aj) && std::isfinite(out.energy_out_aj))
          << trial << ' ' << i;
      ASSERT_EQ(out.fault_bits & link::kFaultNoEquilibrium, 0u) << trial << ' ' << i << ' ' << sample.lambda;
      ASSERT_LE(out.force_w_nn.z(), scene->limits.force_max_nn * (1 + 1e-12)) << trial << ' ' << i;
      // No adhesion exceeds van der Waals' at its cut-off.
      ASSERT_GE(out.force_w_nn.z(), -2.0000001 * sample.force_nn) << trial << ' ' << i;
      ASSERT_GE(out.energy_in_aj, last.energy_in_aj);
      ASSERT_GE(out.energy_out_aj, last.energy_out_aj);
      // The account: what went in and not out again is stored or dissipated.
      const auto& trace = slave.trace();
      stored_most =
          std::max({stored_most, std::fabs(trace.stored_aj), trace.dissipated_aj, out.energy_in_aj});
      ASSERT_GE(trace.dissipated_aj, 0);
      last = out;
    }
    // Let go, and back at rest far away: nothing more is in the springs, and what went in is dissipated.
    for (int i = 0; i < 100; ++i) last = step(top, 0.1);
    const double loop_aj = last.energy_in_aj - last.energy_out_aj - first_aj;
    const double rounding = 1e-12 * stored_most;
    ASSERT_NEAR(slave.trace().stored_aj, first_rest_aj, rounding + 1e-6 * std::fabs(first_rest_aj)) << trial;
    ASSERT_NEAR(loop_aj,
                slave.trace().dissipated_aj - first_dissipated_aj + slave.trace().stored_aj - first_rest_aj,
                rounding)
        << trial;
    ASSERT_GE(loop_aj, -rounding - 1e-6 * std::fabs(first_rest_aj)) << trial;
  }
}

}  // namespace
}  // namespace telenano::physics

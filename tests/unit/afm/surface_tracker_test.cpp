// W's zero from touches now and then, beside a surface whose true height is known: drift that goes up and
// down, walks at random, changes at once, or stays; creep of any size and time; touches with noise.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/random.h"
#include "telenano/nve_server/afm/surface_tracker.h"

namespace telenano::afm {
namespace {

constexpr double kTick_s = 0.02;
constexpr double kNoise_nm = 0.06;  // of one touch: 2 nN at 35 N/m

enum class Drift : std::uint8_t { kWave, kWalk, kConstant, kJumps };

/// The truth: H = drift + creep of the piezo.
struct Rig {
  Rig(Drift kind_wanted, std::uint64_t seed) : kind(kind_wanted), random(seed) {
    sign = random.chance(0.5) ? 1 : -1;
    speed_nm_s = sign * random.uniform(0.05, 0.5);
    period_s = random.uniform(100, 900);
    phase = random.uniform(0, 6);
    creep = random.uniform(0, 0.0045);
    creep_s = det_exp(random.uniform(det_log(6.0), det_log(60.0)));
  }
  void step(double piezo_nm) {
    if (ns == 0) late_nm = first_nm = piezo_nm;
    ns += static_cast<std::int64_t>(kTick_s * 1e9);
    const double t_s = 1e-9 * static_cast<double>(ns);
    if (kind == Drift::kWave) {
      speed_nm_s = sign * (0.275 + 0.225 * det_sin_cos(2 * std::numbers::pi * t_s / period_s + phase).sin);
    } else if (kind == Drift::kWalk) {
      double size = std::fabs(speed_nm_s + 0.012 * std::sqrt(kTick_s) * random.normal());
      if (size > 0.5) size = 1 - size;
      speed_nm_s = sign * std::max(size, 0.1 - size);
    } else if (kind == Drift::kJumps && random.chance(kTick_s / 200)) {
      speed_nm_s = sign * random.uniform(0.05, 0.5);
    }
    drift_nm += kTick_s * speed_nm_s;
    late_nm += (piezo_nm - late_nm) * kTick_s / creep_s;
    tracker.piezo(piezo_nm, ns);
  }
  void run(double seconds, double piezo_nm) {
    for (double t = 0; t < seconds; t += kTick_s) step(piezo_nm);
  }
  double height_nm() const { return drift_nm - creep * (late_nm - first_nm); }
  double off_nm() const { return height_nm() - tracker.height_nm(ns); }
  double touched_nm() { return height_nm() + kNoise_nm * random.normal(); }
  void touch(double x_nm = 0, double y_nm = 0, double ground_nm = 0) {
    tracker.touch(x_nm, y_nm, touched_nm() + ground_nm, 0, ns);
  }
  /// As an approach is: down over half the piezo's range, two touches.
  void approach() {
    run(1, 450);
    for (double at = 450; at > 0; at -= 16) step(at);
    run(2, 25);
    tracker.begin(0, 0, touched_nm(), ns);
    run(2.3, 20);
    touch();
  }

  Drift kind;
  Random random;
  SurfaceTracker tracker;
  double sign = 1, speed_nm_s = 0, period_s = 0, phase = 0, creep = 0, creep_s = 1;
  double drift_nm = 0, late_nm = 0, first_nm = 0;
  std::int64_t ns = 0;
};

struct Share {
  long within = 0, all = 0;
  void add(const Rig& rig) {
    ++all;
    if (std::fabs(rig.off_nm()) <= rig.tracker.bound_nm(rig.ns)) ++within;
  }
  double part() const { return static_cast<double>(within) / static_cast<double>(all); }
};

TEST(SurfaceTracker, HoldsTheZeroWithinTwoNanometresAndItsBoundCoversTheTruth) {
  constexpr int kSeeds = 150;
  for (const auto& [kind, name] : {std::pair{Drift::kWave, "wave"}, std::pair{Drift::kWalk, "walk"},
                                   std::pair{Drift::kConstant, "constant"}}) {
    double worst_nm = 0, bound_nm = 0;
    Share touched, in_air;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      Rig rig(kind, static_cast<std::uint64_t>(seed));
      rig.approach();
      for (double t_s = 0; t_s < 600;) {
        const double pause_s = rig.random.uniform(3, 10);
        for (double u = 0; u < pause_s; u += 0.5) {
          rig.run(0.5, rig.tracker.height_nm(rig.ns) + 5);
          worst_nm = std::max(worst_nm, std::fabs(rig.off_nm()));
          bound_nm = std::max(bound_nm, rig.tracker.bound_nm(rig.ns));
          touched.add(rig);
        }
        rig.touch();
        t_s += pause_s;
      }
      // Two minutes without any touch.
      for (int i = 0; i < 240; ++i) {
        rig.run(0.5, rig.tracker.height_nm(rig.ns) + 5);
        in_air.add(rig);
      }
    }
    std::printf("%s, %d rigs: off by %.2f nm at most, bound %.2f nm; covered %.1f %%, in the air %.1f %%\n",
                name, kSeeds, worst_nm, bound_nm, 100 * touched.part(), 100 * in_air.part());
    EXPECT_LE(worst_nm, 2) << name;
    EXPECT_GE(touched.part(), 0.95) << name;
    EXPECT_GE(in_air.part(), 0.95) << name;
    EXPECT_LE(bound_nm, 5) << name << ": a bound that says nothing covers everything";
  }
}

// A heating that goes on and off is no promise of 2 nm, but still one of the bound.
TEST(SurfaceTracker, TheBoundCoversADriftThatJumps) {
  Share share;
  for (std::uint64_t seed = 1; seed <= 150; ++seed) {
    Rig rig(Drift::kJumps, seed);
    rig.approach();
    for (double t_s = 0; t_s < 600; t_s += 8) {
      for (int i = 0; i < 16; ++i) {
        rig.run(0.5, rig.tracker.height_nm(rig.ns) + 5);
        share.add(rig);
      }
      rig.touch();
    }
  }
  EXPECT_GE(share.part(), 0.95);
}

// What creeps after an approach is not taken for what goes on: without drift the first half minute's touches
// leave next to none of it, though the surface moves by a nanometre and more.
TEST(SurfaceTracker, CreepIsToldFromDrift) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Rig rig(Drift::kConstant, seed);
    rig.speed_nm_s = 0;
    rig.creep = 0.004;
    rig.creep_s = 20;
    rig.approach();
    const double from_nm = rig.height_nm();
    for (int i = 0; i < 5; ++i) {
      rig.run(6, 20);
      rig.touch();
    }
    EXPECT_GT(std::fabs(rig.height_nm() - from_nm), 0.9) << "else nothing is shown";
    EXPECT_LE(std::fabs(rig.tracker.drift_nm_s()), rig.tracker.drift_bound_nm_s()) << seed;
    rig.run(30, 20);
    EXPECT_LE(std::fabs(rig.off_nm()), rig.tracker.bound_nm(rig.ns)) << seed;
  }
}

// The zero is that of the start; who never comes back there is led by the other places.
TEST(SurfaceTracker, OtherPlacesCarryTheZero) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Rig rig(Drift::kWave, seed);
    rig.approach();
    const double ground_nm[] = {3, -7, 12};
    for (int i = 0; i < 60; ++i) {
      rig.run(5, rig.tracker.height_nm(rig.ns) + 20);
      rig.touch(100.0 * (1 + i % 3), 40, ground_nm[i % 3]);
    }
    EXPECT_LE(std::fabs(rig.off_nm()), 2.5) << seed;
    EXPECT_LE(std::fabs(rig.off_nm()), 1.5 * rig.tracker.bound_nm(rig.ns)) << seed;
  }
}

// A tip that has lost its end touches 6 nm lower: that is where the surface is from then on.
TEST(SurfaceTracker, AShorterTipIsBelieved) {
  Rig rig(Drift::kConstant, 5);
  rig.approach();
  for (int i = 0; i < 10; ++i) {
    rig.run(5, 20);
    rig.touch();
  }
  rig.touch(0, 0, -6);
  EXPECT_NEAR(rig.off_nm(), 6, 0.5);
  EXPECT_LT(std::fabs(rig.tracker.drift_nm_s() - rig.speed_nm_s), 0.1) << "and is no drift";
}

}  // namespace
}  // namespace telenano::afm

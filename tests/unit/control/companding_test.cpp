// Forces before contact, companded: the sum over closed paths, what is owed, and what a hand can gain at most.
// The oracle is the sum of G over a path itself, of a potential that is written down here.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/common/base/vec3.h"
#include "telenano/common/control/companding.h"

namespace telenano::control {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// A sphere's attraction to a ground with hills: U = -C/d, d the height over the hill.
constexpr double kC = 1.3;  // aJ nm
double height(const Vec3& x) {
  return x.z() - 0.3 * std::sin(0.5 * x.x()) * std::cos(0.4 * x.y());
}
double energy(const Vec3& x) {
  return -kC / height(x);
}
Vec3 force(const Vec3& x) {
  const double d = height(x), by = -kC / (d * d);
  return by * Vec3(-0.15 * std::cos(0.5 * x.x()) * std::cos(0.4 * x.y()),
                   0.12 * std::sin(0.5 * x.x()) * std::sin(0.4 * x.y()), 1);
}
/// A closed way in three dimensions, down to 0.6 nm.
Vec3 loop(double turn) {
  const double a = 2 * kPi * turn;
  return {4 * std::sin(a), 3 * std::sin(2 * a + 0.4), 2 + 1.1 * std::cos(a) + 0.2 * std::sin(3 * a)};
}

struct Sums {
  double closed = 0, turnover = 0, greatest = 0;
};
Sums round(const std::function<Vec3(const Vec3&)>& shown, int steps) {
  Sums sums;
  Vec3 last_x = loop(0), last_f = shown(last_x);
  for (int i = 1; i <= steps; ++i) {
    const Vec3 x = loop(static_cast<double>(i) / steps), f = shown(x);
    const double work = 0.5 * (last_f + f).dot(x - last_x);
    sums.closed += work;
    sums.turnover += std::fabs(work);
    sums.greatest = std::max(sums.greatest, f.norm());
    last_x = x;
    last_f = f;
  }
  return sums;
}

Companding with(double gain, double energy_aj) {
  Companding companding;
  companding.configure({gain, energy_aj});
  return companding;
}

TEST(Companding, IsNothingToTheBitWhereItIsOff) {
  Companding off;
  Random random(3);
  for (int i = 0; i < 1000; ++i) {
    const double brought = random.uniform(-3, 3);
    EXPECT_EQ(off.step(random.uniform(-5, 1), brought, random.chance(0.2)), brought);
    EXPECT_EQ(off.gain(), 1.0);
  }
}

// Trapezia over chords err by the square of the step: 4e-7 of the turnover at 4000 steps, 2e-9 at 64 000.
TEST(Companding, AClosedPathGivesNothingInThreeDimensions) {
  for (const double gain : {2.0, 5.0, 10.0}) {
    for (const double energy_aj : {0.1, 1.0, 10.0}) {
      Companding companding = with(gain, energy_aj);
      const auto shown = [&, last = 0.0](const Vec3& x) mutable {
        companding.step(energy(x), energy(x) - last, false);
        last = energy(x);
        return Vec3(companding.gain() * force(x));
      };
      const Sums sums = round(shown, 64000);
      EXPECT_LT(std::fabs(sums.closed), 2e-8 * sums.turnover) << gain << ' ' << energy_aj;
    }
  }
  // What is often done instead, a gain by the force's magnitude or by component, is no gradient: the same test
  // finds it out.
  const auto by_norm = [](const Vec3& x) {
    const Vec3 f = force(x);
    return Vec3(f * (1 + 4 / (1 + f.norm())));
  };
  const auto by_component = [](const Vec3& x) {
    Vec3 f = force(x);
    for (double& c : f) c *= 1 + 4 / (1 + std::fabs(c));
    return f;
  };
  EXPECT_GT(std::fabs(round(by_norm, 4000).closed), 1e-6 * round(by_norm, 4000).turnover);
  EXPECT_GT(std::fabs(round(by_component, 4000).closed), 1e-6 * round(by_component, 4000).turnover);
}

TEST(Companding, ShowsASpheresAttractionEverStrongerAndWithinItsGain) {
  Companding companding = with(5, 1);
  double last = 0;
  for (double d = 50; d > 0.05; d *= 0.99) {
    const double u = -kC / d;
    companding.step(u, 0, false, true);
    const double pull = kC / (d * d), shown = companding.gain() * pull;
    EXPECT_GT(shown, last) << d;
    EXPECT_GE(companding.gain(), 1.0);
    EXPECT_LE(companding.gain(), 5.0);
    // psi' by finite difference of psi, which is written down once more.
    const auto psi = [](double v) { return v + 4 * v / (1 + std::fabs(v)); };
    EXPECT_NEAR(companding.gain(), (psi(u + 1e-6) - psi(u - 1e-6)) / 2e-6, 1e-8);
    last = shown;
  }
}

// Every step brings what psi of its states says, however far it goes, and in contact what it brings by itself.
TEST(Companding, TheAccountIsPsi) {
  const double gain = 6, energy_aj = 0.7;
  const auto psi = [&](double v) { return v < 0 ? v + (gain - 1) * v / (1 - v / energy_aj) : v; };
  Companding companding = with(gain, energy_aj);
  Random random(11);
  double u = -0.01, sum = 0;
  companding.step(u, 0, false);
  const double begin = psi(u);
  for (int i = 0; i < 2000; ++i) {
    const double next = random.uniform(-4, 0.5);
    sum += companding.step(next, next - u, false);
    u = next;
    ASSERT_NEAR(sum, psi(u) - begin, 1e-11) << i;
    ASSERT_NEAR(companding.owed_aj(), companding.excess(u), 1e-11);
  }
  EXPECT_EQ(companding.step(-30, -30 - u, true), -30 - u);
  EXPECT_EQ(companding.gain(), 1.0);
}

// Any sequence of states, contacts, losses, jumps and changes of the setting: what the port has brought, less
// what is stored, is never below -(g - 1) U0.
TEST(Companding, NoSequenceGainsMoreThanItsWell) {
  double least = 0;
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    Random random(seed);
    Companding companding = with(10, 1);
    double u = 0, companded = 0;
    bool contact = false;
    companding.step(u, 0, false);
    for (int i = 0; i < 500; ++i) {
      if (random.chance(0.02)) companding.configure({random.uniform(1, 10), random.uniform(0.2, 1)});
      if (random.chance(0.1)) contact = !contact;
      const double next = contact ? random.uniform(-20, 5) : random.uniform(-3, 0.2);
      const double lost = random.chance(0.3) ? random.uniform(0, seed % 3 == 0 ? 0.0 : 0.5) : 0;
      // What the port brings is what is stored more, and what is lost: a conservative sample, and a lossy one.
      companded += companding.step(next, next - u + lost, contact);
      u = next;
      least = std::min(least, companded - u);
    }
  }
  EXPECT_GE(least, -9.0 - 1e-9);
  EXPECT_LT(least, -5.0) << "the attack takes what there is to take";
  std::printf("least %.4g aJ of -9 promised\n", least);
}

// In at a deep place, along the ground in contact, out at a shallow one, without any loss: again and again.
TEST(Companding, ABranchThatIsLeftElsewhereGivesNothingMore) {
  Companding companding = with(5, 1);
  double u = 0, sum = 0;
  std::vector<double> after;
  const auto go = [&](double to, bool contact) {
    constexpr int kSteps = 50;
    const double from = u;
    for (int i = 1; i <= kSteps; ++i) {
      const double next = from + (to - from) * i / kSteps;
      sum += companding.step(next, next - u, contact);
      u = next;
    }
  };
  companding.step(0, 0, false);
  for (int round = 0; round < 20; ++round) {
    go(-5, false);
    go(-0.2, true);
    go(0, false);
    after.push_back(sum);
  }
  // Once, (g - 1)(5/6 - 0.2/1.2) at most; then nothing more, and never below the well.
  for (std::size_t i = 1; i < after.size(); ++i) EXPECT_GE(after[i], after[i - 1] - 1e-12) << i;
  EXPECT_GE(*std::min_element(after.begin(), after.end()), -4.0);
}

TEST(Companding, WhatIsOwedIsPaidByWhatTheSampleDissipates) {
  Companding companding = with(5, 1);
  companding.step(0, 0, false);
  companding.step(-2, -2, false);
  companding.step(-10, -8, true);
  EXPECT_GT(companding.owed_aj(), 2);
  companding.step(-10, 1, true);  // rubbed
  companding.step(-10, 5, true);
  EXPECT_EQ(companding.owed_aj(), 0.0);
}

TEST(Companding, AnotherStateIsNoExchange) {
  Companding companding = with(5, 1);
  companding.step(0, 0, false);
  companding.step(-1, -1, false);
  const double owed = companding.owed_aj();
  EXPECT_EQ(companding.step(-0.1, 7, false, true), 7.0);
  EXPECT_EQ(companding.owed_aj(), owed);
  EXPECT_EQ(companding.gain(), 1.0) << "until what was given there has come up again";
}

}  // namespace
}  // namespace telenano::control

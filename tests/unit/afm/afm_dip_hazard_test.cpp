// A deflection signal that shows less force than there is, for tens of milliseconds: a cable, light on the
// photodiode, hum. The force is the simulated rig's own.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/base/random.h"
#include "tests/support/virtual_afm_slave.h"
#include "tests/unit/afm/afm_bench.h"
#include "tests/unit/afm/step_scene.h"

namespace telenano::afm {
namespace {

constexpr double kMost_nn = 305;  // of 300: noise, thermal bending since the tare, drift in 60 ms

/// Silicon oxide under a lever of so many N/m.
std::shared_ptr<const scene::Scene> oxide_under(double lever_n_m) {
  return scene::parse_scene(R"(name = "silicon_oxide"
[sample]
name = "silicon oxide"
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "flat"
[probe]
tip_radius_nm = 20.0
stiffness_n_m = )" + std::to_string(lever_n_m) +
                                R"(
[probe.tip]
name = "silicon"
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[forces]
van_der_waals = true
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 500.0
speed_max_nm_s = 100000.0
retract_speed_nm_s = 1000.0
top_nm = 300.0
depth_nm = 300.0
half_width_nm = 5000.0
rate_max_hz = 8000
[start]
x_nm = 0.0
y_nm = 0.0
height_nm = 20.0
)",
                            "a lever over silicon oxide");
}

/// Both levers, both signs of Z, two rates of readings, each after its approach: in the air, and held by the
/// limit with a hand that wants to press far more.
struct Held {
  std::string name;
  Bench in_air, held;
};

constexpr double kFar_nm = -240;

std::vector<Held> rigs() {
  std::vector<Held> all;
  for (const double lever_n_m : {2.0, 40.0}) {
    for (const int sign : {1, -1}) {
      for (const double rate_hz : {200.0, 1000.0}) {
        Bench b;
        b.config.spring_constant_n_m = lever_n_m;
        b.config.force_rate_hz = rate_hz;
        b.config.depth_nm = 250;
        b.config.lift_nm = 40;  // the soft one sticks for 20 nm
        b.config.z_sign = b.rig.z_sign = sign;
        b.config.sensitivity_nm_v = b.rig.deflection_nm_v = sign * 50;
        b.rig.acquisition_s = 1 / rate_hz;
        b.rig.seed = all.size() + 1;
        b.afm.emplace(b.config, b.rig, oxide_under(lever_n_m), all.size() + 1);
        EXPECT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
        b.follow(Vec3(0, 0, 10));
        b.run(500);
        Held rig{std::to_string(static_cast<int>(lever_n_m)) + " N/m, z_sign " + std::to_string(sign) + ", " +
                     std::to_string(static_cast<int>(rate_hz)) + " readings/s",
                 b, b};
        rig.held.follow(Vec3(0, 0, kFar_nm));
        rig.held.run(1500);
        EXPECT_EQ(rig.held.phase(), Phase::kFollowing) << rig.held.afm->logic().news();
        EXPECT_GT(rig.held.afm->controller().tip().normal_force_nn(), 295) << rig.name;
        all.push_back(std::move(rig));
      }
    }
  }
  return all;
}

/// Of the signal, nm, at a time in s from now on.
using Offset = std::function<double(double)>;

/// The greatest true force while the signal is off by so much, in steps of half a millisecond.
double peak_nn(Bench& b, double seconds, const Offset& offset_nm) {
  b.afm->controller().tip().forget_peak();
  const std::int64_t begin_ns = b.afm->now_ns();
  while (b.afm->now_ns() < begin_ns + static_cast<std::int64_t>(1e9 * seconds)) {
    b.afm->controller().set_photodiode(1, offset_nm(1e-9 * static_cast<double>(b.afm->now_ns() - begin_ns)));
    b.wish.time_ns = b.afm->now_ns();
    b.afm->advance_to(b.afm->now_ns() + kMs / 2, b.wish);
  }
  b.afm->controller().set_photodiode(1, 0);
  return b.afm->controller().tip().peak_force_nn();
}

Offset dip(double depth_nm, double from_s, double length_s) {
  return [=](double t_s) { return t_s >= from_s && t_s < from_s + length_s ? -depth_nm : 0; };
}

TEST(AfmHazards, ASignalThatDipsLetsTheTipNoDeeper) {
  struct Fault {
    const char* name;
    std::function<Offset(double)> at;  // begins then, in s
  };
  const auto hum = [](double hz) {
    return [hz](double phase_s) -> Offset {
      return [=](double t_s) { return 2 * std::sin(2 * std::numbers::pi * hz * (t_s - phase_s)); };
    };
  };
  const auto dips = [](double depth_nm, double length_s) {
    return [=](double from_s) { return dip(depth_nm, from_s, length_s); };
  };
  const std::vector<Fault> faults{
      {"none", [](double) -> Offset { return [](double) { return 0.0; }; }},
      {"4 nm for 12 ms", dips(4, 0.012)},
      {"4 nm for 30 ms", dips(4, 0.03)},
      {"8 nm for 12 ms", dips(8, 0.012)},
      {"8 nm for 30 ms", dips(8, 0.03)},
      {"6 nm for 2 ms, ten times a second",
       [](double from_s) -> Offset {
         return [=](double t_s) { return t_s > from_s && std::fmod(t_s - from_s, 0.1) < 0.002 ? -6.0 : 0.0; };
       }},
      {"hum of 2 nm, 50 Hz", hum(50)},
      {"hum of 2 nm, 47 Hz", hum(47)},
      {"hum of 2 nm, 100 Hz", hum(100)},
  };
  Random random(5);
  const std::vector<Held> all = rigs();
  for (const Fault& fault : faults) {
    double worst_nn = 0;
    int withdrawn = 0, runs = 0;
    for (const Held& rig : all) {
      for (int i = 0; i < 4; ++i, ++runs) {
        Bench b = rig.held;
        const double nn = peak_nn(b, 0.5, fault.at(0.05 + random.uniform(0, 0.02)));
        worst_nn = std::max(worst_nn, nn);
        withdrawn += b.phase() == Phase::kFollowing ? 0 : 1;
        EXPECT_LE(nn, kMost_nn) << fault.name << "; " << rig.name << "; " << b.afm->logic().news();
      }
    }
    std::printf("%s: at most %.1f nN of 300; %d of %d withdrawn\n", fault.name, worst_nn, withdrawn, runs);
  }
}

/// A row of one to four dips of 2 to 50 ms, to 10 nm deep, each made of pieces that rest, fall and rise, with
/// `gap_s` or more of a true signal between them.
Offset random_dips(Random& random, double gap_s) {
  std::vector<std::pair<double, double>> points{{0, 0}};  // s, nm
  double t_s = random.uniform(0, 0.15);
  for (int n = 1 + static_cast<int>(random.below(4)); n > 0; --n) {
    const double length_s = random.uniform(0.002, 0.05), depth_nm = random.uniform(0, 10);
    points.emplace_back(t_s, 0);
    std::vector<double> within{0, 1};
    for (std::uint64_t i = random.below(4); i > 0; --i) within.push_back(random.uniform());
    std::sort(within.begin(), within.end());
    for (const double part : within) points.emplace_back(t_s + part * length_s, -depth_nm * random.uniform());
    points.emplace_back(t_s + length_s, 0);
    t_s += length_s + gap_s + random.uniform(0, 0.1);
  }
  const bool ramps = random.chance(0.5);
  return [points, ramps](double at_s) {
    const auto next =
        std::find_if(points.begin(), points.end(), [&](const auto& p) { return p.first > at_s; });
    if (next == points.end()) return 0.0;
    const auto& [from_s, from_nm] = *(next - 1);
    if (!ramps) return from_nm;
    return from_nm + (next->second - from_nm) * (at_s - from_s) / (next->first - from_s);
  };
}

TEST(AfmHazards, NoDipOfFiftyMillisecondsLetsTheTipDeeperWhateverTheHandDoes) {
  constexpr int kRuns = 200;
  const std::vector<Held> all = rigs();
  double worst_nn = 0;
  int withdrawn = 0, pressed = 0;
  for (int seed = 1; seed <= kRuns; ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    const Held& rig = all[random.below(all.size())];
    const bool at_rest = random.chance(0.5);
    Bench b = at_rest ? rig.held : rig.in_air;
    // Down, and perhaps up and down again.
    const double up_s = at_rest ? 10 : random.uniform(0.05, 0.6), up_nm = random.uniform(-8, 10);
    const double down_s = up_s + random.uniform(0.01, 0.2);
    const Offset offset = random_dips(random, 3 * b.config.period_s());
    b.follow(Vec3(0, 0, kFar_nm));
    const double nn = peak_nn(b, 1, [&](double t_s) {
      b.wish.target_w_nm.z() = t_s > up_s && t_s < down_s ? up_nm : kFar_nm;
      return offset(t_s);
    });
    worst_nn = std::max(worst_nn, nn);
    withdrawn += b.phase() == Phase::kFollowing ? 0 : 1;
    pressed += nn > 290 ? 1 : 0;
    EXPECT_LE(nn, kMost_nn) << "seed " << seed << "; " << rig.name << (at_rest ? "; at rest" : "; moving")
                            << "; " << b.afm->logic().news();
  }
  std::printf("%d random dips: at most %.1f nN of 300; %d withdrawn, %d pressed to the limit\n", kRuns,
              worst_nn, withdrawn, pressed);
  EXPECT_GT(pressed, kRuns / 2);
}

TEST(AfmHazards, AReadingThatIsTooHighHoldsTheTipUpForSixtyMilliseconds) {
  for (const Held& rig : rigs()) {
    SCOPED_TRACE(rig.name);
    Bench b = rig.held;
    const double k = b.config.spring_constant_n_m;
    const double before_nm = b.afm->logic().state().base_w_nm.z();
    // By a force that the trip lets pass.
    const double high_nm = 0.5 * (b.afm->logic().force_trip_nn() - 300) / k;
    const double length_s = std::max(b.config.period_s(), 0.002);
    double up_s = 0, back_s = 0;
    peak_nn(b, 0.3, [&](double t_s) {
      const double by_nm = b.afm->logic().state().base_w_nm.z() - before_nm;
      if (by_nm > 0.5 * high_nm && up_s == 0) up_s = t_s;
      if (by_nm < 0.5 * high_nm && up_s > 0 && back_s == 0) back_s = t_s;
      return t_s < length_s ? high_nm : 0;
    });
    EXPECT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
    EXPECT_GT(up_s, 0);
    EXPECT_GT(back_s - up_s, 0.05);
    EXPECT_LE(back_s - up_s, 0.06 + b.config.period_s());
    EXPECT_GT(b.afm->controller().tip().normal_force_nn(), 295) << "and down again";
  }
}

TEST(AfmHazards, DownToTheGroundThatIsKnownTheTipFallsAsFastAsTheNewestReadingLetsIt) {
  for (const Held& rig : rigs()) {
    SCOPED_TRACE(rig.name);
    Bench b = rig.in_air;
    b.follow(Vec3(0, 0, 50));
    b.run(500);
    b.follow(Vec3(0, 0, kFar_nm));
    b.run(150);
    // 7.5 nm in each 60 ms would be 31 nm higher.
    EXPECT_LT(b.afm->logic().state().base_w_nm.z(), 3);
  }
}

TEST(AfmHazards, WhoLiftsTheTipAndPressesAgainIsNotHeldUp) {
  for (const Held& rig : rigs()) {
    SCOPED_TRACE(rig.name);
    Bench b = rig.held;
    for (const auto& [up_nm, up_ms] : {std::pair{10.0, 400}, std::pair{-2.0, 10}, std::pair{10.0, 30}}) {
      b.follow(Vec3(0, 0, up_nm));
      b.run(up_ms);
      const double way_nm = b.afm->logic().state().base_w_nm.z() + 300 / b.config.spring_constant_n_m + 10;
      b.follow(Vec3(0, 0, kFar_nm));
      EXPECT_LE(peak_nn(b, 0.1 + way_nm / 100, [](double) { return 0; }), kMost_nn);
      EXPECT_EQ(b.phase(), Phase::kFollowing) << b.afm->logic().news();
      EXPECT_GT(b.afm->controller().tip().normal_force_nn(), 295);
    }
  }
}

// What stays open: no reading of the last 60 ms tells of a dip that is longer, of hum that is slower, or of ground
// that was never touched and lies higher, where the dip begins in the air.
TEST(AfmHazards, ALongerDipAndAHillThatWasNotTouchedStayOpen) {
  double dip_nn = 0, hum_nn = 0;
  for (const Held& rig : rigs()) {
    Bench dips = rig.held, hums = rig.held;
    dip_nn = std::max(dip_nn, peak_nn(dips, 0.5, dip(8, 0.05, 0.1)));
    hum_nn = std::max(
        hum_nn, peak_nn(hums, 1, [](double t_s) { return 2 * std::sin(2 * std::numbers::pi * 3 * t_s); }));
  }
  double hill_nn = 0;
  for (int i = 0; i < 20; ++i) {
    Bench b;
    b.rig.seed = static_cast<std::uint64_t>(i) + 1;
    b.afm.emplace(b.config, b.rig, with_a_step(10));
    ASSERT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
    for (const double x_nm : {0.0, 110.0}) {  // the step is 60 nm away
      b.follow(Vec3(x_nm, 0, 35));
      b.run(600);
    }
    b.follow(Vec3(110, 0, -30));
    hill_nn = std::max(hill_nn, peak_nn(b, 0.5, dip(8, 0.01 * i, 0.05)));
  }
  std::printf(
      "a dip of 8 nm for 100 ms: %.0f nN of 300; hum of 2 nm, 3 Hz: %.0f nN; landing on a hill of 10 nm: "
      "%.0f nN\n",
      dip_nn, hum_nn, hill_nn);
  for (const double nn : {dip_nn, hum_nn, hill_nn}) EXPECT_GT(nn, kMost_nn) << "so much is open";
}

/// What a station would show of a press to where the rig feels 280 nN and back, each millisecond.
std::vector<double> felt_nn(double limit_nn, double speed_nm_s, double depth_nm, double& peak) {
  AfmConfig config;
  config.force_max_nn = limit_nn;
  Bench b;
  b.config = config;
  b.start();
  EXPECT_TRUE(b.until(Phase::kFollowing)) << b.afm->logic().refusal() << b.afm->logic().news();
  b.follow(Vec3(0, 0, 10));
  b.run(500);
  support::VirtualAfmSlave slave(*b.afm);
  slave.afm().controller().tip().forget_peak();
  slave::SlaveInput input;
  slave::SlaveOutput output;
  input.follow = true;
  input.by_operator = true;
  std::vector<double> felt;
  const double way_nm = 10 - depth_nm;
  for (double t_s = 0; t_s < 2 * way_nm / speed_nm_s + 0.5; t_s += 1e-3) {
    const double gone_nm = std::min(t_s * speed_nm_s, way_nm);
    const double back_nm = std::max(0.0, (t_s - way_nm / speed_nm_s - 0.5) * speed_nm_s);
    input.tip_target_pos_w_nm = Vec3(0, 0, 10 - gone_nm + back_nm);
    slave.step(input, 0.001, output);
    felt.push_back(output.force_w_nn.z());
  }
  peak = slave.afm().controller().tip().peak_force_nn();
  return felt;
}

TEST(AfmHazards, APressToJustBelowTheLimitIsFeltAsIfThereWereNone) {
  for (const double speed_nm_s : {10.0, 40.0}) {
    double peak = 0, free_peak = 0;
    constexpr double kDepth_nm = -7.85;
    const std::vector<double> with = felt_nn(300, speed_nm_s, kDepth_nm, peak);
    const std::vector<double> without = felt_nn(900, speed_nm_s, kDepth_nm, free_peak);
    ASSERT_EQ(with.size(), without.size());
    double squares = 0, all = 0;
    for (std::size_t i = 0; i < with.size(); ++i) {
      squares += (with[i] - without[i]) * (with[i] - without[i]);
      all += without[i] * without[i];
    }
    std::printf("%g nm/s: NRMSE %.5f, true peaks %.1f and %.1f nN\n", speed_nm_s, std::sqrt(squares / all),
                peak, free_peak);
    EXPECT_LE(std::sqrt(squares / all), 0.003) << speed_nm_s;
  }
}

TEST(BoundHistory, KeepsTheHighestOfThoseThatAreNoOlder) {
  Random random(2);
  for (const double period_ms : {0.1, 0.5, 1.0, 5.0, 200.0}) {
    BoundHistory history;
    std::vector<std::pair<std::int64_t, double>> all;
    std::int64_t time_ns = 0;
    for (int i = 0; i < 3000; ++i) {
      time_ns += static_cast<std::int64_t>(random.uniform(0.5, 1.5) * period_ms * 1e6);
      // Now and then a long fall, which none of its bounds is spared in.
      const double bound_nm = i % 1000 < 300 ? -i : random.uniform(-5, 5);
      history.add(time_ns, bound_nm, 60 * kMs);
      all.emplace_back(time_ns, bound_nm);
      double highest_nm = -1e300;
      for (const auto& [then_ns, nm] : all)
        if (then_ns >= time_ns - 60 * kMs) highest_nm = std::max(highest_nm, nm);
      // More than it has room for: it may keep a higher one for longer.
      if (period_ms >= 1) {
        ASSERT_EQ(history.highest_nm(), highest_nm) << i;
      } else {
        ASSERT_GE(history.highest_nm(), highest_nm) << i;
      }
    }
    history.clear();
    EXPECT_LT(history.highest_nm(), -1e299);
  }
}

}  // namespace
}  // namespace telenano::afm

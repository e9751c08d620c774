// Sessions on a sample that keeps marks, its ground one potential. Oracles: Thornton's closed form for a
// dent, the hardness times the displaced volume, the work of the commanded end summed by the trapezium rule,
// the volume of the heights that a viewer sees.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/equilibrium/marked_potential.h"
#include "telenano/nve_server/physics/surface/mark_journal.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"

namespace telenano::slave {
namespace {

constexpr double kSpeed_nm_s = 1000;

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const auto at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

std::string lithography_text(double half_width_nm = 60) {
  std::ifstream file(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/lithography.toml");
  std::string text(std::istreambuf_iterator<char>(file), {});
  return replaced(text, "half_width_nm = 150.0", "half_width_nm = " + std::to_string(half_width_nm));
}

std::string without_friction(const std::string& text) {
  return replaced(text, "[friction]\nshear_strength_mpa = 50.0\n", "");
}

/// 1e-5 N/m of work: pulls with 1.3e-3 nN.
std::string without_adhesion(const std::string& text) {
  return replaced(replaced(text, "surface_energy_j_m2 = 0.04", "surface_energy_j_m2 = 1e-5"),
                  "surface_energy_j_m2 = 0.2", "surface_energy_j_m2 = 1e-5");
}

std::string piled_up(const std::string& text, const std::string& share) {
  return replaced(text, "[marks]\n", "[marks]\npile_up = " + share + "\n");
}

std::shared_ptr<const scene::Scene> scene_of(const std::string& text) {
  return scene::parse_scene(text, "lithography.toml");
}

/// A slave that is led along straight lines at 1 µm/s, and what its end did.
struct Led {
  explicit Led(std::shared_ptr<const scene::Scene> scene) : slave(std::move(scene)) {
    end = slave.limits().start_pos_w_nm;
    output = go(end, 1e-3);
    counted_at_start_aj = counted_aj();
    lost_at_start_aj = slave.trace().dissipated_aj;
    stored_at_start_aj = slave.trace().stored_aj;
  }
  SlaveOutput go(const Vec3& target, double dt_s) {
    SlaveInput input;
    input.tip_target_pos_w_nm = target;
    SlaveOutput out;
    slave.step(input, dt_s, out);
    return out;
  }
  void lead(const Vec3& to, double step_nm) {
    const Vec3 from = end;
    const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / step_nm - 1e-9)));
    for (int i = 1; i <= steps; ++i) {
      const Vec3 next = from + (to - from) * (1.0 * i / steps);
      const SlaveOutput out = go(next, (to - from).norm() / steps / kSpeed_nm_s);
      if (out.fault_bits != 0) ++faults;
      work_aj -= 0.5 * (out.force_w_nn + output.force_w_nn).dot(next - end);
      end = next;
      output = out;
    }
  }
  double counted_aj() const { return output.energy_in_aj - output.energy_out_aj; }
  double lost_aj() const { return slave.trace().dissipated_aj - lost_at_start_aj; }
  double stored_aj() const { return slave.trace().stored_aj - stored_at_start_aj; }
  double depth_nm(double x, double y) const { return -slave.marked_surface()->height_nm(x, y); }
  /// What is missing below 0, and what stands above it, in the viewer's heights.
  void volumes(double& crater_nm3, double& rim_nm3) const {
    const physics::HeightGrid grid = slave.marked_surface()->heights();
    crater_nm3 = rim_nm3 = 0;
    for (const double z : grid.z_nm) (z < 0 ? crater_nm3 : rim_nm3) += std::fabs(z) * grid.dx_nm * grid.dy_nm;
  }

  NveSlave slave;
  SlaveOutput output;
  Vec3 end;
  double work_aj = 0;
  double counted_at_start_aj = 0, lost_at_start_aj = 0, stored_at_start_aj = 0;
  int faults = 0;
};

// F = πHRδ once it flows (Thornton; a*² = Rδ), against c in series: δ = d/(1 + cπHR), δ_p = δ − ε√(Rδ).
// Pressed to a* and lifted again, Hertz to first yield and from a* on R_p = a*/ε, the work is
//   πH((a*⁴ − a_v⁴)/2R − ⅖ε(a*³ − a_v³)),
// and the volume ∫πa² dδ_p = π((a*⁴ − a_v⁴)/2R − ⅓ε(a*³ − a_v³)).
TEST(PotentialMarks, ADentHasTheDepthTheWorkAndTheVolumeOfTheClosedForm) {
  const auto scene = scene_of(without_adhesion(piled_up(without_friction(lithography_text()), "0.0")));
  const double hardness = scene->marks->hardness_gpa, radius = scene->probe.tip_radius_nm;
  const double strain = kPi * hardness / scene->law_parameters.contact_modulus_gpa;
  const double compliance = scene->port_compliance_nm_nn()(2, 2);
  for (const double pressed : {4.0, 10.0}) {
    Led led(scene);
    led.lead({0.3, 0.2, 1.0}, 0.5);
    led.lead({0.3, 0.2, -pressed}, 0.05);
    const double overlap = pressed / (1.0 + compliance * kPi * hardness * radius);
    const double a = std::sqrt(radius * overlap), first = strain * radius;
    EXPECT_NEAR(led.output.force_w_nn.z(), kPi * hardness * radius * overlap, 1e-3 * pressed * 15.0);
    led.lead({0.3, 0.2, 20.0}, 0.05);
    const double depth = overlap - strain * a;
    EXPECT_NEAR(led.depth_nm(0.3, 0.2), depth, 3e-3 * depth) << pressed;
    const double fourth = (std::pow(a, 4) - std::pow(first, 4)) / (2 * radius);
    const double third = strain * (std::pow(a, 3) - std::pow(first, 3));
    double crater, rim;
    led.volumes(crater, rim);
    EXPECT_NEAR(led.lost_aj(), kPi * hardness * (fourth - 0.4 * third), 0.01 * led.lost_aj());
    EXPECT_NEAR(led.work_aj, led.lost_aj(), 0.01 * led.lost_aj());
    EXPECT_NEAR(crater, kPi * (fourth - third / 3), 0.03 * crater);
    EXPECT_EQ(led.faults, 0);
  }
}

struct Groove {
  double depth = 0, ripple = 0, force = 0, side_force = 0;
  double work_aj = 0, counted_aj = 0, lost_aj = 0, stored_aj = 0;
  double crater = 0, rim = 0;
  double area_nm2 = 0, work_a_length_nn = 0;
  int faults = 0;
  std::uint64_t marks = 0;
};

Groove groove(const std::shared_ptr<const scene::Scene>& scene, double step_nm, double pressed = 5) {
  Led led(scene);
  led.lead({-40, 0.4, 1}, 0.5);
  led.lead({-40, 0.4, -pressed}, 0.1);
  led.lead({0, 0.4, -pressed}, step_nm);
  Groove out;
  const double lost = led.lost_aj();
  led.lead({30, 0.4, -pressed}, step_nm);
  out.work_a_length_nn = (led.lost_aj() - lost) / 30;
  out.force = led.output.force_w_nn.z();
  out.side_force = -led.output.force_w_nn.x();
  led.lead({30, 0.4, 20}, 0.1);
  double low = HUGE_VAL, high = -HUGE_VAL, sum = 0;
  int count = 0;
  for (double x = -10; x <= 15; x += 0.25, ++count) {
    const double depth = led.depth_nm(x, 0.4);
    low = std::min(low, depth);
    high = std::max(high, depth);
    sum += depth;
    double area = 0;
    for (double y = -40; y <= 40; y += 0.5) area += std::max(0.0, led.depth_nm(x, y)) * 0.5;
    out.area_nm2 += area;
  }
  out.area_nm2 /= count;
  out.depth = sum / count;
  out.ripple = (high - low) / out.depth;
  out.work_aj = led.work_aj;
  out.counted_aj = led.counted_aj() - led.counted_at_start_aj;
  out.lost_aj = led.lost_aj();
  out.stored_aj = led.stored_aj();
  out.faults = led.faults;
  out.marks = led.slave.sample().marks();
  led.volumes(out.crater, out.rim);
  return out;
}

// Drawn without adhesion and friction each piece of the way flows at F = Hπa*², and displaces πa*² of each nm
// that it lowers the ground: F dδ_p is H times the volume, whatever the shape of the front. As the ground
// also grows flatter there, R_p = a*/ε, the contact gives U_R dR_p = Fε da*/5 of that back (Hertz: U = ⅖Fδ ~
// R^½ at a given overlap). With dδ_p = (2a*/R − ε)da* a straight groove of cross-section A takes, a length,
//   H A (1 − (ε/5)/(2a*/R − ε)).
// 2 %: the area is summed from the viewer's heights, 1 nm apart, and the depth swings by 3 %.
TEST(PotentialMarks, AGrooveTakesTheHardnessTimesItsVolume) {
  const auto scene = scene_of(without_adhesion(piled_up(without_friction(lithography_text()), "0.0")));
  const double hardness = scene->marks->hardness_gpa, radius = scene->probe.tip_radius_nm;
  const double strain = kPi * hardness / scene->law_parameters.contact_modulus_gpa;
  const Groove g = groove(scene, 0.2, 8);
  EXPECT_EQ(g.faults, 0);
  EXPECT_GT(g.depth, 3.0);
  const double a = std::sqrt(g.force / (kPi * hardness));
  const double part = 1 - strain / 5 / (2 * a / radius - strain);
  EXPECT_LT(part, 0.96);
  EXPECT_NEAR(g.work_a_length_nn, hardness * g.area_nm2 * part, 0.02 * g.work_a_length_nn);
  EXPECT_NEAR(g.side_force, g.work_a_length_nn, 0.02 * g.side_force);
}

// With adhesion, and friction off: what the port was charged, against its work by trapezia of its forces.
// What is left, 0.3 %, is the snap into contact at 0.1 nm a step.
TEST(PotentialMarks, TheAccountOfAGrooveIsTheWorkOfTheEnd) {
  for (const double step : {0.1, 1.0}) {
    const Groove g = groove(scene_of(without_friction(lithography_text())), step);
    EXPECT_EQ(g.faults, 0);
    EXPECT_GT(g.work_aj, 300);
    EXPECT_NEAR(g.counted_aj, g.stored_aj + g.lost_aj, 1e-9 * g.counted_aj);
    EXPECT_GE(g.counted_aj, g.work_aj);
    EXPECT_LT(g.counted_aj, 1.01 * g.work_aj) << step;
  }
}

TEST(PotentialMarks, AGrooveIsTheSameWhateverTheStep) {
  const auto scene = scene_of(without_friction(lithography_text()));
  const Groove fine = groove(scene, 0.05);
  EXPECT_EQ(fine.faults, 0);
  EXPECT_GT(fine.depth, 2.0);
  for (const double step : {0.2, 1.0, 5.0}) {
    const Groove coarse = groove(scene, step);
    EXPECT_EQ(coarse.faults, 0) << step;
    // First order in the piece that the slave makes of a step (kMarkRadii).
    EXPECT_NEAR(coarse.depth, fine.depth, 0.05 * fine.depth) << step;
    EXPECT_NEAR(coarse.force, fine.force, 0.01 * fine.force) << step;
  }
}

// All that a mark displaces stands round it: to the rounding of the sums.
TEST(PotentialMarks, WhatIsDisplacedStandsInTheRim) {
  for (const char* share : {"1.0", "0.4"}) {
    const auto scene = scene_of(piled_up(lithography_text(), share));
    Led led(scene);
    led.lead({0.3, 0.2, 1.0}, 0.5);
    led.lead({0.3, 0.2, -8}, 0.1);
    double crater, rim;
    led.volumes(crater, rim);
    EXPECT_GT(crater, 50);
    // Where a rim and a crater of two increments overlap they are one height: those nodes count with neither.
    EXPECT_NEAR(crater - rim, (1 - scene->marks->pile_up) / scene->marks->pile_up * rim, 0.25 * crater);
    double sum = 0, lowered = 0;
    const physics::HeightGrid grid = led.slave.marked_surface()->heights();
    for (const double z : grid.z_nm) {
      sum += z;
      lowered = std::min(lowered, z);
    }
    EXPECT_LT(lowered, -1.0);
    const double left = sum * grid.dx_nm * grid.dy_nm;
    if (scene->marks->pile_up == 1.0) {
      EXPECT_NEAR(left, 0.0, 1e-9 * crater);
    }
  }
  // The default: flow keeps the volume.
  EXPECT_EQ(scene_of(lithography_text())->marks->pile_up, 1.0);
}

TEST(PotentialMarks, SessionsDoNotSeeEachOthersMarks) {
  const auto scene = scene_of(lithography_text());
  Led marks(scene), other(scene);
  marks.lead({0, 0, 1}, 0.5);
  marks.lead({0, 0, -8}, 0.1);
  marks.lead({20, 0, -8}, 0.5);
  EXPECT_GT(marks.depth_nm(10, 0), 2.0);
  for (double x = -20; x <= 40; x += 1) ASSERT_EQ(other.depth_nm(x, 0), 0.0) << x;
  // And what it feels there is what a first session felt.
  Led first(scene);
  for (Led* led : {&other, &first}) {
    led->lead({10, 0, 1}, 0.5);
    led->lead({10, 0, -6}, 0.1);
  }
  EXPECT_EQ(other.output.force_w_nn, first.output.force_w_nn);
  EXPECT_EQ(other.depth_nm(10, 0), first.depth_nm(10, 0));
}

TEST(PotentialMarks, SurvivesLeapsOfAMicrometre) {
  const auto scene =
      scene_of(replaced(lithography_text(100), "\n[limits]\n", "\n[limits]\nspeed_max_nm_s = 1e7\n"));
  Led led(scene);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-500, 500), height(-60, 60);
  double lost = led.lost_aj();
  int no_balance = 0;
  for (int i = 0; i < 150; ++i) {
    const SlaveOutput out = led.output = led.go(Vec3(place(random), place(random), height(random)), 1e-3);
    ASSERT_TRUE(is_finite(out.force_w_nn) && is_finite(out.tip_pos_w_nm));
    ASSERT_LE(out.force_w_nn.norm(), scene->limits.force_max_nn + 1e-6);
    ASSERT_GE(led.lost_aj(), lost);
    lost = led.lost_aj();
    if (out.fault_bits & link::kFaultNoEquilibrium) ++no_balance;
  }
  EXPECT_LE(no_balance, 2);
  EXPECT_GT(led.slave.sample().marks(), 100u);
  // All that the port was charged is stored or lost; 1e-9 is rounding.
  EXPECT_NEAR(led.counted_aj() - led.counted_at_start_aj, led.stored_aj() + lost, 1e-9 * lost);
}

TEST(PotentialMarks, PloughingTakesNothingFromTheHeapAndGivesTheSameBits) {
  const auto scene = scene_of(lithography_text());
  Led a(scene), b(scene);
  a.lead({0, 0, -5}, 1.0);
  b.lead({0, 0, -5}, 1.0);
  {
    const support::AllocGuard guard;
    for (int i = 1; i <= 40; ++i) a.go(Vec3(i, 0.3 * i, -5), 1e-3);
    EXPECT_EQ(guard.allocations(), 0u);
  }
  for (int i = 1; i <= 40; ++i) b.go(Vec3(i, 0.3 * i, -5), 1e-3);
  for (double x = -5; x <= 45; x += 0.5) ASSERT_EQ(a.depth_nm(x, 0.3 * x), b.depth_nm(x, 0.3 * x));
  EXPECT_GT(a.depth_nm(20, 6), 1.0);
}

struct Heard final : physics::MarkJournal {
  explicit Heard(std::size_t n) { marks.reserve(n); }
  void on_mark(const physics::Mark& mark) noexcept override {
    if (marks.size() < marks.capacity()) marks.push_back(mark);
  }
  std::vector<physics::Mark> marks;
};

TEST(PotentialMarks, WhoHearsOfEachHasTheSameSurface) {
  Led led(scene_of(lithography_text()));
  led.lead(led.end + Vec3(0, 0, -led.end.z() - 4), 0.2);
  ASSERT_GT(led.slave.sample().marks(), 0u);
  physics::SplineSurface copy = *led.slave.marked_surface();
  Heard heard(100000);
  led.slave.set_mark_journal(&heard);
  led.lead(led.end + Vec3(30, 12, -2), 0.2);
  led.slave.set_mark_journal(nullptr);
  ASSERT_GT(heard.marks.size(), 100u);
  EXPECT_NE(copy.heights().z_nm, led.slave.marked_surface()->heights().z_nm);
  for (const physics::Mark& mark : heard.marks) copy.press(mark);
  EXPECT_EQ(copy.heights().z_nm, led.slave.marked_surface()->heights().z_nm) << "bit for bit";
}

// A rough ground of silicon oxide that yields, random closed ways: the port is never given what it has not
// brought, and what it was charged is stored or lost.
TEST(PotentialMarks, ARoughGroundTakesNoLessThanTheWork) {
  std::string text =
      replaced(lithography_text(), "kind = \"flat\"",
               "kind = \"grating\"\nprofile = \"sinusoid\"\nheight_nm = 3.0\nperiod_nm = 40.0");
  Led led(scene_of(text));
  const double start = led.end.z();
  for (int lap = 0; lap < 3; ++lap) {
    led.lead({-10, -4, -4}, 0.2);
    led.lead({12, -4, -6}, 0.2);
    led.lead({12, 9, -5}, 0.2);
    led.lead({-10, -4, start}, 0.2);
    EXPECT_GT(led.counted_aj() - led.counted_at_start_aj, 0.999 * led.work_aj);
  }
  EXPECT_EQ(led.faults, 0);
  EXPECT_GT(led.slave.sample().marks(), 100u);
  EXPECT_NEAR(led.counted_aj() - led.counted_at_start_aj, led.stored_aj() + led.lost_aj(),
              1e-9 * led.lost_aj());
  EXPECT_LT(led.counted_aj() - led.counted_at_start_aj, 1.02 * led.work_aj);
}

TEST(PotentialMarks, PileUpIsAShare) {
  const auto refused = [](const std::string& text) {
    try {
      scene::parse_scene(text, "x.toml");
    } catch (const UserError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_NE(refused(piled_up(lithography_text(), "1.5")).find("pile_up"), std::string::npos);
  EXPECT_EQ(refused(piled_up(lithography_text(), "0.5")), "accepted");
}

}  // namespace
}  // namespace telenano::slave

// A scene with surface.force = "potential" at the slave's port, on the scan that comes with the project: made
// once for all tests here.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/scene/force_curve.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano {
namespace {

const std::string kScenes = std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/";
constexpr double kTwoPi = 6.28318530717958647692;

std::string text_of(const std::string& name) {
  std::ifstream file(kScenes + name + ".toml");
  std::string text(std::istreambuf_iterator<char>(file), {});
  if (const auto at = text.find("\"../data/"); at != std::string::npos) text.insert(at + 1, kScenes);
  return text;
}

std::string with(std::string text, const std::string& after, const std::string& more) {
  const auto at = text.find(after);
  EXPECT_NE(at, std::string::npos) << after;
  return text.insert(at + after.size(), more);
}

std::string potential(const std::string& name) {
  return with(text_of(name), "\n[surface]\n", "force = \"potential\"\n");
}

/// Moist air, friction, a lever that bends and twists.
const std::shared_ptr<const scene::Scene>& humid_flakes() {
  static const auto scene = scene::parse_scene(potential("humid_flakes"), "humid_flakes.toml");
  return scene;
}

const std::shared_ptr<const scene::Scene>& flakes() {
  static const auto scene = scene::parse_scene(potential("flakes"), "flakes.toml");
  return scene;
}

std::string refusal(const std::string& text) {
  try {
    scene::parse_scene(text, "x.toml");
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PotentialScene, IsChosenByAKeyAndRefusesWhatItLacks) {
  const auto refused = [](const std::string& text, const std::string& what) {
    const std::string message = refusal(text);
    EXPECT_NE(message.find(what), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  };
  refused(with(text_of("flakes"), "\n[surface]\n", "force = \"both\"\n"), "force");
  refused(with(text_of("flakes"), "\n[surface]\n", "radius_force = true\n"), "radius_force");
}

// Steps and gratings, in moist air with a bias, under each law that takes them: a tip that comes down, goes
// across and comes up again finds a balance everywhere, and pays.
TEST(PotentialScene, StepsAndGratingsTakeEveryTermAndLaw) {
  const std::string shapes[] = {"kind = \"step\"\nheight_nm = 3.0\nedge_nm = 8.0\n",
                                "kind = \"grating\"\nheight_nm = 4.0\nperiod_nm = 40.0\n"};
  const std::string airs[] = {
      "[forces.capillary]\nhumidity_percent = 60.0\n[forces.electrostatic]\ntip_bias_v = 1.0\n",
      "[contact]\nlaw = \"jkr\"\n", "[contact]\nlaw = \"pietrement-troyon\"\n"};
  for (const std::string& shape : shapes) {
    for (const std::string& air : airs) {
      std::string text = text_of("flat_silicon_oxide");
      const std::string flat = "kind = \"flat\"";
      text.replace(text.find(flat), flat.size(), shape + "force = \"potential\"\n");
      text.replace(text.find("half_width_nm = 500.0"), std::string("half_width_nm = 500.0").size(),
                   "half_width_nm = 40.0\nmargin_nm = 5.0");
      const auto scene = scene::parse_scene(text + "\n" + air, "shape.toml");
      ASSERT_TRUE(scene->potential) << air;
      slave::NveSlave slave(scene);
      slave::SlaveInput input;
      slave::SlaveOutput output;
      input.follow = true;
      const Vec3 start = scene->start_apex_w_nm;
      Vec3 to = start;
      const auto go = [&](const Vec3& way) {
        for (int i = 0; i < 200; ++i) {
          input.tip_target_pos_w_nm = to += way / 200.0;
          slave.step(input, 1e-3, output);
          ASSERT_EQ(output.fault_bits, 0u) << shape << air << to.transpose();
        }
      };
      const double down = start.z() - scene->start_touch_w_nm + 6.0;
      go(Vec3(0, 0, -down));
      EXPECT_GT(output.force_w_nn.z(), 5.0);
      go(Vec3(20, 5, 0));
      go(Vec3(-20, -5, down));
      EXPECT_LT(std::fabs(output.force_w_nn.z()), 1.0);
      EXPECT_GT(output.energy_in_aj - output.energy_out_aj, 0.0);
    }
  }
}

// At a place where a ground of other make found no balance.
TEST(PotentialScene, ForceCurvesPass) {
  scene::CurvePlan plan;
  plan.x_nm = 328.46;
  plan.y_nm = 274.75;
  plan.from_nm = 10;
  plan.to_nm = -6;
  plan.step_nm = 0.02;
  int rows = 0;
  double pull_off = 0, work = 0, last_force = 0;
  EXPECT_NO_THROW(scene::run_curve(*flakes(), plan, [&](const scene::CurveRow& row) {
    ++rows;
    pull_off = std::min(pull_off, row.force_nn);
    work = row.work_aj;
    last_force = row.force_nn;
  }));
  EXPECT_EQ(rows, 2 * 801);
  EXPECT_LT(pull_off, -5.0);
  EXPECT_LT(std::fabs(last_force), 0.5);
  EXPECT_GT(work, 0.0);  // a curve costs energy
}

TEST(PotentialScene, ForceCurvesPassEverywhere) {
  int failed = 0;
  for (int i = 0; i < 40; ++i) {
    scene::CurvePlan plan;
    plan.x_nm = 40 + std::fmod(i * 97.31, 520.0);
    plan.y_nm = 40 + std::fmod(i * 61.77, 520.0);
    plan.from_nm = 10;
    plan.to_nm = -4;
    plan.step_nm = 0.05;
    double work = 0;
    try {
      scene::run_curve(*flakes(), plan, [&](const scene::CurveRow& row) { work = row.work_aj; });
    } catch (const RunError&) {
      ++failed;
    }
    EXPECT_GT(work, -1e-9) << "curve " << i << " creates energy";
  }
  EXPECT_EQ(failed, 0);
}

/// Once round a circle of 5 nm in x and y that goes up and down by 1 nm, pressed throughout; `laps` of them
/// after one to settle.
struct Loops {
  double trapezia = 0;  ///< work of the port, from its forces
  double turnover = 0;
  double charged = 0;  ///< in − out
  double lost = 0;
  int jumps = 0;
};

Loops loops(const std::shared_ptr<const scene::Scene>& scene, double x_nm, double y_nm, double depth_nm,
            int steps, int laps) {
  slave::NveSlave slave(scene);
  slave::SlaveInput input;
  slave::SlaveOutput output;
  const auto go = [&](const Vec3& to) {
    input.tip_target_pos_w_nm = to;
    slave.step(input, 1e-3, output);
  };
  const double high = scene->start_touch_w_nm + 30.0;
  const double ground = scene->potential->touch_height_nm(x_nm, y_nm, high + 100.0);
  const auto at = [&](double s) {
    return Vec3(x_nm + 5 * std::cos(kTwoPi * s), y_nm + 5 * std::sin(kTwoPi * s),
                ground - depth_nm + std::sin(2 * kTwoPi * s));
  };
  for (Vec3 end = slave.trace().commanded_end_w_nm; (Vec3(at(0).x(), at(0).y(), end.z()) - end).norm() > 0;) {
    const Vec3 way = Vec3(at(0).x(), at(0).y(), end.z()) - end;
    go(way.norm() > 2 ? Vec3(end + 2.0 * way / way.norm()) : Vec3(end + way));
    end = slave.trace().commanded_end_w_nm;
  }
  while (output.commanded_pos_w_nm.z() > at(0).z()) {
    const Vec3 end = output.commanded_pos_w_nm;
    go(Vec3(at(0).x(), at(0).y(), std::max(at(0).z(), end.z() - 0.2)));
  }
  for (int i = 1; i <= steps; ++i) go(at(static_cast<double>(i) / steps));
  Loops out;
  const double charged = output.energy_in_aj - output.energy_out_aj;
  const double lost = slave.trace().dissipated_aj;
  Vec3 force = output.force_w_nn;
  for (int i = 1; i <= laps * steps; ++i) {
    const Vec3 from = output.commanded_pos_w_nm;
    go(at(static_cast<double>(i) / steps));
    const double work = -0.5 * (force + output.force_w_nn).dot(output.commanded_pos_w_nm - from);
    force = output.force_w_nn;
    out.trapezia += work;
    out.turnover += std::fabs(work);
    out.jumps += slave.trace().tip.jumps;
  }
  out.charged = output.energy_in_aj - output.energy_out_aj - charged;
  out.lost = slave.trace().dissipated_aj - lost;
  return out;
}

// A closed loop that changes no branch gives nothing to the port and takes nothing from it. Slides over an
// edge lose, and are then in the account.
TEST(PotentialScene, ClosedLoopsGiveNoEnergyToThePort) {
  int smooth = 0;
  double worst = 0;
  for (int i = 0; i < 30; ++i) {
    const double x = 60 + std::fmod(i * 97.31, 480.0);
    const double y = 60 + std::fmod(i * 61.77, 480.0);
    const Loops l = loops(flakes(), x, y, 8.0, 4000, 2);
    EXPECT_GE(l.charged, -1e-9 * l.turnover) << x << ", " << y;
    EXPECT_GE(l.lost, 0.0);
    // 4000 steps a lap of 33 nm: the trapezium's own error, 5e-8 of a smooth lap's turnover.
    EXPECT_NEAR(l.trapezia, l.lost, 1e-6 * l.turnover) << x << ", " << y;
    EXPECT_NEAR(l.charged, l.lost, 1e-9 * l.turnover) << x << ", " << y;
    worst = std::max(worst, std::fabs(l.trapezia - l.lost) / l.turnover);
    if (l.lost < 1e-6 * l.turnover) ++smooth;
  }
  EXPECT_GT(smooth, 10);
  std::printf(
      "%d of 30 loops lose less than 1e-6 of their turnover; trapezia less losses: at most %.1e of it\n",
      smooth, worst);
}

// All that humid_flakes.toml has: bridges, friction, stick–slip, a tilted lever. What the port puts in on a
// closed loop, known from forces alone, is what its account says.
TEST(PotentialScene, HumidLoopsAreCharged) {
  const auto jerky = scene::parse_scene(
      with(potential("humid_flakes"), "\nshear_strength_mpa = 300.0", "\nkinetic_ratio = 0.6"), "jerky.toml");
  double worst = 0;
  for (int i = 0; i < 12; ++i) {
    const double x = 60 + std::fmod(i * 97.31, 480.0);
    const double y = 60 + std::fmod(i * 61.77, 480.0);
    const bool jerks = i % 3 == 2;
    // Pressed, or out of contact and the bridge and back again.
    const Loops l = loops(jerks ? jerky : humid_flakes(), x, y, i % 2 == 0 ? 8.0 : 0.5, 8000, 1);
    EXPECT_GT(l.lost, 0.0);
    // What bristle and springs hold at the end of the lap is not what they held at its beginning
    // (stick–slip), so the charge is compared, which has that. A loop of 8000 steps of 4 pm: backward Euler's
    // first order, and where the tip lets go within a step the trapezium is off by half of it.
    EXPECT_NEAR(l.trapezia, l.charged, (jerks ? 1e-2 : 1e-3) * l.turnover) << x << ", " << y;
    worst = std::max(worst, std::fabs(l.trapezia - l.charged) / l.turnover);
  }
  std::printf("trapezia less charge: at most %.1e of the turnover\n", worst);
}

TEST(PotentialScene, HumidForceCurvesPass) {
  for (int i = 0; i < 40; ++i) {
    scene::CurvePlan plan;
    plan.x_nm = 40 + std::fmod(i * 97.31, 520.0);
    plan.y_nm = 40 + std::fmod(i * 61.77, 520.0);
    plan.from_nm = 12;
    plan.to_nm = -4;
    plan.step_nm = 0.05;
    double work = 0, last = 0;
    const scene::CurveOutcome outcome =
        scene::run_curve(*humid_flakes(), plan, [&](const scene::CurveRow& row) {
          work = row.work_aj;
          last = row.force_nn;
        });
    EXPECT_EQ(outcome.gaps, 0);
    EXPECT_GT(work, -1e-9) << "curve " << i << " creates energy";
    EXPECT_LT(std::fabs(last), 0.5);
  }
}

}  // namespace
}  // namespace telenano

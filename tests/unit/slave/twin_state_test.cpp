// The state that a slave says it has: its hash and its bytes. As games with rollback test theirs (GGRS's sync
// test): at each tick the state of eight ticks ago is given to another slave, the last eight steps are
// repeated there, and the two must be the same to the bit, in the hash, in the forces and in what they say of
// their energy. What the bytes forget, or the hash leaves out although later steps depend on it, is seen
// here; the oracle is the slave that was never interrupted.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <iterator>
#include <random>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"

namespace {

using telenano::Vec3;
using telenano::slave::NveSlave;
using telenano::slave::SlaveInput;
using telenano::slave::SlaveOutput;

constexpr std::size_t kReplayed = 8;
constexpr double kTick_s = 1e-3;

std::string scene_path(const std::string& name) {
  return std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml";
}

/// The scene "particle" on waves instead of a flat ground.
std::shared_ptr<const telenano::scene::Scene> particle_on_waves() {
  const std::string path = scene_path("particle");
  std::ifstream file(path);
  std::string text(std::istreambuf_iterator<char>(file), {});
  const std::string flat = "kind = \"flat\"";
  text.replace(
      text.find(flat), flat.size(),
      "kind = \"grating\"\nprofile = \"sinusoid\"\nheight_nm = 4.0\nperiod_nm = 240.0\nspacing_nm = 10.0");
  return telenano::scene::parse_scene(text, path);
}

/// A scene of the project, or its particle on waves.
std::shared_ptr<const telenano::scene::Scene> scene_of(const std::string& name) {
  return name == "particle_on_waves" ? particle_on_waves() : telenano::scene::load_scene(scene_path(name));
}

/// Down into the sample, along it, up again, with a stop's retreat in between: every branch that the scene
/// has. Where there is a particle, over it.
Vec3 target_of(const telenano::scene::Scene& scene, const telenano::slave::SlaveLimits& limits, int tick,
               int ticks) {
  const double t = static_cast<double>(tick) / ticks;
  Vec3 start = limits.start_pos_w_nm;
  double surface = limits.surface_z_w_nm;
  if (scene.particle) {
    start.x() = scene.particle->x_nm - 30;
    start.y() = scene.particle->y_nm + 1.5;
    surface = scene.surface->height_nm(start.x(), start.y());
  }
  const double deep_nm = scene.particle ? -4 : scene.marks ? 12 : 3;
  Vec3 at = start;
  const double down = std::clamp(t / 0.25, 0.0, 1.0);
  const double up = std::clamp((t - 0.75) / 0.1, 0.0, 1.0);
  const double low = surface - deep_nm;
  at.z() = start.z() + (low - start.z()) * down * (1 - up) + 0.3 * std::fabs(std::fmod(t * 40, 2.0) - 1);
  const double along = std::clamp((t - 0.25) / 0.5, 0.0, 1.0);
  at.x() += 60 * along;
  at.y() += 6 * std::fabs(std::fmod(4 * along, 2.0) - 1);
  return at;
}

struct Step {
  SlaveInput input;
  double dt_s = kTick_s;
};

Step step_of(const telenano::scene::Scene& scene, const NveSlave& slave, int tick, int ticks) {
  Step step;
  step.input.tip_target_pos_w_nm = target_of(scene, slave.limits(), tick, ticks);
  step.dt_s = tick % 7 == 0 ? 1.3e-3 : kTick_s;  // ticks come late
  step.input.follow = tick % 50 != 49;
  step.input.retract = tick > ticks * 8 / 10 && tick < ticks * 8 / 10 + 30;
  return step;
}

int ticks_of(const std::string& name) {
  if (const char* const given = std::getenv("TELENANO_SYNC_TICKS")) return std::atoi(given);
  return name.starts_with("lithography") ? 400 : 1200;
}

class SyncTest : public ::testing::TestWithParam<std::string> {};

TEST_P(SyncTest, AStateOfEightStepsAgoLeadsToTheSameState) {
  const auto scene = scene_of(GetParam());
  NveSlave played(scene);
  NveSlave again(scene);
  ASSERT_EQ(played.state_hash(), again.state_hash()) << "two slaves of a scene begin alike";
  const int ticks = ticks_of(GetParam());
  struct Past {
    std::vector<std::uint8_t> state;
    std::vector<Step> steps;
  };
  std::deque<Past> past;
  std::vector<std::uint8_t> bytes(played.snapshot_bytes_max());
  SlaveOutput output, repeated;
  std::set<telenano::link::ContactState> seen;
  std::set<std::uint64_t> hashes;
  for (int tick = 0; tick < ticks; ++tick) {
    const std::size_t size = played.save(bytes);
    ASSERT_GT(size, 0u);
    past.push_back({{bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size)}, {}});
    const Step step = step_of(*scene, played, tick, ticks);
    played.step(step.input, step.dt_s, output);
    seen.insert(output.contact_state);
    hashes.insert(played.state_hash());
    for (Past& p : past) p.steps.push_back(step);
    if (past.size() < kReplayed) continue;
    ASSERT_TRUE(again.load(past.front().state)) << "tick " << tick;
    for (const Step& s : past.front().steps) again.step(s.input, s.dt_s, repeated);
    ASSERT_EQ(played.state_hash(), again.state_hash())
        << "tick " << tick << ", contact state " << static_cast<int>(output.contact_state);
    ASSERT_EQ(output.force_w_nn, repeated.force_w_nn) << "tick " << tick;
    ASSERT_EQ(output.tip_pos_w_nm, repeated.tip_pos_w_nm) << "tick " << tick;
    ASSERT_EQ(output.energy_in_aj, repeated.energy_in_aj) << "tick " << tick;
    ASSERT_EQ(output.energy_out_aj, repeated.energy_out_aj) << "tick " << tick;
    past.pop_front();
  }
  if (!scene->particle) {
    EXPECT_TRUE(seen.contains(telenano::link::ContactState::kContact)) << "the motion must touch";
  }
  EXPECT_GT(hashes.size(), static_cast<std::size_t>(ticks) / 2) << "the hash must see that the state moves";
}

INSTANTIATE_TEST_SUITE_P(Scenes, SyncTest,
                         ::testing::Values("flakes", "flat_pdms", "flat_polystyrene", "flat_silicon_oxide",
                                           "flat_table", "humid_flakes",

                                           "lithography", "particle", "particle_on_waves"),
                         [](const auto& scene) { return scene.param; });

// Taken at any time of a random walk and carried on for 500 steps: presses, pushes, lets go, withdraws in long
// steps. A law's memory that was left out was seen only where a tip withdraws fast beside a particle that sleeps.
TEST(TwinState, IsWholeWhereverItIsTaken) {
  for (const auto& [name, seeds] : {std::pair{"particle", 9}, {"flakes", 2}, {"humid_flakes", 2}}) {
    const auto scene = scene_of(name);
    int taken = 0;
    for (int seed = 1; seed <= seeds; ++seed) {
      std::mt19937_64 random(static_cast<std::uint64_t>(seed));
      const auto between = [&](double lo, double hi) {
        return std::uniform_real_distribution<>(lo, hi)(random);
      };
      NveSlave played(scene), again(scene);
      SlaveOutput output, repeated;
      std::vector<std::uint8_t> bytes(played.snapshot_bytes_max());
      Vec3 at = scene->start_apex_w_nm, to = at;
      SlaveInput input;
      int until_turn = 0, carried_on = 0;
      for (int tick = 0; tick < 6000; ++tick) {
        if (until_turn-- <= 0) {
          until_turn = 50 + static_cast<int>(random() % 400);
          const double what = between(0, 1);
          input.retract = what < 0.2;
          input.follow = !input.retract && what < 0.9;
          const Vec3 by(between(-40, 40), between(-10, 10), between(-3, 30));
          to = by + Vec3(scene->particle ? scene->particle->x_nm : 0,
                         scene->particle ? scene->particle->y_nm : 0, scene->start_touch_w_nm);
        }
        at += (to - at).cwiseMax(-0.1).cwiseMin(0.1);
        input.tip_target_pos_w_nm = at;
        const double dt_s = kTick_s * between(0.5, input.retract ? 20 : 1.5);
        if (carried_on == 0 && random() % 60 == 0) {
          ASSERT_TRUE(again.load(std::span(bytes).first(played.save(bytes)))) << name << ' ' << seed;
          carried_on = 500;
          ++taken;
        }
        played.step(input, dt_s, output);
        if (carried_on == 0) continue;
        --carried_on;
        again.step(input, dt_s, repeated);
        ASSERT_EQ(played.state_hash(), again.state_hash()) << name << ", seed " << seed << ", tick " << tick;
      }
    }
    EXPECT_GT(taken, 8 * seeds) << name;
  }
}

TEST(TwinState, ResetIsTheStateOfTheBeginning) {
  for (const char* const name : {"flat_pdms", "lithography", "particle", "particle_on_waves"}) {
    const auto scene = scene_of(name);
    NveSlave slave(scene);
    const std::uint64_t first = slave.state_hash();
    SlaveOutput output;
    for (int tick = 0; tick < 200; ++tick) {
      const Step step = step_of(*scene, slave, tick, 400);
      slave.step(step.input, step.dt_s, output);
    }
    EXPECT_NE(slave.state_hash(), first) << name;
    slave.reset();
    EXPECT_EQ(slave.state_hash(), first) << name;
  }
}

class StateBytes : public ::testing::TestWithParam<std::string> {};

TEST_P(StateBytes, WhatIsNoStateIsRefusedAndLeavesTheBeginning) {
  const auto scene = scene_of(GetParam());
  NveSlave slave(scene);
  const std::uint64_t first = slave.state_hash();
  SlaveOutput output;
  for (int tick = 0; tick < 150; ++tick) {
    const Step step = step_of(*scene, slave, tick, 400);
    slave.step(step.input, step.dt_s, output);
  }
  std::vector<std::uint8_t> bytes(slave.snapshot_bytes_max());
  bytes.resize(slave.save(bytes));
  std::uint64_t seed = 1;
  int refused = 0;
  for (int trial = 0; trial < 120; ++trial) {
    std::vector<std::uint8_t> bad = bytes;
    for (int flip = 0; flip < 3; ++flip) {
      seed = telenano::slave::mix_words(seed, 7);
      bad[seed % bad.size()] ^= static_cast<std::uint8_t>(seed >> 32);
    }
    if (trial % 3 == 0) bad.resize(bad.size() * (seed % 100) / 100);
    // Either it is refused, and the slave begins anew; or it is a state, and the slave goes on from it.
    if (!slave.load(bad)) {
      ++refused;
      ASSERT_EQ(slave.state_hash(), first);
    }
    slave.step({}, kTick_s, output);
  }
  // A length cut short is always seen; a changed bit of a number is another number.
  EXPECT_GT(refused, 36);
}

INSTANTIATE_TEST_SUITE_P(Scenes, StateBytes,
                         ::testing::Values("particle", "particle_on_waves", "lithography"),
                         [](const auto& scene) { return scene.param; });

TEST_P(StateBytes, HashSaveAndLoadDoNotAllocate) {
  const auto scene = scene_of(GetParam());
  NveSlave slave(scene);
  std::vector<std::uint8_t> bytes(slave.snapshot_bytes_max());
  SlaveOutput output;
  for (int tick = 0; tick < 150; ++tick) {
    const Step step = step_of(*scene, slave, tick, 400);
    slave.step(step.input, step.dt_s, output);
  }
  const telenano::support::AllocGuard guard;
  const std::uint64_t hash = slave.state_hash();
  const std::size_t size = slave.save(bytes);
  const bool loaded = slave.load(std::span(bytes).first(size));
  const auto allocations = guard.allocations();
  EXPECT_TRUE(loaded);
  EXPECT_EQ(slave.state_hash(), hash);
  EXPECT_EQ(allocations, 0u);
}

// Two grooves, pressed in one order and the other, and one of them moved by a step of the grid: what the hash
// has of marks is where they are. Where the tip is besides is the same for all: far above.
TEST(TwinState, TheHashSeesWhereMarksAre) {
  const auto scene = scene_of("lithography");
  const auto after = [&](const std::vector<Vec3>& dents) {
    NveSlave slave(scene);
    SlaveOutput output;
    SlaveInput input;
    for (const Vec3& dent : dents) {
      for (const double height : {5.0, -dent.z(), 20.0}) {
        input.tip_target_pos_w_nm = Vec3(dent.x(), dent.y(), height);
        for (int i = 0; i < 40; ++i) slave.step(input, kTick_s, output);
      }
    }
    return slave.sample().marks_digest();
  };
  const Vec3 a(0, 0, 12), b(30, 10, 9);
  const std::uint64_t both = after({a, b});
  EXPECT_NE(both, 0u);
  EXPECT_EQ(both, after({a, b}));
  EXPECT_NE(both, after({a}));
  EXPECT_NE(both, after({Vec3(a.x(), a.y(), b.z()), Vec3(b.x(), b.y(), a.z())}));
  EXPECT_NE(both, after({a, b + Vec3(1, 0, 0)}));
  EXPECT_EQ(after({}), 0u);
}

// Level ground, where all coefficients are alike: two of them pressed, then the same two values the other way
// round. Taken back, nothing is left of either.
TEST(TwinState, TheDigestOfMarksGoesByPlace) {
  const auto scene = scene_of("lithography");
  const auto& made = dynamic_cast<const telenano::physics::ScanFields&>(scene->potential->fields());
  using Pressed = telenano::physics::ScanFields::Pressed;
  const double radius = std::log(scene->probe.tip_radius_nm);
  const Pressed a{0, 5000, {-1.0, radius, -1.0, radius}}, b{0, 9000, {-2.0, radius, -2.0, radius}};
  const auto digest = [&](const std::vector<Pressed>& all) {
    auto fields = telenano::physics::ScanFields::for_marks(made);
    for (const Pressed& one : all) EXPECT_TRUE(fields.set_pressed(one));
    const std::uint64_t found = fields.marks_digest();
    fields.unmark();
    EXPECT_EQ(fields.marks_digest(), 0u);
    int left = 0;
    fields.each_pressed([&](const Pressed&) { ++left; });
    EXPECT_EQ(left, 0);
    return found;
  };
  Pressed a_there = a, b_there = b;
  std::swap(a_there.number, b_there.number);
  EXPECT_EQ(digest({a, b}), digest({b, a}));
  EXPECT_NE(digest({a, b}), digest({a_there, b_there}));
  auto fields = telenano::physics::ScanFields::for_marks(made);
  EXPECT_FALSE(fields.set_pressed({0, 4000000000u, {}}));
  EXPECT_FALSE(fields.set_pressed({99, 0, {}}));
  EXPECT_FALSE(fields.set_pressed({0, 5000, {std::nan(""), radius, 0, radius}}));
  EXPECT_EQ(fields.marks_digest(), 0u);
}

}  // namespace

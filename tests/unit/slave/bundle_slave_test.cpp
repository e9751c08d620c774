// A scene that came as a bundle: the same slave, to the bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/scene/scene_bundle.h"
#include "telenano/nve_server/slave/canonical_motion.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano::slave {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> scenes_of_the_project() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes"))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().string());
  std::sort(names.begin(), names.end());
  return names;
}

// Everything that a slave gives out, as bits: NaN, signs of zero and last bits count.
std::vector<std::uint64_t> bits_of(const SlaveOutput& o) {
  std::vector<std::uint64_t> bits;
  for (const Vec3& v : {o.force_w_nn, o.tip_pos_w_nm, o.commanded_pos_w_nm, o.model.point_w_nm,
                        o.model.normal_w, o.particle.pos_w_nm})
    for (int axis = 0; axis < 3; ++axis) bits.push_back(std::bit_cast<std::uint64_t>(v[axis]));
  for (const double x : {o.deflection_nm, o.energy_in_aj, o.energy_out_aj, o.model.stiffness_n_m,
                         o.model.adhesion_nn, o.model.shear_stiffness_n_m, o.model.friction_nn})
    bits.push_back(std::bit_cast<std::uint64_t>(x));
  bits.push_back(static_cast<std::uint64_t>(o.contact_state));
  bits.push_back(o.fault_bits);
  bits.push_back(static_cast<std::uint64_t>(o.particle.status));
  return bits;
}

class BundledScene : public testing::TestWithParam<std::string> {};

// The oracle is the scene from its file, stepped along the same path: in and out of contact, across, with
// steps of unequal length, the clutch let go in between. Not the path of the canonical motion.
TEST_P(BundledScene, MakesASlaveThatMovesAsTheOriginalToTheBit) {
  const scene::SceneWithBundle original = scene::load_scene_with_bundle(GetParam());
  ASSERT_EQ(original.why_none, "");
  const auto copy = scene::decode_bundle(original.bundle);
  EXPECT_EQ(copy->hash, original.scene->hash);
  EXPECT_EQ(copy->name, original.scene->name);
  NveSlave one(original.scene), other(copy);
  EXPECT_EQ(one.limits().start_pos_w_nm, other.limits().start_pos_w_nm);
  EXPECT_EQ(one.limits().workspace_min_w_nm, other.limits().workspace_min_w_nm);
  EXPECT_EQ(one.limits().workspace_max_w_nm, other.limits().workspace_max_w_nm);
  EXPECT_EQ(one.limits().well_aj, other.limits().well_aj);
  EXPECT_EQ(one.limits().force_max_nn, other.limits().force_max_nn);
  SlaveOutput a, b;
  bool touched = false;
  for (int i = 0; i < 900; ++i) {
    SlaveInput input;
    const double t = i / 900.0;
    const double depth = 4.0 * std::sin(7.0 * t) * std::sin(7.0 * t);
    input.tip_target_pos_w_nm =
        Vec3(one.limits().start_pos_w_nm.x() + 30 * t, one.limits().start_pos_w_nm.y() - 9 * t,
             original.scene->start_touch_w_nm + 2 - depth);
    input.follow = i % 250 < 240;
    input.wants_model = i % 3 == 0;
    const double dt_s = i % 5 == 0 ? 1.3e-3 : 0.9e-3;
    one.step(input, dt_s, a);
    other.step(input, dt_s, b);
    ASSERT_EQ(bits_of(a), bits_of(b)) << i;
    touched |= a.contact_state == link::ContactState::kContact;
  }
  EXPECT_TRUE(touched);
  EXPECT_EQ(canonical_motion_hash(original.scene), canonical_motion_hash(copy));
}

TEST_P(BundledScene, ReadTwiceIsTheSameBytesAndHoldsNoPath) {
  const auto both = scene::load_scene_with_bundle(GetParam());
  EXPECT_EQ(both.bundle, scene::load_scene_with_bundle(GetParam()).bundle);
  const scene::BundleParts parts = scene::open_bundle(both.bundle);
  EXPECT_NO_THROW(scene::check_bundle_text(parts));
  for (const config::TomlValue& value : parts.values) {
    const auto* const text = std::get_if<std::string>(&value.value);
    if (text == nullptr) continue;
    EXPECT_EQ(text->find('/'), std::string::npos) << value.path << " = " << *text;
  }
}

INSTANTIATE_TEST_SUITE_P(All, BundledScene, testing::ValuesIn(scenes_of_the_project()),
                         [](const auto& one) { return fs::path(one.param).stem().string(); });

// The number must see what a hand would: another stiffness in its last bits, a height of the scan, a law.
TEST(CanonicalMotion, ChangesWithTheScene) {
  const std::string text =
      R"(name = "a"
[sample]
youngs_modulus_gpa = 70
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "flat"
[probe]
tip_radius_nm = 20
stiffness_n_m = 40
[probe.tip]
youngs_modulus_gpa = 160
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[forces]
[coupling]
stiffness_n_m = 20
[limits]
force_max_nn = 500
[start]
x_nm = 0
y_nm = 0
height_nm = 20
)";
  const auto hash_with = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    return canonical_motion_hash(scene::parse_scene(changed, "a.toml"));
  };
  const std::uint64_t as_is = hash_with("20", "20");
  EXPECT_EQ(as_is, hash_with("20", "20"));
  EXPECT_NE(as_is, hash_with("stiffness_n_m = 40", "stiffness_n_m = 40.000000000000007"));
  EXPECT_NE(as_is, hash_with("= 70", "= 70.00000000000001"));
  EXPECT_NE(as_is, hash_with("[forces]", "[forces]\nretardation_nm = 100"));
  EXPECT_NE(as_is, hash_with("[forces]", "[contact]\nlaw = \"dmt\""));
  EXPECT_EQ(as_is, hash_with("name = \"a\"", "name = \"b\""));  // nothing that is felt
}

// One height of a scan that the path touches, by its last bit.
TEST(CanonicalMotion, ChangesWithAHeightOfTheScan) {
  const auto both =
      scene::load_scene_with_bundle(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flakes.toml");
  // Pixel (128, 128) of 256 × 256 lies at (301, 301) nm; rows run from the top.
  const scene::BundleParts parts = scene::open_bundle(both.bundle);
  const std::size_t data = parts.scan.size() - std::size_t{4} * 256 * 256;
  const std::size_t pixel = data + 4 * (std::size_t{127} * 256 + 128);
  std::string changed = both.bundle;
  changed[both.bundle.find(parts.scan) + pixel] ^= 1;
  EXPECT_NE(canonical_motion_hash(both.scene), canonical_motion_hash(scene::decode_bundle(changed)));
}

}  // namespace
}  // namespace telenano::slave

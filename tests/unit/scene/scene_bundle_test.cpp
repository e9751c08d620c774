// The form of a bundle: what is written byte by byte here by hand is read, and nothing else.
#include "telenano/nve_server/scene/scene_bundle.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/hash/sha256.h"

namespace telenano::scene {
namespace {

// Written apart from the code under test: little-endian numbers, entries, values.
std::string number(std::uint64_t value, int bytes) {
  std::string text;
  for (int i = 0; i < bytes; ++i) text += static_cast<char>(value >> 8 * i & 0xff);
  return text;
}
std::string entry(const std::string& name, const std::string& content) {
  return number(name.size(), 1) + name + number(content.size(), 4) + content;
}
std::string real(const std::string& path, double value) {
  return number(3, 1) + number(path.size(), 1) + path + number(std::bit_cast<std::uint64_t>(value), 8);
}
std::string text(const std::string& path, const std::string& value) {
  return number(4, 1) + number(path.size(), 1) + path + number(value.size(), 2) + value;
}
std::string empty_table(const std::string& path) {
  return number(0, 1) + number(path.size(), 1) + path;
}

using Values = std::vector<std::string>;

const Values kFlat = {real("coupling.stiffness_n_m", 20),
                      empty_table("forces"),
                      real("limits.force_max_nn", 500),
                      text("name", "flat"),
                      number(1, 1) + number(11, 1) + "probe.rigid" + number(1, 1),
                      real("probe.tip.poisson_ratio", 0.27),
                      real("probe.tip.surface_energy_j_m2", 0.2),
                      real("probe.tip.youngs_modulus_gpa", 160),
                      number(2, 1) + number(19, 1) + "probe.tip_radius_nm" + number(20, 8),
                      real("sample.poisson_ratio", 0.27),
                      real("sample.surface_energy_j_m2", 0.2),
                      real("sample.youngs_modulus_gpa", 70),
                      real("start.height_nm", 20),
                      real("start.x_nm", 0),
                      real("start.y_nm", 0),
                      text("surface.kind", "flat")};
const std::string kFlatText =
    "name = \"flat\"\ncoupling = { stiffness_n_m = 20.0 }\nforces = {}\nlimits = { force_max_nn = 5e2 }\n"
    "sample = { poisson_ratio = 0.27, surface_energy_j_m2 = 0.2, youngs_modulus_gpa = 70.0 }\n"
    "start = { height_nm = 2e1, x_nm = 0.0, y_nm = 0.0 }\nsurface = { kind = \"flat\" }\n"
    "[probe]\nrigid = true\ntip_radius_nm = 20\n"
    "tip = { poisson_ratio = 0.27, surface_energy_j_m2 = 0.2, youngs_modulus_gpa = 160.0 }\n";

std::string values_of(const Values& values) {
  std::string bytes = number(values.size(), 4);
  for (const std::string& value : values) bytes += value;
  return bytes;
}
std::string head(std::uint32_t entries, std::uint32_t physics = kPhysicsVersion, std::uint32_t form = 1) {
  return "TLNB" + number(form, 4) + number(physics, 4) + number(entries, 4);
}
std::string flat(const Values& values = kFlat, const std::string& said = kFlatText) {
  return head(2) + entry("scene.toml", said) + entry("values", values_of(values));
}
std::string refusal(const std::string& bytes, const BundleLimits& limits = {}) {
  try {
    decode_bundle(bytes, limits);
  } catch (const UserError& error) {
    const std::string line = error.what();
    for (const char c : line) EXPECT_TRUE(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f) << line;
    EXPECT_LT(line.size(), 300u);
    return line;
  }
  return "taken";
}
Values with(std::size_t place, const std::string& value) {
  Values values = kFlat;
  values[place] = value;
  return values;
}

TEST(SceneBundle, IsBuiltFromItsNumbersWhateverItsTextSays) {
  const auto scene = decode_bundle(flat(kFlat, "this is no TOML at all [["));
  EXPECT_EQ(scene->name, "flat");
  EXPECT_EQ(scene->sample.youngs_modulus_gpa, 70);
  EXPECT_EQ(scene->limits.force_max_nn, 500);
  EXPECT_THROW(check_bundle_text(open_bundle(flat(kFlat, "this is no TOML at all [["))), UserError);
  EXPECT_THROW(check_bundle_text(open_bundle(flat(with(2, real("limits.force_max_nn", 400))))), UserError);
  EXPECT_NO_THROW(check_bundle_text(open_bundle(flat())));
}

TEST(SceneBundle, WhatIsWrittenByHandIsWhatASceneIsWrittenAs) {
  const SceneWithBundle both = parse_scene_with_bundle(kFlatText, "flat.toml");
  EXPECT_EQ(both.why_none, "");
  EXPECT_EQ(both.bundle, flat());
}

TEST(SceneBundle, OfAnotherPhysicsVersionIsNamedAndRefused) {
  const std::string bytes =
      head(2, kPhysicsVersion + 1) + entry("scene.toml", kFlatText) + entry("values", values_of(kFlat));
  EXPECT_NE(refusal(bytes).find("physics version"), std::string::npos);
  EXPECT_EQ(open_bundle(bytes).physics_version, kPhysicsVersion + 1);
}

TEST(SceneBundle, CutAnywhereIsOneLine) {
  const std::string whole = flat();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string line = refusal(whole.substr(0, size));
    EXPECT_EQ(line.find("scene bundle: "), 0u) << size << ": " << line;
  }
}

TEST(SceneBundle, WithAnythingBehindItIsRefused) {
  EXPECT_NE(refusal(flat() + "x").find("after the end"), std::string::npos);
  EXPECT_NE(refusal(head(2) + entry("scene.toml", kFlatText) + entry("values", values_of(kFlat) + "x"))
                .find("after the end"),
            std::string::npos);
}

TEST(SceneBundle, TakesNoNameButItsOwn) {
  const std::string last = entry("values", values_of(kFlat));
  for (const std::string name :
       {"../../etc/passwd", "/etc/passwd", "scene.toml\n", "", "Scene.toml", "values"}) {
    const std::string line = refusal(head(2) + entry(name, kFlatText) + last);
    EXPECT_NE(line.find("expected 'scene.toml'"), std::string::npos) << line;
  }
  // Twice, or in another order.
  EXPECT_NE(refusal(head(3) + entry("scene.toml", kFlatText) + entry("scene.toml", kFlatText) + last),
            "taken");
  EXPECT_NE(refusal(head(2) + last + entry("scene.toml", kFlatText)), "taken");
  for (const std::uint32_t count : {0u, 1u, 4u, 0xffffffffu})
    EXPECT_NE(refusal(head(count) + entry("scene.toml", kFlatText) + last).find("expected 2 or 3"),
              std::string::npos);
}

TEST(SceneBundle, TakesNoValueThatIsNone) {
  EXPECT_NE(refusal(flat(with(0, real("coupling.stiffness_n_m", NAN)))).find("not finite"),
            std::string::npos);
  EXPECT_NE(refusal(flat(with(0, real("coupling.stiffness_n_m", INFINITY)))).find("not finite"),
            std::string::npos);
  EXPECT_NE(refusal(flat(with(0, real("coupling.stiffness_n_m", -3)))).find("expected"), std::string::npos);
  EXPECT_NE(refusal(flat(with(3, text("name", "a\nb")))).find("control characters"), std::string::npos);
  EXPECT_NE(refusal(flat(with(3, text("name", std::string(2000, 'a'))))).find("longer"), std::string::npos);
  EXPECT_NE(refusal(flat(with(1, number(9, 1) + number(6, 1) + "forces"))).find("unknown kind"),
            std::string::npos);
  EXPECT_NE(refusal(flat(with(4, number(1, 1) + number(11, 1) + "probe.rigid" + number(2, 1)))).find("true"),
            std::string::npos);
}

TEST(SceneBundle, TakesEachValueOnceAndInOrder) {
  Values twice = kFlat;
  twice.insert(twice.begin() + 3, real("limits.force_max_nn", 400));
  EXPECT_NE(refusal(flat(twice)).find("twice"), std::string::npos);
  Values turned = kFlat;
  std::swap(turned[2], turned[3]);
  EXPECT_NE(refusal(flat(turned)).find("order"), std::string::npos);
  Values through = kFlat;
  through[4] = real("probe", 1);
  EXPECT_NE(refusal(flat(through)).find("through a value"), std::string::npos);
  Values unknown = kFlat;
  unknown.insert(unknown.begin() + 1, real("coupling.zeta", 1));
  EXPECT_NE(refusal(flat(unknown)).find("zeta"), std::string::npos);
  Values strange = kFlat;
  strange.insert(strange.begin() + 1, real("coupling.\x1b[2J", 1));
  EXPECT_NE(refusal(flat(strange)), "taken");
}

TEST(SceneBundle, KeepsWithinItsLimits) {
  BundleLimits limits;
  limits.values = 3;
  EXPECT_NE(refusal(flat(), limits).find("values"), std::string::npos);
  limits = {};
  limits.bytes = flat().size() - 1;
  EXPECT_NE(refusal(flat(), limits).find("bytes"), std::string::npos);
  limits = {};
  limits.text_bytes = kFlatText.size() - 1;
  EXPECT_NE(refusal(flat(), limits).find("text"), std::string::npos);
  // A count or size that promises what is not there costs nothing.
  EXPECT_NE(refusal(head(2) + number(10, 1) + "scene.toml" + number(0xffffffff, 4)).find("ends early"),
            std::string::npos);
}

TEST(SceneBundle, HasAScanIfAndOnlyIfItsSurfaceAsksForOne) {
  const std::string rest = entry("scene.toml", kFlatText) + entry("values", values_of(kFlat));
  EXPECT_NE(refusal(head(3) + entry("scan.gsf", "Gwyddion") + rest).find("does not use"), std::string::npos);
  Values scan = kFlat;
  scan.back() = text("surface.file", "scan.gsf");
  scan.push_back(text("surface.kind", "scan"));
  EXPECT_NE(refusal(flat(scan)).find("scan is missing"), std::string::npos);
  const std::string with_scan = entry("scene.toml", kFlatText) + entry("values", values_of(scan));
  EXPECT_NE(refusal(head(3) + entry("scan.gsf", "Gwyddion") + with_scan).find("scan.gsf"), std::string::npos);
  // A path of the machine that reads it is never opened.
  scan[scan.size() - 2] = text("surface.file", "/etc/passwd");
  const std::string path = entry("scene.toml", kFlatText) + entry("values", values_of(scan));
  EXPECT_NE(refusal(head(3) + entry("scan.gsf", "Gwyddion") + path).find("expected scan.gsf"),
            std::string::npos);
}

TEST(SceneBundle, ASceneThatNoBundleHoldsIsSaidAndStillAScene) {
  std::string odd = kFlatText;
  odd.replace(odd.find("\"flat\""), 6, "\"fl\\nat\"");
  const SceneWithBundle both = parse_scene_with_bundle(odd, "odd.toml");
  EXPECT_TRUE(both.scene);
  EXPECT_TRUE(both.bundle.empty());
  EXPECT_NE(both.why_none.find("control characters"), std::string::npos) << both.why_none;
}

// FIPS 180-4's own example, and the empty message.
TEST(Sha256, OfKnownMessages) {
  if (!has_sha256()) GTEST_SKIP() << "built without OpenSSL";
  EXPECT_EQ(hex(sha256("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(hex(sha256("")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(short_name(sha256("abc")), 0xeacf018fbf1678bau);
}

}  // namespace
}  // namespace telenano::scene

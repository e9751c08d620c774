#include "nve_server/scene/scene.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "common/base/error.h"

namespace telenano::scene {
namespace {

constexpr const char* kFlat = R"(name = "test"
[sample]
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "flat"
[probe]
tip_radius_nm = 20.0
stiffness_n_m = 40.0
[probe.tip]
youngs_modulus_gpa = 160.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[coupling]
stiffness_n_m = 20.0
[limits]
force_max_nn = 500.0
[start]
x_nm = 0.0
y_nm = 0.0
height_nm = 20.0
)";

class SceneFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::temp_directory_path() /
        ("telenano_scene_" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string write(const std::string& from = "", const std::string& to = "") {
    std::string content = kFlat;
    if (!from.empty()) content.replace(content.find(from), from.size(), to);
    const std::string path = (folder_ / "s.toml").string();
    std::ofstream(path) << content;
    return path;
  }
  // The message without the folder.
  std::string error_of(const std::string& from, const std::string& to) {
    try {
      load_scene(write(from, to));
    } catch (const UserError& error) {
      std::string text = error.what();
      const std::string prefix = folder_.string() + "/";
      for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix))
        text.erase(at, prefix.size());
      return text;
    }
    return "no error";
  }
  std::filesystem::path folder_;
};

TEST_F(SceneFile, BuildsWhatItAsksForAndNoMore) {
  const auto scene = load_scene(write());
  EXPECT_TRUE(scene->surface->is_flat());
  EXPECT_TRUE(scene->law_parameters.van_der_waals);
  // K = 4E*/3 with 1/E* = (1 − 0.27²)(1/70 + 1/160): closed form, to rounding.
  EXPECT_NEAR(scene->law_parameters.contact_modulus_gpa, 4.0 / 3.0 / ((1 - 0.0729) * (1 / 70.0 + 1 / 160.0)),
              1e-12);
  EXPECT_NEAR(scene->law_parameters.work_of_adhesion_n_m, 0.4, 1e-15);
  EXPECT_NEAR(scene->port_compliance_nm_nn()(2, 2), 1 / 20.0 + 1 / 40.0, 1e-15);
  EXPECT_NEAR(scene->port_compliance_nm_nn()(0, 0), 1 / 20.0, 1e-15);
  EXPECT_NEAR(scene->start_apex_w_nm.z(), 20.0, 1e-9);
}

TEST_F(SceneFile, BeamGivesItsStiffness) {
  const auto scene = load_scene(write("stiffness_n_m = 40.0\n",
                                      "[probe.beam]\nyoungs_modulus_gpa = 169.0\nwidth_um = 30.0\n"
                                      "thickness_um = 4.0\nlength_um = 125.0\n"));
  // E b t³/(4 L³) in SI.
  EXPECT_NEAR(scene->cantilever.stiffness_n_m(), 169e9 * 30e-6 * 64e-18 / (4 * 125e-6 * 125e-6 * 125e-6), 1e-9);
}

TEST_F(SceneFile, EveryMistakeIsOneLine) {
  EXPECT_EQ(error_of("youngs_modulus_gpa = 70.0", "youngs_modulus_pa = 7e10"),
            "s.toml:3: unknown key 'youngs_modulus_pa' in [sample]; did you mean 'youngs_modulus_gpa'?");
  EXPECT_EQ(error_of("poisson_ratio = 0.27", "poisson_ratio = 0.51"),
            "s.toml:4: 'poisson_ratio' in [sample] is 0.51, expected a number in (-1, 0.5]");
  EXPECT_EQ(error_of("surface_energy_j_m2 = 0.2", "surface_energy_j_m2 = 0"),
            "s.toml:5: 'surface_energy_j_m2' in [sample] is 0, expected a number in [1e-05, 10]");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"flut\""),
            "s.toml:7: 'kind' in [surface] is 'flut', expected one of 'flat', 'plane', 'step', 'sphere', 'grating', 'scan'");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"scan\""),
            "s.toml:6: missing key 'file' in [surface] (expected a text in quotes)");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"scan\"\nfile = \"none.gsf\""),
            "none.gsf: the scan cannot be read: No such file or directory");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"flat\"\nfile = \"none.gsf\""),
            "s.toml:8: unknown key 'file' in [surface]");
  EXPECT_EQ(error_of("stiffness_n_m = 40.0\n", ""),
            "s.toml:8: 'stiffness_n_m' in [probe]: missing; expected one of stiffness_n_m, [probe.beam] or "
            "rigid = true");
  EXPECT_EQ(
      error_of("stiffness_n_m = 40.0\n", "stiffness_n_m = 40.0\nrigid = true\n"),
      "s.toml:10: 'stiffness_n_m' in [probe]: give only one of stiffness_n_m, [probe.beam] and rigid = true");
  EXPECT_EQ(error_of("force_max_nn = 500.0", "force_max_nn = 40.0"),
            "s.toml:18: 'force_max_nn' in [limits]: is 40, expected more than the adhesion of this tip, "
            "50.2655 nN");
  EXPECT_EQ(error_of("x_nm = 0.0", "x_nm = 1000.0"),
            "s.toml:20: 'x_nm' in [start] is 1000, expected a number in [-500, 500]");
  EXPECT_EQ(error_of("height_nm = 20.0", "height_nm = -1.0"),
            "s.toml:22: 'height_nm' in [start] is -1, expected a number in [0.5, 100]");
  EXPECT_EQ(error_of("name = \"test\"", "name = \"\""),
            "s.toml:1: 'name' at the top level: expected 1 to 47 bytes");
  EXPECT_EQ(error_of("name = \"test\"", "name = \"test\"\ncolour = 1"),
            "s.toml:2: unknown key 'colour' at the top level");
}

TEST_F(SceneFile, HashFollowsTheDescription) {
  const auto a = load_scene(write());
  const auto b = load_scene(write());
  EXPECT_EQ(a->hash, b->hash);
  EXPECT_NE(load_scene(write("height_nm = 20.0", "height_nm = 21.0"))->hash, a->hash);
}

TEST(DeployedScenes, AllLoad) {
  const std::filesystem::path folder = std::filesystem::path(TELENANO_SOURCE_DIR) / "deploy/scenes";
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".toml") continue;
    EXPECT_EQ(load_scene(entry.path().string())->name, entry.path().stem().string());
    ++count;
  }
  EXPECT_GE(count, 4);
}

// λ and pull-off of the source paper's samples under a silicon tip of 20 nm (reference figures of six
// digits).
TEST(DeployedScenes, FlatSamplesHaveTheReferenceFigures) {
  const struct {
    const char* name;
    double lambda, pull_off_nn;
  } samples[] = {{"flat_silicon_oxide", 0.73676, 41.4015},
                 {"flat_polystyrene", 4.04149, 21.7946},
                 {"flat_pdms", 408.71, 12.5034}};
  for (const auto& sample : samples) {
    const auto scene =
        load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + sample.name + ".toml");
    const auto& law = scene->equilibrium->law();
    EXPECT_NEAR(law.lambda(20.0), sample.lambda, 1e-5 * sample.lambda);
    EXPECT_NEAR(law.pull_off_nn(20.0), sample.pull_off_nn, 1e-5 * sample.pull_off_nn);
  }
}

}  // namespace
}  // namespace telenano::scene

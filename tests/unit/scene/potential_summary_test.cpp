// What `check` says of a ground that is one potential. Oracle: closed forms of the radius on a sinusoid.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/equilibrium/potential_equilibrium.h"
#include "telenano/nve_server/physics/potential/tip_potential.h"
#include "telenano/nve_server/physics/surface/scan_fields.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/scene/scene_summary.h"
#include "telenano/nve_server/scene/scene_terms.h"
#include "tests/source_dir.h"

namespace telenano::scene {
namespace {

std::string text_of(const std::string& force) {
  return R"(name = "waves"
[sample]
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
[surface]
kind = "grating"
height_nm = 2.0
period_nm = 40.0
force = ")" +
         force + R"("
[forces]
van_der_waals = true
[friction]
shear_strength_mpa = 300.0
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
force_max_nn = 200.0
half_width_nm = 60.0
[start]
x_nm = 0.0
y_nm = 0.0
height_nm = 10.0
)";
}

// On a crest and in a trough of z = A cos(kx), A = 1 nm, the sample's curvature is ±A k² = 0.0247/nm, so that
// R_eff = R/√(1 ± R A k²): 16.4 and 28.1 nm. 5 and 95 % of the places lie within the outermost twentieth of
// the phase, where the curvature is that to 2 %; and the fields average it over a contact (t/R_eff, below 1
// %).
TEST(PotentialSummary, RadiiAreThoseOfTheGround) {
  const auto scene = parse_scene(text_of("potential"), "waves.toml");
  const SceneSummary summary = summarise(*scene);
  const double bend = 1.0 * std::pow(2 * 3.14159265358979 / 40, 2) * 20;
  EXPECT_NEAR(summary.radius_low_nm, 20 / std::sqrt(1 + bend), 0.4);
  EXPECT_NEAR(summary.radius_high_nm, 20 / std::sqrt(1 - bend), 1.0);
  EXPECT_LT(summary.pull_off_low_nn, summary.pull_off_median_nn);
  EXPECT_GT(summary.pull_off_high_nn / summary.pull_off_low_nn, 1.4);
}

bool tells(const SceneSummary& summary, const std::string& word) {
  return std::any_of(summary.model_errors.begin(), summary.model_errors.end(),
                     [&](const std::string& line) { return line.find(word) != std::string::npos; });
}

void expect_not_compared(const SceneSummary& summary) {
  EXPECT_TRUE(tells(summary, "not compared on this ground"));
  // No accuracy of another ground.
  EXPECT_FALSE(tells(summary, " %"));
  EXPECT_FALSE(tells(summary, "boundary elements"));
}

/// A scan of deploy/data, or what `change` makes of it, in a scene of its own.
class ComparedScan : public ::testing::TestWithParam<const char*> {
 protected:
  void TearDown() override { std::filesystem::remove_all(folder_); }

  SceneSummary summary(const std::function<void(surface::Scan&)>& change, const std::string& more = "",
                       const std::string& modulus_gpa = "70.0") const {
    std::filesystem::create_directories(folder_);
    const std::string original = std::string(TELENANO_SOURCE_DIR) + "/deploy/data/" + GetParam();
    std::string file = original;
    if (change) {
      surface::Scan scan = surface::read_gsf(original);
      change(scan);
      file = (folder_ / "changed.gsf").string();
      surface::write_gsf(file, scan);
    }
    std::string text = text_of("potential");
    const auto kind = text.find("kind = "), force = text.find("force = \"potential\"");
    text.replace(kind, force - kind, "kind = \"scan\"\nfile = \"" + file + "\"\n" + more);
    text.replace(text.find("70.0"), 4, modulus_gpa);
    text.erase(text.find("half_width_nm"), std::string("half_width_nm = 60.0\n").size());
    for (const char* key : {"x_nm = 0.0", "y_nm = 0.0"})
      text.replace(text.find(key), 10, std::string(key, 7) + "150.0");
    return summarise(*parse_scene(text, "scan.toml"));
  }

  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("telenano_compared_" + std::to_string(::getpid()));
};

TEST_P(ComparedScan, TellsTheModelsErrorsAndWhereTheyAreFrom) {
  const SceneSummary like = summary(nullptr);
  for (const char* word :
       {"pull-off 1 to 2 %", "pressed", "van der Waals", "not compared", "boundary elements"})
    EXPECT_TRUE(tells(like, word)) << word;
  EXPECT_FALSE(tells(like, "not compared on this ground"));
  // The comparison was with silicon oxide.
  expect_not_compared(summary(nullptr, "", "0.5"));
}

INSTANTIATE_TEST_SUITE_P(PotentialSummary, ComparedScan,
                         ::testing::Values("wsxm_600nm.gsf", "nanoscope_peakforce_1um.gsf"));

using ChangedScan = ComparedScan;
INSTANTIATE_TEST_SUITE_P(PotentialSummary, ChangedScan, ::testing::Values("wsxm_600nm.gsf"));

// An error found on one ground says nothing of another one.
TEST_P(ChangedScan, IsNotCompared) {
  expect_not_compared(summary([](surface::Scan& scan) {
    for (double& z : scan.grid.z_nm) z *= 1.5;
  }));
  expect_not_compared(summary([](surface::Scan& scan) {
    for (double& z : scan.grid.z_nm) z += 1;
  }));
  expect_not_compared(summary([](surface::Scan& scan) {
    scan.grid.rows -= 1;
    scan.grid.z_nm.resize(scan.grid.z_nm.size() - static_cast<std::size_t>(scan.grid.columns));
  }));
  expect_not_compared(summary([](surface::Scan& scan) { scan.grid.dx_nm *= 2; }));
  expect_not_compared(summary(nullptr, "level = \"lines\"\n"));
}

TEST(PotentialSummary, AShapeIsNotCompared) {
  expect_not_compared(summarise(*parse_scene(text_of("potential"), "waves.toml")));
}

std::string without_force() {
  std::string text = text_of("");
  return text.replace(text.find("force = \"\""), 10, "");
}

const std::string kParticle = R"([particle]
radius_nm = 10.0
x_nm = 20.0
y_nm = 0.0
[particle.material]
youngs_modulus_gpa = 70.0
poisson_ratio = 0.27
surface_energy_j_m2 = 0.2
)";

// What a scene gets that says nothing: grids the potential, with a particle too, which then has fields of its
// own radius; a level sample needs none.
TEST(PotentialDefault, IsThatOfGrids) {
  const auto grating = parse_scene(without_force(), "waves.toml");
  EXPECT_NE(grating->potential, nullptr);
  EXPECT_EQ(grating->particle_ground, nullptr);
  EXPECT_EQ(grating->hash, parse_scene(without_force(), "waves.toml")->hash);

  const auto particle = parse_scene(without_force() + kParticle, "waves.toml");
  EXPECT_NE(particle->potential, nullptr);
  ASSERT_NE(particle->particle_ground, nullptr);
  EXPECT_GT(particle->ground.fields_bytes, grating->ground.fields_bytes);
  // Each touches by its own radius: on the crest at half a period, whose ground bends down with radius
  // 1/(A k²), a sphere of R has R_eff = R/√(1 + R A k²).
  const double bend = 1.0 * std::pow(2 * 3.14159265358979 / 40, 2);
  const auto radius_on_crest = [](const physics::ContactFields& fields, double highest_nm) {
    physics::ContactJet at;
    Vec3 apex(20, 0, highest_nm);
    for (int i = 0; i < 60; ++i) {
      fields.contact_at(apex, at);
      apex.z() += at.overlap_nm;
    }
    return std::exp(at.log_radius);
  };
  const double top = particle->surface->highest_nm();
  EXPECT_NEAR(radius_on_crest(particle->potential->fields(), top), 20 / std::sqrt(1 + 20 * bend), 0.2);
  EXPECT_NEAR(radius_on_crest(particle->particle_ground->fields(), top), 10 / std::sqrt(1 + 10 * bend), 0.1);

  // What does not fit under four sides of the ground is refused for either sphere.
  std::string wide = without_force() + kParticle;
  wide.replace(wide.find("radius_nm = 10.0\nx_nm"), 16, "radius_nm = 9000.0");
  try {
    parse_scene(wide, "waves.toml");
    FAIL() << "taken";
  } catch (const UserError& error) {
    EXPECT_NE(std::string(error.what()).find("9000 nm is too wide"), std::string::npos) << error.what();
  }

  std::string flat = without_force();
  flat.replace(flat.find("kind"), flat.find("[forces]") - flat.find("kind"), "kind = \"flat\"\n");
  EXPECT_EQ(parse_scene(flat, "flat.toml")->potential, nullptr);
  // A particle lies on fields, on a level sample in closed form.
  EXPECT_NE(parse_scene(flat + kParticle, "flat.toml")->particle_ground, nullptr);
  // A sample that yields is a grid whatever its shape.
  flat.replace(flat.find("surface_energy_j_m2"), 0, "hardness_gpa = 9.0\n");
  const auto yields = parse_scene(flat, "flat.toml");
  EXPECT_NE(yields->potential, nullptr);
  EXPECT_EQ(yields->marks->pile_up, 1.0);
}

// Scenes from before: one way is left, the other is told to be gone in one line that says what to do.
TEST(PotentialDefault, AForceFromBeforeIsTakenOrRefusedInWords) {
  EXPECT_NE(parse_scene(text_of("potential"), "waves.toml")->potential, nullptr);
  const auto refused = [](const std::string& text, const char* word) {
    try {
      parse_scene(text, "waves.toml");
      ADD_FAILURE() << "taken: " << word;
    } catch (const UserError& error) {
      const std::string said = error.what();
      EXPECT_NE(said.find(word), std::string::npos) << said;
      EXPECT_NE(said.find("omit it"), std::string::npos) << said;
      EXPECT_EQ(said.find('\n'), std::string::npos) << said;
    }
  };
  refused(text_of("foot"), "force");
  std::string radius = text_of("potential");
  radius.replace(radius.find("force = \"potential\""), 19, "radius_force = true");
  refused(radius, "radius_force");
}

// Where the tip starts from and what the station takes for the ground is where the potential's overlap is 0:
// on the slope of a groove, above the surface itself.
TEST(PotentialDefault, TheStartIsAboveWhereThePotentialTouches) {
  std::string text = without_force();
  text.replace(text.find("x_nm = 0.0"), 10, "x_nm = 13.0");
  const auto scene = parse_scene(text, "waves.toml");
  physics::ContactJet at;
  scene->potential->fields().contact_at(Vec3(13, 0, scene->start_touch_w_nm), at);
  EXPECT_NEAR(at.overlap_nm, 0, 1e-9);
  EXPECT_NEAR(scene->start_apex_w_nm.z(), scene->start_touch_w_nm + 10, 1e-12);
  EXPECT_GT(scene->start_touch_w_nm - scene->surface->height_nm(13, 0), 1e-3);
}

// Each term can be left out of a potential, on the same fields.
// It would touch beyond the rim, and its fields take all memory.
TEST(PotentialLoading, ATipTooWideForTheSurfaceIsRefused) {
  std::string text = text_of("potential");
  const std::string tip = "tip_radius_nm = 20.0";
  text.replace(text.find(tip), tip.size(), "tip_radius_nm = 9000.0");
  try {
    parse_scene(text, "waves.toml");
    FAIL() << "taken";
  } catch (const UserError& error) {
    EXPECT_NE(
        std::string(error.what()).find("'tip_radius_nm' in [probe]: 9000 nm is too wide for a surface of"),
        std::string::npos)
        << error.what();
  }
}

TEST(PotentialSummary, TermsAreLeftOutOnTheSameFields) {
  const auto scene = parse_scene(text_of("potential"), "waves.toml");
  bool friction = false, ground = false, attraction = false;
  for (const WithoutTerm& without : without_each_term(*scene)) {
    if (without.term == "friction")
      friction = without.scene->potential != nullptr && !without.scene->friction;
    if (without.term == "van der Waals") {
      attraction = true;
      EXPECT_EQ(&without.scene->potential->fields(), &scene->potential->fields());
      EXPECT_FALSE(without.scene->potential->potential().law().parameters().van_der_waals);
    }
    if (without.term == "one potential of tip and ground") ground = without.scene->potential == nullptr;
  }
  EXPECT_TRUE(friction && ground && attraction);
}

// A second start takes what the first has made, and says so; a file that was spoiled between is made anew.
TEST(PotentialLoading, FieldsAreMadeOnceAndTold) {
  char folder[] = "/tmp/telenano_loading_XXXXXX";
  ASSERT_NE(::mkdtemp(folder), nullptr);
  std::vector<double> parts;
  SceneLoading loading;
  loading.fields_cache = std::string(folder) + "/fields";
  loading.progress = [&parts](double part) { parts.push_back(part); };
  const auto hash_of = [](const Scene& scene) {
    return dynamic_cast<const physics::ScanFields&>(scene.potential->fields()).hash();
  };
  const auto made = parse_scene(text_of("potential"), "waves.toml", loading);
  EXPECT_FALSE(made->ground.fields_from_cache);
  EXPECT_GT(made->ground.fields_bytes, 100000u);
  ASSERT_GT(parts.size(), 3u);
  EXPECT_TRUE(std::is_sorted(parts.begin(), parts.end()));
  EXPECT_NEAR(parts.back(), 1.0, 1e-12);
  parts.clear();
  const auto kept = parse_scene(text_of("potential"), "waves.toml", loading);
  EXPECT_TRUE(kept->ground.fields_from_cache);
  EXPECT_TRUE(parts.empty());
  EXPECT_EQ(hash_of(*kept), hash_of(*made));
  for (const auto& file : std::filesystem::directory_iterator(loading.fields_cache)) {
    std::filesystem::resize_file(file.path(), file.file_size() - 8);
  }
  EXPECT_FALSE(parse_scene(text_of("potential"), "waves.toml", loading)->ground.fields_from_cache);
  EXPECT_TRUE(parse_scene(text_of("potential"), "waves.toml", loading)->ground.fields_from_cache);
  // Another material has another softening, and so other fields.
  std::string soft = text_of("potential");
  soft.replace(soft.find("70.0"), 4, "3.0");
  EXPECT_FALSE(parse_scene(soft, "waves.toml", loading)->ground.fields_from_cache);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace telenano::scene

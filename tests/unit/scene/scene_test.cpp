#include "telenano/nve_server/scene/scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/scene/scene_summary.h"
#include "telenano/nve_server/scene/scene_terms.h"
#include "tests/source_dir.h"

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
  EXPECT_NEAR(scene->cantilever.stiffness_n_m(), 169e9 * 30e-6 * 64e-18 / (4 * 125e-6 * 125e-6 * 125e-6),
              1e-9);
}

TEST_F(SceneFile, EveryMistakeIsOneLine) {
  EXPECT_EQ(error_of("youngs_modulus_gpa = 70.0", "youngs_modulus_pa = 7e10"),
            "s.toml:3: unknown key 'youngs_modulus_pa' in [sample]; did you mean 'youngs_modulus_gpa'?");
  EXPECT_EQ(error_of("poisson_ratio = 0.27", "poisson_ratio = 0.51"),
            "s.toml:4: 'poisson_ratio' in [sample] is 0.51, expected a number in (-1, 0.5]");
  EXPECT_EQ(error_of("surface_energy_j_m2 = 0.2", "surface_energy_j_m2 = 0"),
            "s.toml:5: 'surface_energy_j_m2' in [sample] is 0, expected a number in [1e-05, 10]");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"flut\""),
            "s.toml:7: 'kind' in [surface] is 'flut', expected one of 'flat', 'plane', 'step', 'sphere', "
            "'grating', 'scan'");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"scan\""),
            "s.toml:6: missing key 'file' in [surface] (expected a text in quotes)");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"scan\"\nfile = \"none.gsf\""),
            "none.gsf: the scan cannot be read: No such file or directory");
  EXPECT_EQ(error_of("kind = \"flat\"", "kind = \"flat\"\nfile = \"none.gsf\""),
            "s.toml:8: unknown key 'file' in [surface]");
  EXPECT_EQ(error_of("stiffness_n_m = 40.0\n", ""),
            "s.toml:8: 'stiffness_n_m' in [probe]: missing; expected one of stiffness_n_m, [probe.beam] or "
            "rigid = true");
  // One that is there, spelt otherwise, is not missing.
  EXPECT_EQ(error_of("stiffness_n_m = 40.0\n", "stifness_n_m = 40.0\n"),
            "s.toml:10: unknown key 'stifness_n_m' in [probe]; did you mean 'stiffness_n_m'?");
  EXPECT_EQ(
      error_of("stiffness_n_m = 40.0\n", "stiffness_n_m = 40.0\nrigid = true\n"),
      "s.toml:10: 'stiffness_n_m' in [probe]: give only one of stiffness_n_m, [probe.beam] and rigid = true");
  EXPECT_EQ(error_of("force_max_nn = 500.0", "force_max_nn = 40.0"),
            "s.toml:18: 'force_max_nn' in [limits]: is 40, expected more than the attraction of this tip, "
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

TEST_F(SceneFile, AHamakerConstantOfItsOwnHoldsWhateverWIs) {
  const auto distance_nm = [&](const std::string& work, const std::string& more) {
    const auto scene =
        load_scene(write("[coupling]", "[contact]\nhamaker_aj = 0.1\nwork_of_adhesion_j_m2 = " + work + more +
                                           "\n[coupling]"));
    return scene->law_parameters.equilibrium_distance_nm;
  };
  // z0 = sqrt(H/(12 pi w)), by hand.
  EXPECT_NEAR(distance_nm("0.1", ""), 0.162867504, 1e-8);
  EXPECT_NEAR(distance_nm("0.4", ""), 0.081433752, 1e-8);
  // In humid air w becomes the dry contact's: H stays.
  const auto humid = load_scene(
      write("[coupling]",
            "[contact]\nhamaker_aj = 0.1\nwork_of_adhesion_j_m2 = 0.4\n[forces.capillary]\nhumidity_percent "
            "= 40.0\nadhesion = \"ambient\"\n[coupling]"));
  const auto& law = humid->law_parameters;
  EXPECT_NE(law.work_of_adhesion_n_m, 0.4);
  EXPECT_NEAR(12 * 3.14159265358979 * law.equilibrium_distance_nm * law.equilibrium_distance_nm *
                  law.work_of_adhesion_n_m,
              0.1, 1e-12);
  const std::pair<const char*, const char*> wrong[] = {
      {"equilibrium_distance_nm = 0.2\nhamaker_aj = 0.1", "give one of them"},
      {"hamaker_aj = 100.0", "equilibrium distance of"},
      {"hamaker_aj = 0.1\n[forces]\nvan_der_waals = false", "switches off"},
      {"hamaker_aj = -1.0", "hamaker_aj"}};
  for (const auto& [text, said] : wrong) {
    try {
      load_scene(write("[coupling]", std::string("[contact]\n") + text + "\n[coupling]"));
      ADD_FAILURE() << text;
    } catch (const UserError& error) {
      EXPECT_NE(std::string(error.what()).find(said), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
}

TEST_F(SceneFile, EveryTermIsBuiltFromItsSection) {
  const auto scene = load_scene(write("[coupling]", R"([contact]
law = "maugis-dugdale"
equilibrium_distance_nm = 0.2
work_of_adhesion_j_m2 = 0.1
[forces]
retardation_nm = 100.0
cone_half_angle_deg = 15.0
cone_height_nm = 1000.0
[forces.electrostatic]
tip_bias_v = -2.0
[forces.capillary]
humidity_percent = 40.0
film_nm = 0.3
[friction]
shear_strength_mpa = 200.0
coefficient = 0.1
kinetic_ratio = 0.8
[particle]
radius_nm = 25.0
x_nm = 60.0
y_nm = 0.0
[particle.material]
youngs_modulus_gpa = 78.0
poisson_ratio = 0.44
surface_energy_j_m2 = 0.5
[particle.friction]
sample_shear_strength_mpa = 50.0
rolling_length_nm = 0.2
[coupling])"));
  const auto& law = scene->law_parameters;
  EXPECT_EQ(law.model, physics::ContactLaw::kMaugisDugdale);
  EXPECT_EQ(law.equilibrium_distance_nm, 0.2);
  EXPECT_EQ(law.work_of_adhesion_n_m, 0.1);
  EXPECT_EQ(law.long_range.retardation_nm, 100.0);
  EXPECT_EQ(law.long_range.cone_half_angle_deg, 15.0);
  EXPECT_EQ(law.long_range.tip_bias_v, -2.0);
  EXPECT_EQ(law.long_range.capillary.humidity_percent, 40.0);
  EXPECT_EQ(law.long_range.capillary.film_nm, 0.3);
  ASSERT_TRUE(scene->friction);
  EXPECT_DOUBLE_EQ(scene->friction->shear_strength_gpa, 0.2);
  EXPECT_EQ(scene->friction->coefficient, 0.1);
  // 1/G* = sum of (2 - nu) 2 (1 + nu)/E, by hand for 70 GPa and 160 GPa, both nu = 0.27: 4.3942 (1/70 +
  // 1/160).
  EXPECT_NEAR(scene->friction->shear_modulus_gpa, 1 / (1.73 * 2.54 * (1 / 70.0 + 1 / 160.0)), 1e-12);
  ASSERT_TRUE(scene->particle);
  EXPECT_EQ(scene->particle->parameters.particle_radius_nm, 25.0);
  EXPECT_NEAR(scene->particle->parameters.particle_sample.work_of_adhesion_n_m, 2 * std::sqrt(0.5 * 0.2),
              1e-12);
  EXPECT_NEAR(scene->particle->parameters.tip_particle.contact_modulus_gpa,
              4 / 3.0 / ((1 - 0.0729) / 160 + (1 - 0.1936) / 78), 1e-12);
  EXPECT_DOUBLE_EQ(scene->particle->parameters.particle_sample_friction.shear_strength_gpa, 0.05);
}

TEST_F(SceneFile, EveryLawAndShapeHasAName) {
  for (const physics::ContactLaw law : physics::kContactLaws) {
    if (law == physics::ContactLaw::kHertz) continue;  // below: it goes without van der Waals
    const std::string name(physics::contact_law_name(law));
    const auto scene = load_scene(write("[coupling]", "[contact]\nlaw = \"" + name + "\"\n[coupling]"));
    EXPECT_EQ(scene->law_parameters.model, law);
  }
  EXPECT_EQ(load_scene(write("[coupling]",
                             "[contact]\nlaw = \"hertz\"\n[forces]\nvan_der_waals = false\n[coupling]"))
                ->law_parameters.model,
            physics::ContactLaw::kHertz);
  EXPECT_EQ(
      load_scene(write("[coupling]", "[contact]\nmethod = \"table\"\n[coupling]"))->law_parameters.method,
      physics::MaugisMethod::kTable);
  const auto tilted = load_scene(write("\"flat\"", "\"plane\"\nslope_x = 0.1"));
  EXPECT_NEAR(tilted->surface->height_nm(50, 3), 5.0, 1e-12);
  const auto ball = load_scene(write("\"flat\"", "\"sphere\"\nradius_nm = 30.0"));
  EXPECT_NEAR(ball->start_touch_w_nm, 30.0, 1e-9);
  const auto step = load_scene(write("\"flat\"", "\"step\"\nheight_nm = 5.0\nx_nm = 50.0"));
  EXPECT_NEAR(step->surface->height_nm(0, 0), 0.0, 1e-6);
  EXPECT_NEAR(step->surface->height_nm(100, 0), 5.0, 1e-6);
  const auto grating = load_scene(write("\"flat\"", "\"grating\"\nheight_nm = 4.0\nperiod_nm = 60.0"));
  EXPECT_NEAR(grating->surface->height_nm(30, 0), 4.0, 1e-3);
  const auto soft = load_scene(write("surface_energy_j_m2 = 0.2\n[surface]",
                                     "surface_energy_j_m2 = 0.2\nhardness_gpa = 1.0\n[surface]"));
  ASSERT_TRUE(soft->marks);
  EXPECT_FALSE(soft->surface->is_flat());
}

TEST_F(SceneFile, EveryMistakeInATermIsOneLine) {
  const auto with = [&](const std::string& text) { return error_of("[coupling]", text + "\n[coupling]"); };
  EXPECT_EQ(
      with("[contact]\nlaw = \"hertzian\""),
      "s.toml:16: 'law' in [contact] is 'hertzian', expected one of 'hertz', 'dmt', 'jkr', 'maugis-dugdale', "
      "'cos', 'pietrement-troyon', 'schwarz'");
  EXPECT_NE(with("[contact]\nlaw = \"hertz\"").find("law = \"hertz\" has no adhesion"), std::string::npos);
  EXPECT_NE(with("[contact]\nlaw = \"jkr\"\nmethod = \"table\"").find("only maugis-dugdale has a table"),
            std::string::npos);
  EXPECT_NE(with("[contact]\nlaw = \"jkr\"\n[forces]\nretardation_nm = 100.0").find("need law"),
            std::string::npos);
  EXPECT_NE(with("[forces]\nvan_der_waals = false\nretardation_nm = 100.0").find("switches off"),
            std::string::npos);
  EXPECT_NE(with("[forces]\ncone_half_angle_deg = 15.0").find("'cone_height_nm' in [forces]: missing"),
            std::string::npos);
  EXPECT_NE(with("[forces.capillary]\nhumidity_percent = 100.0").find("(0, 99]"), std::string::npos);
  EXPECT_NE(with("[forces.capillary]\ncontact_angle_tip_deg = 10.0").find("missing key 'humidity_percent'"),
            std::string::npos);
  EXPECT_NE(with("[forces.electrostatic]\nbias = 1.0").find("missing key 'tip_bias_v'"), std::string::npos);
  EXPECT_NE(with("[friction]\nkinetic_ratio = 0.5").find("needs a shear strength"), std::string::npos);
  // 50.27 nN of adhesion; of a bridge 4 pi R gamma c = 18.3 nN, which it takes from the adhesion.
  EXPECT_NE(
      error_of("[coupling]\nstiffness_n_m = 20.0\n[limits]\nforce_max_nn = 500.0",
               "[forces.capillary]\nhumidity_percent = 50.0\n[coupling]\nstiffness_n_m = 20.0\n[limits]\n"
               "force_max_nn = 50.0")
          .find("attraction of this tip, 50.26"),
      std::string::npos);
  EXPECT_NE(with("[marks]\nspacing_nm = 1.0").find("marks need [sample] hardness_gpa"), std::string::npos);
  EXPECT_NE(with("[particle]\nradius_nm = 20.0\nx_nm = 0.0\ny_nm = 0.0").find("[particle]"),
            std::string::npos);
  EXPECT_NE(error_of("stiffness_n_m = 40.0\n", "stiffness_n_m = 40.0\nlateral_stiffness_n_m = 1e9\n")
                .find("'lateral_stiffness_n_m' in [probe] is 1000000000, expected"),
            std::string::npos);
  EXPECT_NE(
      error_of("stiffness_n_m = 40.0\n", "rigid = true\ntilt_deg = 11.0\n").find("a rigid probe has none"),
      std::string::npos);
  EXPECT_NE(
      error_of("poisson_ratio = 0.27", "poisson_ratio = 0.27\nhardness_gpa = -1.0").find("hardness_gpa"),
      std::string::npos);
  EXPECT_NE(error_of("\"flat\"", "\"step\"\nheight_nm = 5.0\nedge_nm = 0.2").find("[surface]"),
            std::string::npos);
}

TEST_F(SceneFile, SummarySaysWhatIsInAndWhereModelsEnd) {
  const auto plain = summarise(*load_scene(write()));
  EXPECT_EQ(plain.terms_in,
            (std::vector<std::string>{"maugis-dugdale contact", "van der Waals", "cantilever"}));
  EXPECT_TRUE(plain.warnings.empty());
  // (H R/(3k))^(1/3) with H = 12 pi a0^2 w = 24 pi 0.165^2 0.2 aJ and k = 13.33 N/m: 0.590 nm.
  EXPECT_NEAR(plain.jump_to_contact_nm, std::cbrt(24 * M_PI * 0.165 * 0.165 * 0.2 * 20 / (3 * 40 / 3.0)),
              1e-6);
  const auto warning_of = [&](const std::string& from, const std::string& to) {
    const auto summary = summarise(*load_scene(write(from, to)));
    std::string all;
    for (const auto& text : summary.warnings) all += text + "\n";
    return all;
  };
  EXPECT_NE(warning_of("youngs_modulus_gpa = 70.0", "youngs_modulus_gpa = 0.01").find("half-space"),
            std::string::npos);
  EXPECT_NE(warning_of("youngs_modulus_gpa = 70.0", "youngs_modulus_gpa = 20.0").find("such a sample yields"),
            std::string::npos);
  EXPECT_NE(warning_of("surface_energy_j_m2 = 0.2\n[surface]",
                       "surface_energy_j_m2 = 0.2\nhardness_gpa = 1.0\n[surface]")
                .find("above the hardness"),
            std::string::npos);
  EXPECT_NE(warning_of("stiffness_n_m = 40.0", "stiffness_n_m = 0.1").find("linear range"),
            std::string::npos);
  EXPECT_NE(
      warning_of("[coupling]\nstiffness_n_m = 20.0", "[coupling]\nstiffness_n_m = 0.001").find("hold height"),
      std::string::npos);
  EXPECT_NE(warning_of("\"flat\"", "\"grating\"\nheight_nm = 4.0\nperiod_nm = 600.0\nspacing_nm = 15.0")
                .find("too coarse"),
            std::string::npos);
}

// The pull-off that a person will find is that of all terms, not of the dry contact alone.
TEST_F(SceneFile, SummarysPullOffHasAllTerms) {
  const auto with = [&](const std::string& forces) {
    return summarise(*load_scene(write("[coupling]", forces + "\n[coupling]")));
  };
  EXPECT_NEAR(with("").pull_off_nn, 41.4015, 1e-4);  // of the source paper
  const std::string moist =
      "[forces.capillary]\nhumidity_percent = 50.0\ncontact_angle_tip_deg = 20.0\n"
      "contact_angle_sample_deg = 20.0\n";
  const auto wet = with(moist);
  // As in WetContact.ElasticPullOffIsTheWettedContactsAndTheMeniscus.
  EXPECT_NEAR(wet.pull_off_nn, 44.4, 0.1);
  EXPECT_NEAR(wet.dry_contact_pull_off_nn, 41.4015, 1e-4);
  EXPECT_TRUE(wet.warnings.empty()) << wet.warnings.front();
  // A capacitor of 10 V beside the contact: pi eps0 V^2 R^2/(d (d + R)) at the cut-off 0.165 nm is 334.4 nN,
  // beyond it less; the contact parts within 0.01 nm of touch.
  const auto biased = with("[forces.electrostatic]\ntip_bias_v = 10.0");
  const auto capacitor = [](double d) { return M_PI * 8.8541878128e-3 * 100 * 20 * 20 / (d * (d + 20)); };
  EXPECT_LE(biased.pull_off_nn, 41.4015 + capacitor(0.165) + 1e-4);
  EXPECT_GE(biased.pull_off_nn, 0.97 * 41.4015 + capacitor(0.175));
  // Measured in this air it has the bridge in it.
  EXPECT_NEAR(with(moist + "adhesion = \"ambient\"\n").pull_off_nn, 41.4015, 1e-3);
  // None forms where it reaches no farther than what it displaces: then it is the dry one, which is said.
  const auto dry = with("[forces.capillary]\nhumidity_percent = 1e-6");
  EXPECT_EQ(dry.pull_off_nn, with("").pull_off_nn);
  ASSERT_EQ(dry.warnings.size(), 1u);
  EXPECT_NE(dry.warnings[0].find("no liquid bridge forms at a humidity of 1e-06 %"), std::string::npos)
      << dry.warnings[0];
}

TEST_F(SceneFile, SummarySaysWhereTheBridgeIsFormal) {
  const auto warnings_of = [&](const std::string& sample, const std::string& more) {
    std::string text = kFlat;
    const std::string old =
        "youngs_modulus_gpa = 70.0\npoisson_ratio = 0.27\nsurface_energy_j_m2 = 0.2\n[surface]";
    text.replace(text.find(old), old.size(), sample + "\n[surface]");
    text.replace(text.find("[coupling]"), 10,
                 "[forces.capillary]\nhumidity_percent = 50.0\n" + more + "\n[coupling]");
    std::string all;
    for (const auto& warning : summarise(*parse_scene(text, "test")).warnings) all += warning + "\n";
    return all;
  };
  // PDMS of the source paper: w = 2 sqrt(0.2 * 0.022) = 0.1327, 2 gamma = 0.1456 J/m^2.
  const std::string pdms = "youngs_modulus_gpa = 0.001\npoisson_ratio = 0.5\nsurface_energy_j_m2 = 0.022";
  const std::string contradiction = warnings_of(pdms, "");
  EXPECT_NE(contradiction.find("w - 2 gamma c = 0.133 - 0.146 = -0.0129 J/m2"), std::string::npos)
      << contradiction;
  EXPECT_NE(contradiction.find("the meniscus would deform this sample"), std::string::npos) << contradiction;
  const std::string angles = warnings_of(pdms, "contact_angle_sample_deg = 85.0");
  EXPECT_EQ(angles.find("contradict"), std::string::npos) << angles;
  EXPECT_NE(angles.find("the meniscus would deform this sample"), std::string::npos) << angles;
  EXPECT_EQ(warnings_of("youngs_modulus_gpa = 70.0\npoisson_ratio = 0.27\nsurface_energy_j_m2 = 0.2", ""),
            "");
}

// A term that is left out is not computed, and all else is: what `check` prices.
TEST(SceneTerms, EachIsLeftOutAlone) {
  const std::string folder = std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/";
  const auto humid = load_scene(folder + "humid_flakes.toml");
  std::vector<std::string> names;
  for (const WithoutTerm& without : without_each_term(*humid)) {
    names.push_back(without.term);
    const SceneSummary before = summarise(*humid);
    const SceneSummary after = summarise(*without.scene);
    const auto has = [&](const SceneSummary& summary) {
      return std::any_of(summary.terms_in.begin(), summary.terms_in.end(),
                         [&](const std::string& term) { return term.starts_with(without.term); });
    };
    EXPECT_TRUE(has(before)) << without.term;
    EXPECT_FALSE(has(after)) << without.term;
    const bool takes_another = without.term == "van der Waals";  // retardation
    const std::size_t left = before.terms_in.size() - (takes_another ? 2 : 1);
    EXPECT_EQ(after.terms_in.size(), left) << without.term;
  }
  EXPECT_EQ(names,
            (std::vector<std::string>{"van der Waals", "retardation", "cone", "capillary bridge", "friction",
                                      "lateral bending", "one potential of tip and ground"}));
}

TEST_F(SceneFile, SummarySaysHowThePullOffVariesOverAScan) {
  const auto scene = load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flakes.toml");
  const SceneSummary summary = summarise(*scene);
  EXPECT_EQ(summary.pull_off_places, 400);
  EXPECT_GT(summary.pull_off_low_nn, 0);
  EXPECT_LT(summary.pull_off_low_nn, summary.pull_off_median_nn);
  EXPECT_LT(summary.pull_off_median_nn, summary.pull_off_high_nn);
  // Adhesion goes with the radius, which is at least that of the tip on a summit as sharp as itself.
  EXPECT_LT(summary.pull_off_low_nn, summary.pull_off_nn);
  EXPECT_GT(summary.pull_off_high_nn, summary.pull_off_nn);
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
    const auto& law = scene->law();
    EXPECT_NEAR(law.lambda(20.0), sample.lambda, 1e-5 * sample.lambda);
    EXPECT_NEAR(law.pull_off_nn(20.0), sample.pull_off_nn, 1e-5 * sample.pull_off_nn);
  }
}

}  // namespace
}  // namespace telenano::scene

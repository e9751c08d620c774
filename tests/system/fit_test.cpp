// Many curves at once through the real program: pictures of what was found, one bad file among good ones.
#include <cstring>
#include <filesystem>
#include <sstream>

#include "telenano/common/base/random.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

class FitTest : public ProgramsTest {
 protected:
  /// A curve of the scene with another modulus and what is added, as `curve` prints it.
  std::string curve(const std::string& modulus_gpa, const std::string& name, const std::string& added = {}) {
    std::string text = file_text(scene_path("flat_polystyrene"));
    const std::string key = "youngs_modulus_gpa = 2.0";
    const auto at = text.find(key);
    EXPECT_NE(at, std::string::npos);
    text.replace(at, key.size(), "youngs_modulus_gpa = " + modulus_gpa);
    text += added;
    const Finished run = run_program({kNve, "curve", "--scene", write(name + ".toml", text), "--from-nm",
                                      "20", "--to-nm", "-6", "--step-nm", "0.05"},
                                     {}, kLong);
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return write(name + ".csv", run.out);
  }
  Finished fit(const std::vector<std::string>& more) {
    std::vector<std::string> all{
        kNve, "fit", "--scene", scene_path("flat_polystyrene"), "-o", path("fitted.toml")};
    all.insert(all.end(), more.begin(), more.end());
    return run_program(all, {}, kLong);
  }
};

TEST_F(FitTest, CurvesOnAGridBecomePictures) {
  const std::vector<std::string> curves{curve("1.5", "a"), curve("2.0", "b"), curve("2.5", "c"),
                                        write("bad.csv", "no curve\n")};
  std::vector<std::string> flags = curves;
  flags.insert(flags.end(), {"--map", path("maps"), "--map-grid", "2x2", "--map-size-nm", "200x100"});
  const Finished run = fit(flags);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("bad.csv"), std::string::npos) << run.err;
  EXPECT_NE(run.out.find("1 places without a fit"), std::string::npos) << run.out;
  const std::string bytes = file_text(path("maps/E.gsf"));
  const auto text = bytes.find('\0');
  const auto at = [&](std::size_t pixel) {
    float value = 0;
    std::memcpy(&value, bytes.data() + (text / 4 + 1) * 4 + 4 * pixel, 4);
    return value;
  };
  // Rows from the top: c and the bad one's median, then a and b. A noiseless curve tells E to some 1e-3.
  EXPECT_NEAR(at(0), 2.5e9, 0.02e9);
  EXPECT_NEAR(at(1), 2.0e9, 0.02e9);
  EXPECT_NEAR(at(2), 1.5e9, 0.02e9);
  EXPECT_NEAR(at(3), 2.0e9, 0.02e9);
  EXPECT_NE(bytes.find("ZUnits = Pa"), std::string::npos);
  EXPECT_NE(file_text(path("maps/w.gsf")).find("ZUnits = J/m2"), std::string::npos);
}

TEST_F(FitTest, HumidityAndFilmComeIntoTheScene) {
  const auto water = [](const std::string& humidity, const std::string& film) {
    return "\n[forces.capillary]\nhumidity_percent = " + humidity + "\nfilm_nm = " + film +
           "\nadhesion = \"dry\"\n";
  };
  // With noise: a curve without any is led to 1e-6 of its range, which takes its time.
  std::string noisy = "direction,z_nm,deflection_nm\n";
  Random random(3);
  for (const std::string& line : lines_of(file_text(curve("2.0", "humid", water("55.0", "0.7"))))) {
    std::istringstream fields(line);
    std::string field[6];
    for (std::string& each : field) std::getline(fields, each, ',');
    if (field[0] == "direction" || field[5].empty()) continue;
    noisy += field[0] + ',' + field[1] + ',' + std::to_string(std::stod(field[5]) + 0.003 * random.normal()) +
             '\n';
  }
  const std::string made = write("noisy.csv", noisy);
  const std::string start =
      write("start.toml", file_text(scene_path("flat_polystyrene")) + water("40.0", "0.4"));
  const Finished run = run_program({kNve, "fit", made, "--scene", start, "-o", path("fitted.toml"), "--also",
                                    "humidity", "film", "--table", path("table.csv")},
                                   {}, kLong);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::string text = file_text(path("fitted.toml"));
  const auto value = [&](const std::string& key) {
    const auto at = text.find("\n" + key + " = ");
    return at == std::string::npos ? -1.0 : std::stod(text.substr(at + key.size() + 4));
  };
  EXPECT_NEAR(value("humidity_percent"), 55, 0.3) << text;
  // A point of the curve is 0.05 nm from the next: where the bridge forms is known to that.
  EXPECT_NEAR(value("film_nm"), 0.7, 0.06) << text;
  EXPECT_NE(file_text(path("table.csv")).find(",humidity_percent,humidity_low_percent,"), std::string::npos);
  EXPECT_EQ(run_program({kNve, "check", "--scene", path("fitted.toml")}, {}, kLong).exit_code, 0);
  const Finished dry = fit({made, "--force", "--also", "film"});
  EXPECT_EQ(dry.exit_code, 2);
  EXPECT_NE(dry.err.find("has no capillary bridge, whose film could be fitted"), std::string::npos)
      << dry.err;
}

TEST_F(FitTest, AMapThatDoesNotFitItsCurvesIsRefusedBeforeAnythingIsFitted) {
  const std::string one = curve("2.0", "one");
  const std::pair<std::vector<std::string>, const char*> wrong[] = {
      {{one, "--map", path("m")}, "--map-grid is ''"},
      {{one, "--map", path("m"), "--map-grid", "2x1", "--map-size-nm", "1x1"}, "2 places"},
      {{one, "--map", path("m"), "--map-grid", "1.5x1", "--map-size-nm", "1x1"}, "--map-grid is '1.5x1'"},
      {{one, "--map", path("m"), "--map-grid", "1x1", "--map-size-nm", "-1x1"}, "--map-size-nm"},
      {{one, "--map-grid", "1x1"}, "--map FOLDER"}};
  for (const auto& [flags, said] : wrong) {
    const Finished run = fit(flags);
    EXPECT_EQ(run.exit_code, 2) << said;
    EXPECT_EQ(lines_of(run.err).size(), 1u) << run.err;
    EXPECT_NE(run.err.find(said), std::string::npos) << run.err;
  }
  EXPECT_FALSE(std::filesystem::exists(path("fitted.toml")));
}

}  // namespace
}  // namespace telenano::programs

// What the programs print for other programs: columns, digits, and numbers that are known from elsewhere.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>

#include "telenano/common/config/slave_limits_file.h"
#include "telenano/master/app/devices/device_kinds.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  std::size_t begin = 0;
  for (;;) {
    const std::size_t end = line.find(',', begin);
    cells.push_back(line.substr(begin, end - begin));
    if (end == std::string::npos) return cells;
    begin = end + 1;
  }
}

/// The value of a cell, which must be written with 15 significant digits: what %.15g makes of its value.
double number_of(const std::string& cell) {
  char* end = nullptr;
  const double value = std::strtod(cell.c_str(), &end);
  EXPECT_TRUE(!cell.empty() && *end == '\0' && std::isfinite(value)) << "'" << cell << "' is no number";
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.15g", value);
  EXPECT_EQ(cell, text.data());
  return value;
}

/// Significant digits as written.
std::size_t digits_of(const std::string& cell) {
  std::size_t digits = 0;
  for (const char c : cell.substr(0, cell.find('e'))) {
    if (std::isdigit(static_cast<unsigned char>(c)) != 0 && (digits > 0 || c != '0')) ++digits;
  }
  return digits;
}

using Table = std::vector<std::vector<std::string>>;

/// Runs a program that must print this header and rows of as many cells.
Table csv_of(const std::vector<std::string>& command, const std::string& header) {
  const Finished run = run_program(command);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.err, "");
  Table table;
  const auto lines = lines_of(run.out);
  EXPECT_FALSE(lines.empty());
  if (lines.empty()) return table;
  EXPECT_EQ(lines[0], header);
  EXPECT_EQ(run.out.back(), '\n');
  EXPECT_EQ(run.out.find('\r'), std::string::npos);
  const std::size_t columns = cells_of(header).size();
  for (std::size_t i = 1; i < lines.size(); ++i) {
    table.push_back(cells_of(lines[i]));
    EXPECT_EQ(table.back().size(), columns) << lines[i];
    if (table.back().size() != columns) return {};
  }
  return table;
}

const char* const kContactHeader = "lambda,delta,force,contact_radius,branch";
const char* const kPointsHeader =
    "lambda,pull_off_load,delta_fold,radius_zero_load,delta_zero_load,loop_energy";
const char* const kCurveHeader =
    "direction,base_z_nm,tip_z_nm,overlap_nm,force_nn,deflection_nm,branch,work_aj";

/// Maugis-Dugdale reference numbers, from 50-digit arithmetic, as many digits as were printed there.
struct Reference {
  const char* lambda;
  double pull_off;              // load control
  double radius_at_zero;        // A(P=0)
  double delta_at_zero;         // Δ(P=0)
  std::array<double, 4> force;  // at Δ = 0, 1, 5, 10
};
constexpr std::array<Reference, 4> kReference{{
    {"0.1", -1.950594892, 1.336179808, 1.292425345, {-1.749351, -0.502406, 9.893073, 30.416525}},
    {"0.5", -1.718245275, 1.517383526, 1.165133729, {-1.491800, -0.272585, 10.050565, 30.535605}},
    {"1", -1.600734911, 1.636090490, 1.129893891, {-1.405467, -0.211010, 10.084651, 30.559663}},
    {"10", -1.501624860, 1.812624954, 1.101142087, {-1.334525, -0.162079, 10.111598, 30.578908}},
}};
constexpr double kNinthDigit =
    0.5000001e-9;  // half of the last printed digit, and the rounding of the literal
constexpr double kSixthDigit = 0.5000001e-6;

TEST(ContactOutput, PointsAreTheReferenceNumbers) {
  const Table table =
      csv_of({kLab, "contact", "--law", "md", "--lambda", "0.1,0.5,1,10", "--points"}, kPointsHeader);
  ASSERT_EQ(table.size(), kReference.size());
  for (std::size_t i = 0; i < table.size(); ++i) {
    SCOPED_TRACE(kReference[i].lambda);
    EXPECT_EQ(table[i][0], kReference[i].lambda);
    std::array<double, 6> v{};
    for (std::size_t k = 0; k < 6; ++k) v[k] = number_of(table[i][k]);
    EXPECT_NEAR(v[1], kReference[i].pull_off, kNinthDigit);
    EXPECT_NEAR(v[3], kReference[i].radius_at_zero, kNinthDigit);
    EXPECT_NEAR(v[4], kReference[i].delta_at_zero, kNinthDigit);
    EXPECT_GE(digits_of(table[i][1]), 14u);  // 15, unless the last is a zero
    EXPECT_GT(v[5], 0) << "a loop that creates energy";
    EXPECT_LT(v[5], 1.274941029);  // its value for λ → ∞
  }
  // W = (17π/24)(8/3π)⁴λ⁵ for λ ≤ 0.655: a closed form, 1e-12 for the cancellation of two energies of
  // order 1.
  const double pi = std::acos(-1.0);
  const double ratio = 8 / (3 * pi);
  for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
    const double lambda = std::strtod(kReference[i].lambda, nullptr);
    EXPECT_NEAR(number_of(table[i][5]), 17 * pi / 24 * std::pow(ratio, 4) * std::pow(lambda, 5), 1e-12);
  }
}

TEST(ContactOutput, ForcesAreTheReferenceNumbers) {
  const Table table = csv_of(
      {kLab, "contact", "--law", "md", "--lambda", "0.1,0.5,1,10", "--delta", "0,1,5,10"}, kContactHeader);
  ASSERT_EQ(table.size(), 16u);
  const std::array<const char*, 4> deltas{"0", "1", "5", "10"};
  for (std::size_t i = 0; i < 16; ++i) {  // λ is the outer loop
    EXPECT_EQ(table[i][0], kReference[i / 4].lambda);
    EXPECT_EQ(table[i][1], deltas[i % 4]);
    EXPECT_NEAR(number_of(table[i][2]), kReference[i / 4].force[i % 4], kSixthDigit) << i;
    EXPECT_GT(number_of(table[i][3]), 0) << i;
    EXPECT_EQ(table[i][4], "contact") << i;
    EXPECT_GE(digits_of(table[i][2]), 14u);  // 15, unless the last is a zero
  }
}

TEST(ContactOutput, BranchesFollowTheDirection) {
  // H₀ = 2/(πλ): exactly there the tip is still free on approach, and already bound on retract.
  std::array<char, 40> edge{};
  std::snprintf(edge.data(), edge.size(), "%.17g", -2 / (std::acos(-1.0) * 1.0));
  const std::string list = std::string("-5,") + edge.data() + ",0.5,2," + edge.data() + ",-5";
  const Table approach =
      csv_of({kLab, "contact", "--law", "md", "--lambda", "1", "--delta", list}, kContactHeader);
  const Table retract = csv_of({kLab, "contact", "--law", "md", "--lambda", "1", "--delta",
                                std::string("2,") + edge.data() + ",-5", "--direction", "retract"},
                               kContactHeader);
  ASSERT_EQ(approach.size(), 6u);
  ASSERT_EQ(retract.size(), 3u);
  for (const std::size_t i : {std::size_t{0}, std::size_t{1}, std::size_t{5}}) {
    EXPECT_EQ(approach[i][2], "0");
    EXPECT_EQ(approach[i][3], "0");
    EXPECT_EQ(approach[i][4], "free");
  }
  EXPECT_EQ(approach[2][4], "contact");
  EXPECT_LT(number_of(approach[2][2]), 0) << "attraction is negative";
  EXPECT_GT(number_of(approach[3][2]), 0);
  EXPECT_EQ(approach[3], retract[0]);
  EXPECT_EQ(retract[2][4], "free");
  // The example of the documentation.
  EXPECT_EQ(
      csv_of({kLab, "contact", "--law", "md", "--lambda", "1", "--delta", "0,0.5,1,2,5,10"}, kContactHeader)
          .size(),
      6u);
  // For small λ the edge on retract is on the non-contact branch.
  std::snprintf(edge.data(), edge.size(), "%.17g", -2 / (std::acos(-1.0) * 0.1));
  const Table soft = csv_of({kLab, "contact", "--law", "md", "--lambda", "0.1", "--delta",
                             std::string("2,") + edge.data(), "--direction", "retract"},
                            kContactHeader);
  ASSERT_EQ(soft.size(), 2u);
  EXPECT_EQ(soft[1][4], "noncontact");
}

struct Row {
  bool approach;
  double base, tip, overlap, force, deflection, work;
  std::string branch;
};

std::vector<Row> curve_of(const std::vector<std::string>& more) {
  std::vector<std::string> command{kNve, "curve"};
  command.insert(command.end(), more.begin(), more.end());
  std::vector<Row> rows;
  std::size_t most_digits[8] = {};
  for (const auto& cells : csv_of(command, kCurveHeader)) {
    EXPECT_TRUE(cells[0] == "approach" || cells[0] == "retract") << cells[0];
    rows.push_back({cells[0] == "approach", number_of(cells[1]), number_of(cells[2]), number_of(cells[3]),
                    number_of(cells[4]), number_of(cells[5]), number_of(cells[7]), cells[6]});
    for (std::size_t i = 0; i < 8; ++i) most_digits[i] = std::max(most_digits[i], digits_of(cells[i]));
  }
  for (const std::size_t i : {2, 3, 4, 5, 7}) EXPECT_EQ(most_digits[i], 15u) << "column " << i;
  return rows;
}

/// Silicon oxide on silicon, table I of the source paper: pull-off 41.4015 nN, 285.449 nN at 1 nm.
TEST(CurveOutput, SiliconOxideIsTheTablesSiliconOxide) {
  const double k_z = 40;  // of the scene
  const auto rows = curve_of({"--scene", scene_path("flat_silicon_oxide"), "--x-nm", "0", "--y-nm", "0",
                              "--from-nm", "20", "--to-nm", "-5", "--step-nm", "0.01"});
  ASSERT_EQ(rows.size(), 2 * 2501u);
  const std::set<std::string> branches{"free", "vdw", "noncontact", "contact"};
  double lowest = 0;
  bool left = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    EXPECT_EQ(row.approach, i < 2501) << "all approach rows first";
    // Base heights go down and up again in steps; 1e-12 nm is their printed rounding.
    const double step = static_cast<double>(i < 2501 ? i : 5001 - i);
    ASSERT_NEAR(row.base, 20 - 0.01 * step, 1e-12);
    ASSERT_NEAR(row.tip, row.base + row.deflection, 1e-12);
    // A balance: solved to rounding of a stiffness of 1e3 N/m over heights of 20 nm.
    ASSERT_NEAR(row.force, k_z * row.deflection, 1e-9);
    ASSERT_TRUE(branches.count(row.branch) == 1) << row.branch;
    ASSERT_NEAR(row.overlap, -row.tip, 1e-9) << "the plane z = 0: the gap is the height";
    lowest = std::min(lowest, row.force);
    if (!row.approach && row.branch != "contact" && row.branch != "noncontact") left = true;
    if (left) {
      ASSERT_TRUE(row.branch == "vdw" || row.branch == "free") << "snapped in again while retracting";
    }
  }
  EXPECT_TRUE(left);
  EXPECT_EQ(rows.front().work, 0);
  EXPECT_GT(rows.back().work, 0) << "adhesion hysteresis dissipates";
  // The minimum lies between rows 0.01 nm apart: 0.5·F''·(0.005 nm)², F'' below 400 nN/nm² there.
  EXPECT_NEAR(lowest, -41.4015, 0.5e-4 + 0.005);
  EXPECT_GE(lowest, -41.4015 - 0.5e-4);
  // Between the rows around 1 nm of overlap: linear interpolation errs by F''h²/8 with h < 0.01 nm.
  for (std::size_t i = 1; i < 2501; ++i) {
    if (rows[i].overlap < 1 || rows[i - 1].overlap >= 1) continue;
    const double part = (1 - rows[i - 1].overlap) / (rows[i].overlap - rows[i - 1].overlap);
    EXPECT_NEAR(rows[i - 1].force + part * (rows[i].force - rows[i - 1].force), 285.449, 0.5e-3 + 0.01);
  }
  // Work of the base is the integral of the force on it; jumps between rows make no work of the base worth
  // 0.5 aJ.
  double integral = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    integral += -0.5 * (rows[i].force + rows[i - 1].force) * (rows[i].base - rows[i - 1].base);
  }
  EXPECT_NEAR(rows.back().work, integral, 0.5);
}

TEST(CurveOutput, WithoutAPlaceItIsTheStartOfTheScene) {
  const std::vector<std::string> plan{"--from-nm", "5", "--to-nm", "-1", "--step-nm", "0.5"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {kNve, "curve", "--scene", scene_path("flakes")});
    more.insert(more.end(), plan.begin(), plan.end());
    return run_program(more).out;
  };
  const std::string start = with({});
  EXPECT_EQ(lines_of(start).size(), 27u);
  EXPECT_EQ(start, with({"--x-nm", "300", "--y-nm", "300"}));
  EXPECT_EQ(start, with({"--y-nm", "300"}));
  EXPECT_NE(start, with({"--x-nm", "100", "--y-nm", "150"}));
}

// A place of the scan where part of the way has no balance: the table goes on, lines with # stand for the
// missing rows, and one line says how many they are.
TEST(CurveOutput, GoesOnPastPlacesWithoutABalance) {
  const Finished run =
      run_program({kNve, "curve", "--scene", scene_path("flakes"), "--x-nm", "328.46", "--y-nm", "274.75",
                   "--from-nm", "10", "--to-nm", "-6", "--step-nm", "0.02"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  std::size_t missing = 0;
  const auto lines = lines_of(run.out);
  for (const std::string& line : lines) missing += line.rfind("# no balance", 0) == 0;
  EXPECT_EQ(lines.size(), 1 + 2 * 801u);
  EXPECT_EQ(lines_of(run.err).size(), missing > 0 ? 1u : 0u) << run.err;
  if (missing > 0) {
    EXPECT_NE(run.err.find(std::to_string(missing) + " of 1602 places"), std::string::npos) << run.err;
  }
}

TEST(CheckOutput, WritesWhatAStationMayKnow) {
  const std::string path = (std::filesystem::temp_directory_path() / "telenano_check_limits.toml").string();
  const Finished run =
      run_program({kNve, "check", "--scene", scene_path("flat_silicon_oxide"), "--limits", path});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const config::SlaveLimits limits = config::load_slave_limits(path);
  EXPECT_EQ(limits.scene_name, "flat_silicon_oxide");
  EXPECT_EQ(limits.force_max_nn, 500);
  EXPECT_NEAR(limits.coupling_stiffness_n_m, 1 / (1 / 20.0 + 1 / 40.0), 1e-12);
  EXPECT_NE(run.out.find("hash " + limits.scene_hash), std::string::npos);
  std::filesystem::remove(path);
  const Finished bad = run_program(
      {kNve, "check", "--scene", scene_path("flat_silicon_oxide"), "--limits", "/nowhere/l.toml"});
  EXPECT_EQ(bad.exit_code, 1);
  EXPECT_EQ(lines_of(bad.err).size(), 1u) << bad.err;
}

TEST(CheckOutput, SaysWhatIsInAndWhatAStepCosts) {
  for (const char* scene : {"flakes", "flat_silicon_oxide", "flat_polystyrene", "flat_pdms"}) {
    SCOPED_TRACE(scene);
    const Finished run = run_program({kNve, "check", "--scene", scene_path(scene)});
    EXPECT_EQ(run.exit_code, 0) << run.err;
    for (const char* word :
         {"in ", "left out", "lambda", "pull-off", "limits", "workspace", "time a step", "cost of a term"}) {
      EXPECT_NE(run.out.find(word), std::string::npos) << word << "\n" << run.out;
    }
    // Half-space theory is formal on soft silicone: said in one line, elsewhere not.
    const bool formal = std::string(scene) == "flat_pdms";
    if (formal) {
      EXPECT_EQ(lines_of(run.err).size(), 1u);
      EXPECT_NE(run.err.find("0.5"), std::string::npos) << run.err;
    }
  }
}

TEST(Output, ATableThatCannotBeWrittenIsAFailure) {
  ChildOptions full;
  full.out_file = "/dev/full";
  const std::vector<std::vector<std::string>> commands{
      {kLab, "contact", "--lambda", "1", "--delta", "0"},
      {kLab, "contact", "--lambda", "1", "--points"},
      {kNve, "curve", "--scene", scene_path("flat_silicon_oxide")},
      {kNve, "check", "--scene", scene_path("flat_silicon_oxide")}};
  for (const auto& command : commands) {
    const Finished run = run_program(command, full);
    EXPECT_EQ(run.exit_code, 1) << command[1];
    EXPECT_EQ(lines_of(run.err).size(), 1u) << run.err;
    EXPECT_NE(run.err.find("cannot write to standard output"), std::string::npos) << run.err;
  }
}

TEST(Help, EveryProgramExplainsItself) {
  const std::vector<std::vector<std::string>> commands{
      {kNve},    {kNve, "serve"},   {kNve, "curve"},   {kNve, "check"},
      {kMaster}, {kMaster, "run"},  {kMaster, "plan"}, {kMaster, "recover"},
      {kLab},    {kLab, "contact"}, {kLab, "report"},  {kLab, "session"}};
  for (auto command : commands) {
    const std::string name = std::filesystem::path(command[0]).filename().string();
    SCOPED_TRACE(name + (command.size() > 1 ? " " + command[1] : ""));
    command.push_back("--help");
    const Finished run = run_program(command);
    EXPECT_EQ(run.exit_code, 0);
    EXPECT_NE(run.out.find("Usage: "), std::string::npos) << run.out;
    EXPECT_EQ(run.err, "");
  }
  for (const std::string& program : {kNve, kMaster, kLab}) {
    const Finished run = run_program({program, "--version"});
    EXPECT_EQ(run.exit_code, 0);
    EXPECT_EQ(run.out.rfind(std::filesystem::path(program).filename().string() + " 0.", 0), 0u) << run.out;
    EXPECT_EQ(run.err, "");
  }
}

// The help of each command that takes a device offers those that it takes, and no command finds a device of the table unknown.
TEST(Help, EveryDeviceIsOfferedWhereItIsTaken) {
  const auto file = [](const app::DeviceRow& row) { return !row.reads_file; };
  const auto force = [](const app::DeviceRow& row) { return row.shows_force; };
  struct Command {
    std::string name;
    std::vector<std::string> devices;
  };
  const std::vector<Command> commands{{"run", app::device_names([](const app::DeviceRow&) { return true; })},
                                      {"start", app::device_names(file)},
                                      {"plan", app::device_names(force)},
                                      {"calibrate", app::device_names([](const app::DeviceRow& row) {
                                         return row.has_own_axes || row.shows_force;
                                       })}};
  for (const Command& command : commands) {
    const Finished help = run_program({kMaster, command.name, "--help"});
    EXPECT_NE(help.out.find("--device " + app::choices_text(command.devices)), std::string::npos)
        << command.name << help.out;
  }
  for (const app::DeviceRow& row : app::kDeviceRows) {
    const std::string given = std::string(row.name) + (row.reads_file ? ":no_such.h5" : "");
    for (const std::vector<std::string>& command :
         {std::vector<std::string>{"run", "--server", "127.0.0.1:1", "--no-view"},
          std::vector<std::string>{"plan", "--limits", "no_such.csv"},
          std::vector<std::string>{"calibrate", "--home"}}) {
      std::vector<std::string> words{kMaster};
      words.insert(words.end(), command.begin(), command.end());
      words.insert(words.end(), {"--device", given, "--connect-timeout-s", "0.1"});
      if (command[0] == "calibrate") words.resize(words.size() - 2);
      const Finished refused = run_program(words);
      EXPECT_NE(refused.exit_code, 0);
      EXPECT_EQ(refused.err.find("unknown device"), std::string::npos) << refused.err;
    }
  }
}

}  // namespace
}  // namespace telenano::programs

// Every row of many short sessions against what it was: a change that is meant to change nothing shows here what it did
// change. tests/data/golden_runs keeps a few hashes of each session's rows. With TELENANO_WRITE_GOLDEN_RUNS=1 in the
// environment the files are written anew; the commit that does so says which rows changed and why.
#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/recording/sample.h"
#include "telenano/nve_server/scene/scene.h"
#include "tests/source_dir.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

constexpr double kSessionS = 1.2;
constexpr std::array kGoldenRates{500, 1000};
constexpr std::array kGoldenMethods{control::Method::kNone,    control::Method::kKs,
                                    control::Method::kKsClamp, control::Method::kTank,
                                    control::Method::kModel,   control::Method::kTwin};

/// Columns that are hashed together, by name: further columns of a row change nothing here.
struct ColumnGroup {
  std::string_view name;
  std::vector<std::string_view> columns;
};
const std::array<ColumnGroup, 5>& column_groups() {
  static const std::array<ColumnGroup, 5> kGroups{{
      {"positions",
       {"hand_pos_h_m", "tip_target_w_nm", "tip_pos_w_nm", "deflection_nm", "particle_pos_w_nm",
        "particle_radius_nm", "particle_state"}},
      {"forces",
       {"force_w_nn", "hand_force_scaled_h_n", "hand_force_rendered_h_n", "hand_force_commanded_h_n",
        "hand_force_applied_h_n", "damper_n_s_m", "clamp_n", "velocity_scale", "force_scale"}},
      {"energies",
       {"energy_j", "energy_bound_j", "energy_in_j", "energy_out_j", "account_j", "slave_energy_in_aj",
        "slave_energy_out_aj"}},
      {"link",
       {"reply_sequence", "reply_age_ms", "measurement_age_ms", "rtt_us", "lost", "reordered", "duplicates",
        "dropped", "rtt_smoothed_us", "rtt_min_us", "jitter_us", "clock_offset_us", "clock_drift_ppm",
        "up_excess_us", "down_excess_us", "force_age_ms", "commands_sent", "commands_lost", "sent_ns"}},
      {"states",
       {"tick", "time_s", "now_ns", "dt_s", "contact_state", "fault_bits", "station_mode", "limit_flags",
        "station_faults", "buttons", "method", "model_version", "device_status"}},
  }};
  return kGroups;
}

struct GoldenLink {
  std::string_view name;
  net::SimPath path;
};
const std::array<GoldenLink, 4>& golden_links() {
  static const std::array<GoldenLink, 4> kLinks = [] {
    std::array<GoldenLink, 4> links{{{"near", {}}, {"far", {}}, {"lossy", {}}, {"narrow", {}}}};
    net::SimPath& far = links[1].path;
    far.delay_ns = 20'000'000;
    far.jitter_ns = 3'000'000;
    far.jitter = net::SimPath::Jitter::kHalfNormal;
    net::SimPath& lossy = links[2].path;
    lossy.delay_ns = 4'000'000;
    lossy.jitter_ns = 2'000'000;
    lossy.jitter = net::SimPath::Jitter::kExponential;
    lossy.in_order = false;
    lossy.loss = 0.1;
    lossy.burst_datagrams = 3;
    lossy.duplicate = 0.05;
    lossy.truncate = 0.01;
    lossy.drift_ppm = 50;
    net::SimPath& narrow = links[3].path;
    narrow.delay_ns = 2'000'000;
    narrow.rate_bit_s = 400'000;
    narrow.queue_bytes = 4000;
    return links;
  }();
  return kLinks;
}

class RowHashes {
 public:
  RowHashes() {
    for (std::size_t g = 0; g < column_groups().size(); ++g) {
      for (const std::string_view name : column_groups()[g].columns) {
        const recording::Column* found = nullptr;
        for (const recording::Column& column : recording::sample_columns()) {
          if (column.name == name) found = &column;
        }
        EXPECT_NE(found, nullptr) << "there is no column " << name;
        if (found) columns_.push_back({found, g});
      }
    }
  }
  void add(const recording::Sample& row) {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(&row);
    for (const auto& [column, group] : columns_) {
      for (std::size_t i = 0; i < column->components; ++i) {
        std::uint64_t word = 0;
        std::memcpy(&word, bytes + column->offset + i * column->element_bytes(), column->element_bytes());
        // The sign of a value that is none depends on the compiler.
        if (column->type == recording::ColumnType::kFloat64) {
          const auto value = std::bit_cast<double>(word);
          if (value != value) word = 0x7ff8'0000'0000'0000;
        }
        std::uint64_t& hash = hashes_[group];
        hash = (hash ^ word) * 0x9e37'79b9'7f4a'7c15;
        hash ^= hash >> 29;
      }
    }
  }
  std::string text(std::size_t group) const {
    char digits[9];
    std::snprintf(digits, sizeof digits, "%08x", static_cast<unsigned>(hashes_[group] >> 32));
    return digits;
  }

 private:
  std::vector<std::pair<const recording::Column*, std::size_t>> columns_;
  std::array<std::uint64_t, 5> hashes_{};
};

/// One line of the file: what was run, then how many rows of it touch, then the hashes.
struct GoldenLine {
  std::string run;
  std::vector<std::string> cells;
};

GoldenLine run_golden(const std::shared_ptr<const scene::Scene>& scene, control::Method method,
                      const GoldenLink& link, int rate_hz) {
  VirtualSessionConfig config;
  config.scene = scene;
  config.station.rate_hz = rate_hz;
  config.station.method = method;
  config.twin = method == control::Method::kTwin;
  config.to_server = config.to_station = link.path;
  config.to_station.drift_ppm = -link.path.drift_ppm;
  config.link_options.rate.adapts = link.path.rate_bit_s > 0;
  config.link_options.rate.full_hz = rate_hz;
  config.link_options.rate.redundancy = 0;
  // Down, along, up.
  const double deep_nm = scene->particle ? 4 : scene->marks ? -12 : -6;
  const double start_nm = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
  config.task = device::Task::kScript;
  config.script = {
      {0, {0, 0, start_nm}}, {0.4, {0, 0, deep_nm}}, {0.6, {15, 4, deep_nm}}, {0.9, {15, 4, start_nm}}};
  VirtualSession session(config);
  RowHashes hashes;
  int touching = 0;
  for (int tick = 0; tick < kSessionS * rate_hz; ++tick) {
    const recording::Sample& row = session.step();
    hashes.add(row);
    touching += row.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact);
  }
  GoldenLine line;
  line.run = std::string(control::method_name(method)) + "," + std::string(link.name) + "," +
             std::to_string(rate_hz);
  line.cells.push_back(std::to_string(touching));
  for (std::size_t g = 0; g < column_groups().size(); ++g) line.cells.push_back(hashes.text(g));
  return line;
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> cells(1);
  for (const char c : text) {
    if (c == ',') {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  return cells;
}

class GoldenRuns : public testing::TestWithParam<const char*> {};

TEST_P(GoldenRuns, HaveTheRowsThatTheyHad) {
  const std::string scene_name = GetParam();
  const auto scene =
      scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + scene_name + ".toml");
  const std::string path =
      std::string(TELENANO_SOURCE_DIR) + "/tests/data/golden_runs/" + scene_name + ".csv";

  std::vector<GoldenLine> lines;
  int touching = 0;
  for (const control::Method method : kGoldenMethods) {
    for (const GoldenLink& link : golden_links()) {
      for (const int rate_hz : kGoldenRates) {
        lines.push_back(run_golden(scene, method, link, rate_hz));
        touching += std::stoi(lines.back().cells[0]);
      }
    }
  }
  EXPECT_GT(touching, 20 * static_cast<int>(lines.size())) << "sessions that feel nothing show nothing";

  std::string header = "method,link,rate_hz,rows_in_contact";
  for (const ColumnGroup& group : column_groups()) header += "," + std::string(group.name);
  if (std::getenv("TELENANO_WRITE_GOLDEN_RUNS")) {
    std::ofstream out(path);
    out << header << '\n';
    for (const GoldenLine& line : lines) {
      out << line.run;
      for (const std::string& cell : line.cells) out << ',' << cell;
      out << '\n';
    }
    ASSERT_TRUE(out.flush().good()) << path;
    return;
  }
  std::ifstream in(path);
  ASSERT_TRUE(in.is_open()) << "there is no " << path;
  std::string text;
  std::getline(in, text);
  ASSERT_EQ(text, header) << path;
  std::map<std::string, std::vector<std::string>> kept;
  while (std::getline(in, text)) {
    const std::vector<std::string> cells = split(text);
    ASSERT_EQ(cells.size(), 4 + column_groups().size()) << path << ": " << text;
    kept[cells[0] + "," + cells[1] + "," + cells[2]] = {cells.begin() + 3, cells.end()};
  }
  EXPECT_EQ(kept.size(), lines.size()) << path;
  const std::vector<std::string> names = split(header);
  for (const GoldenLine& line : lines) {
    const auto found = kept.find(line.run);
    if (found == kept.end()) {
      ADD_FAILURE() << scene_name << "," << line.run << " is not in " << path;
      continue;
    }
    std::string differs;
    for (std::size_t i = 0; i < line.cells.size(); ++i) {
      if (line.cells[i] != found->second[i]) differs += " " + names[3 + i];
    }
    EXPECT_EQ(differs, "") << "of " << scene_name << "," << line.run
                           << "; if that is meant, write the files anew: TELENANO_WRITE_GOLDEN_RUNS=1";
  }
}

INSTANTIATE_TEST_SUITE_P(OfEachScene, GoldenRuns,
                         testing::Values("flakes", "flat_pdms", "flat_polystyrene", "flat_silicon_oxide",
                                         "flat_table", "humid_flakes", "lithography", "particle"),
                         [](const auto& one) { return std::string(one.param); });

}  // namespace
}  // namespace telenano::support

#include "tests/studies/stress/results.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <tuple>

#include "telenano/common/base/error.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/stress_report.h"
#include "tests/studies/stress/sweep.h"

namespace telenano::studies::stress {
namespace {

namespace fs = std::filesystem;

void write(const fs::path& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  out << text;
  if (!out.flush()) throw UserError(path.string() + ": cannot be written");
}

struct Group {
  std::size_t runs = 0, broken = 0, survived = 0, stopped = 0;
  double most_extracted_mj = 0, least_margin_mj = 1e300, most_tip_nn = 0;
  std::vector<double> shown{};
};

}  // namespace

void note_timing(const fs::path& folder, const Shard& shard, const Timing& timing) {
  std::error_code error;
  fs::create_directories(folder / "timings", error);
  std::ofstream out(folder / "timings" / fmt::format("{:04}-of-{:04}.csv", shard.number, shard.of),
                    std::ios::app);
  out << fmt::format("{},{},{:.3f},{}\n", timing.runs, timing.ticks, timing.seconds, timing.threads);
}

std::string timing_text(const fs::path& folder) {
  std::error_code error;
  Timing all;
  std::size_t processes = 0;
  double thread_s = 0;
  for (const auto& entry : fs::directory_iterator(folder / "timings", error)) {
    std::ifstream in(entry.path());
    Timing t;
    for (char comma = 0; in >> t.runs >> comma >> t.ticks >> comma >> t.seconds >> comma >> t.threads;) {
      ++processes;
      all.runs += t.runs;
      all.ticks += t.ticks;
      all.seconds += t.seconds;
      thread_s += t.seconds * t.threads;
      all.threads = t.threads;
    }
  }
  if (processes == 0) return {};
  const std::string where = processes == 1
                                ? fmt::format("on {} threads", all.threads)
                                : fmt::format("in {} processes, one after the other or not", processes);
  return fmt::format("{} runs in {:.0f} s {}, {:.3g} million steps a second and thread", all.runs,
                     all.seconds, where, 1e-6 * static_cast<double>(all.ticks) / std::max(thread_s, 1e-9));
}

std::string groups_csv(const std::vector<Row>& rows) {
  std::map<std::tuple<control::Method, SceneKind, HandKind>, Group> groups;
  for (const Row& row : rows) {
    Group& g = groups[{row.spec.method, row.spec.scene, row.spec.hand}];
    const Outcome& o = row.outcome;
    ++g.runs;
    g.broken += (o.violated & promised(row.spec.method)) != 0;
    g.survived += o.survived();
    g.stopped += o.stopped_s >= 0;
    g.most_extracted_mj = std::max(g.most_extracted_mj, o.extracted_mj);
    g.least_margin_mj = std::min(g.least_margin_mj, o.margin_mj);
    g.most_tip_nn = std::max(g.most_tip_nn, o.tip_nn);
    if (std::isfinite(o.shown_ratio)) g.shown.push_back(o.shown_ratio);
  }
  std::string csv =
      "method,scene,hand,runs,broken_promises,survived,stopped,most_extracted_mj,least_margin_mj,most_tip_nn,"
      "median_shown_ratio\n";
  for (auto& [key, g] : groups) {
    const auto& [method, scene, hand] = key;
    std::string shown;
    if (!g.shown.empty()) {
      const auto middle = g.shown.begin() + static_cast<std::ptrdiff_t>(g.shown.size() / 2);
      std::nth_element(g.shown.begin(), middle, g.shown.end());
      shown = fmt::format("{:.4g}", *middle);
    }
    csv += fmt::format("{},{},{},{},{},{},{},{:.6g},{:.6g},{:.6g},{}\n", control::method_name(method),
                       scene_kind_name(scene), hand_name(hand), g.runs, g.broken, g.survived, g.stopped,
                       g.most_extracted_mj, g.least_margin_mj, g.most_tip_nn, shown);
  }
  return csv;
}

void keep_results(const fs::path& folder, const std::vector<Row>& rows, const fs::path& results) {
  std::error_code error;
  fs::create_directories(results, error);
  if (error) throw UserError(results.string() + ": cannot be created: " + error.message());
  fs::copy_file(folder / "report" / "index.html", results / "index.html",
                fs::copy_options::overwrite_existing, error);
  if (error) throw UserError((results / "index.html").string() + ": cannot be written: " + error.message());
  write(results / "summary.csv", summary_csv(rows));
  write(results / "groups.csv", groups_csv(rows));
  std::string broken = table_columns() + '\n';
  for (const Row* row : broken_promises(rows)) broken += to_csv(*row) + '\n';
  write(results / "broken.csv", broken);
  write(results / "run.txt",
        fmt::format("{}\n{}\n{}\n", read_manifest(folder).text, machine_text(), timing_text(folder)));
}

}  // namespace telenano::studies::stress

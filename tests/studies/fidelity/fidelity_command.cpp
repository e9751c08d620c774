#include "tests/studies/fidelity/fidelity_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>

#include "telenano/common/base/error.h"
#include "telenano/common/base/version.h"
#include "tests/studies/fidelity/fidelity_grid.h"
#include "tests/studies/fidelity/fidelity_page.h"
#include "tests/studies/fidelity/real_programs.h"
#include "tests/studies/fidelity/sensitivity.h"
#include "tests/studies/parse_list.h"
#include "tests/studies/report/page.h"
#include "tests/studies/zwidth/on_all_cores.h"

namespace telenano::studies {
namespace {

using namespace fidelity;

constexpr double kGain = 5;  // of companding
constexpr double kRttMaxMs = 2000, kLossMax = 0.5;
constexpr double kDrawnRttMs = 200;  // or the nearest to it that is asked for
constexpr const char* kDrawnScene = "flakes";
constexpr const char* kDrawnMotion = "raster";

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

FidelityOptions with_defaults(FidelityOptions o) {
  using control::Method;
  if (o.methods.empty()) {
    o.methods = {Method::kNone, Method::kTank, Method::kWave, Method::kTdpa, Method::kModel, Method::kTwin};
    if (o.quick) o.methods = {Method::kNone, Method::kTank, Method::kModel, Method::kTwin};
  }
  if (o.rtt_ms.empty())
    o.rtt_ms = o.quick ? std::vector<double>{0, 200} : std::vector<double>{0, 20, 50, 100, 200, 500};
  if (o.loss.empty()) o.loss = o.quick ? std::vector<double>{0} : std::vector<double>{0, 0.1};
  for (const double rtt : o.rtt_ms) {
    if (!(rtt >= 0 && rtt <= kRttMaxMs))
      throw UserError(
          fmt::format("fidelity: --rtt: {:g} is out of range; expected 0 to {:g} ms", rtt, kRttMaxMs));
  }
  for (const double loss : o.loss) {
    if (!(loss >= 0 && loss <= kLossMax))
      throw UserError(
          fmt::format("fidelity: --loss: {:g} is out of range; expected 0 to {:g}, a share", loss, kLossMax));
  }
  return o;
}

std::vector<Cell> cells_of(const FidelityOptions& o, const std::vector<const SceneMotion*>& motions) {
  const double drawn_ms = *std::min_element(o.rtt_ms.begin(), o.rtt_ms.end(), [](double a, double b) {
    return std::fabs(a - kDrawnRttMs) < std::fabs(b - kDrawnRttMs);
  });
  const auto is_drawn = [&](const SceneMotion* m) {
    return std::string(m->scene) == kDrawnScene && std::string(m->motion) == kDrawnMotion;
  };
  const SceneMotion* drawn = motions.front();
  for (const SceneMotion* m : motions) {
    if (is_drawn(m)) drawn = m;
  }
  std::vector<Cell> cells;
  for (const SceneMotion* motion : motions) {
    for (const control::Method method : o.methods) {
      for (const double loss : o.loss) {
        for (const double rtt : o.rtt_ms)
          cells.push_back({motion, method, rtt, loss, o.seed,
                           motion == drawn && rtt == drawn_ms && loss == o.loss.front()});
      }
    }
  }
  return cells;
}

/// Each motion again by `twin` with companding, at each round trip, with the first loss.
std::vector<Cell> companded_cells(const FidelityOptions& o, const std::vector<const SceneMotion*>& motions) {
  std::vector<Cell> cells;
  if (std::find(o.methods.begin(), o.methods.end(), control::Method::kTwin) == o.methods.end()) return cells;
  for (const SceneMotion* motion : motions) {
    for (const double rtt : o.rtt_ms)
      cells.push_back({motion, control::Method::kTwin, rtt, o.loss.front(), o.seed, false, kGain});
  }
  return cells;
}

/// Each cell again with a deadband of replies, which a session with a twin has none of.
std::vector<Cell> sparing_cells(const FidelityOptions& o, const std::vector<const SceneMotion*>& motions) {
  std::vector<Cell> cells;
  if (o.reply_permille <= 0) return cells;
  for (Cell cell : cells_of(o, motions)) {
    cell.reply_permille = o.reply_permille;
    cell.keep_trace = false;
    if (cell.method != control::Method::kTwin) cells.push_back(cell);
  }
  return cells;
}

std::vector<CellResult> run_cells(const std::vector<Cell>& cells, const ScenePairs& scenes,
                                  std::chrono::steady_clock::time_point begin) {
  std::vector<CellResult> results(cells.size());
  std::atomic<std::size_t> done{0};
  const std::size_t every = std::max<std::size_t>(10, cells.size() / 20);
  on_all_cores(cells.size(), [&](std::size_t i) {
    results[i] = run_cell(cells[i], scenes);
    const std::size_t n = ++done;
    if (n % every == 0)
      std::fprintf(stderr, "fidelity: %zu of %zu cells, %.0f s\n", n, cells.size(), seconds_since(begin));
  });
  return results;
}

/// One motion after the other in real time: default scenes flakes/raster and flat_silicon_oxide/indent_slow,
/// default methods the station's own choice, tank and model.
void run_real_programs(FidelityOptions options, const FigureFolder& folder) {
  if (options.scenes.empty()) options.scenes = {"flakes/raster", "flat_silicon_oxide/indent_slow"};
  const std::vector<const SceneMotion*> motions = chosen_motions(options.scenes, options.quick);
  RealLink link;
  if (!options.rtt_ms.empty()) link.rtt_ms = options.rtt_ms.front();
  if (!options.loss.empty()) link.loss = options.loss.front();
  std::vector<std::string> methods = {"auto", "tank", "model"};
  if (!options.methods.empty()) methods.clear();
  for (const control::Method m : options.methods) methods.emplace_back(control::method_name(m));
  const ScenePairs scenes(motions);
  std::string csv;
  for (const SceneMotion* motion : motions) {
    for (const std::string& method : methods) {
      std::fprintf(stderr, "fidelity: real programs, %s %s, %s ...\n", motion->scene, motion->motion,
                   method.c_str());
      const CellResult result = run_real(*motion, method, link, scenes, folder.path() / "recordings");
      const std::string table = cells_csv({result});
      const std::size_t head = table.find('\n') + 1;
      if (csv.empty()) csv = "asked," + table.substr(0, head);
      csv += method + "," + table.substr(head);
    }
  }
  folder.write("real.csv", csv);
  std::fputs(csv.c_str(), stdout);
}

}  // namespace

bool run_fidelity(const FidelityOptions& given) {
  const FidelityOptions options = with_defaults(given);
  std::vector<std::string> names = options.scenes;
  const std::vector<const SceneMotion*> motions = chosen_motions(names, options.quick);
  const FigureFolder folder(options.out);
  if (!folder.has_gnuplot())
    std::fprintf(stderr, "fidelity: gnuplot is not installed: CSV only, no figures\n");
  if (options.real) {
    run_real_programs(given, folder);
    return true;
  }
  const auto begin = std::chrono::steady_clock::now();

  std::vector<const SceneMotion*> needed = motions;
  if (options.check_sensitivity) {
    for (const SceneMotion* m : chosen_motions(telling_motions(), false)) needed.push_back(m);
  }
  std::fprintf(stderr, "fidelity: reading scenes ...\n");
  const ScenePairs scenes(needed);

  std::vector<SensitivityRow> sensitivity;
  bool good = true;
  if (options.check_sensitivity) {
    std::fprintf(stderr, "fidelity: renderers that are wrong on purpose ...\n");
    sensitivity = check_sensitivity(scenes);
    folder.write("sensitivity.csv", sensitivity_csv(sensitivity));
    for (const SensitivityRow& row : sensitivity) {
      const bool right = row.wrong == WrongRenderer::kNone;
      if (row.rules.empty() == right && (row.stress == 0) == right) continue;
      good = false;
      std::fprintf(stderr, "fidelity: renderer '%s' %s\n",
                   std::string(wrong_renderer_name(row.wrong)).c_str(),
                   right ? "is right, and was found wrong" : "was not found out");
    }
  }
  const std::vector<CellResult> results = run_cells(cells_of(options, motions), scenes, begin);
  const std::vector<CellResult> companded = run_cells(companded_cells(options, motions), scenes, begin);
  if (!companded.empty()) folder.write("companding.csv", companding_csv(results, companded));
  if (options.reply_permille > 0)
    folder.write("replies.csv",
                 replies_csv(results, run_cells(sparing_cells(options, motions), scenes, begin)));
  const std::string csv = cells_csv(results);
  folder.write("fidelity.csv", csv);
  std::fputs(csv.c_str(), stdout);
  std::string html =
      page_begin("Felt and true", fmt::format("The force at the hand beside that of the same sample, built a "
                                              "second time and stepped without link and "
                                              "delay along the same commanded path. Virtual time, 1 kHz, the "
                                              "simulated hand; commit {}; seed {}{}",
                                              kGitCommit, options.seed, options.quick ? "; quick run" : ""));
  html += fidelity_sections(results, sensitivity, folder);
  html += companding_section(results, companded);
  folder.write("index.html", html + page_end());
  std::fprintf(stderr, "fidelity: %s, after %.1f s\n", (options.out / "index.html").c_str(),
               seconds_since(begin));
  return good;
}

void add_fidelity_command(CLI::App& app, int& exit_code) {
  struct Arguments {
    FidelityOptions options;
    std::vector<std::string> methods;
    std::string rtt, loss;
  };
  const auto a = std::make_shared<Arguments>();
  std::string names;
  for (const control::Method method : control::kAllMethods)
    names += (names.empty() ? "" : ", ") + std::string(control::method_name(method));
  CLI::App* const command = app.add_subcommand("fidelity",
                                               "Compare the felt force with the true force, for every scene, "
                                               "over round trips and loss, with each control method");
  command->add_option("--out", a->options.out, "output folder for index.html, CSV files and figures")
      ->capture_default_str();
  command->add_option("--scenes", a->options.scenes, "scenes, or SCENE/MOTION, separated by commas [all]")
      ->delimiter(',');
  command->add_option("--methods", a->methods, "some of: " + names + " [none,tank,wave,tdpa,model,twin]")
      ->delimiter(',');
  command->add_option("--rtt", a->rtt, "round trips in ms, separated by commas [0,20,50,100,200,500]");
  command->add_option("--loss", a->loss,
                      "fractions of datagrams lost in each direction, separated by commas [0,0.1]");
  command->add_option("--seed", a->options.seed, "random seed; the same seed gives the same bits")
      ->capture_default_str();
  command->add_flag("--quick", a->options.quick,
                    "seven motions, two round trips, four methods: a few seconds");
  command->add_flag("--check-sensitivity", a->options.check_sensitivity,
                    "also check that every deliberately wrong renderer is detected; exit status 1 if not");
  command
      ->add_option(
          "--reply-deadband", a->options.reply_permille,
          "run each cell once more with this deadband of replies, in thousandths of the force: replies.csv "
          "says how many are left out and what that costs")
      // CLI11's own range accepts "nan".
      ->check([](const std::string& word) {
        double permille = 0;
        const bool good = CLI::detail::lexical_cast(word, permille) && permille >= 1 && permille <= 1000;
        return good ? std::string() : "'" + word + "' is not a number from 1 to 1000";
      })
      ->type_name("PERMILLE");
  command->add_flag("--real", a->options.real,
                    "run the real programs through a relay in real time, with the first value of --rtt [100] "
                    "and of --loss [0.02]");
  command->callback([a, command, &exit_code] {
    for (const std::string& name : a->methods) a->options.methods.push_back(control::parse_method(name));
    if (command->count("--rtt") > 0) a->options.rtt_ms = parse_list(a->rtt, "fidelity: --rtt");
    if (command->count("--loss") > 0) a->options.loss = parse_list(a->loss, "fidelity: --loss");
    if (!run_fidelity(a->options)) exit_code = 1;
  });
}

}  // namespace telenano::studies

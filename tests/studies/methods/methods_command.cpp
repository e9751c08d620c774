#include "tests/studies/methods/methods_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>

#include "telenano/common/base/error.h"
#include "telenano/common/base/version.h"
#include "tests/studies/methods/attack_section.h"
#include "tests/studies/methods/press_section.h"
#include "tests/studies/parse_list.h"
#include "tests/studies/report/page.h"

namespace telenano::studies {
namespace {

constexpr double kTraceRttMs = 100;  // or the nearest to it that is asked for
constexpr double kRttMaxMs = 2000;
constexpr const char* kPressing = "press";
constexpr const char* kAttacks = "attack";

double nearest(const std::vector<double>& values, double wanted) {
  return *std::min_element(values.begin(), values.end(),
                           [&](double a, double b) { return std::fabs(a - wanted) < std::fabs(b - wanted); });
}

void check(const MethodsOptions& options) {
  if (!options.only.empty() && options.only != kPressing && options.only != kAttacks)
    throw UserError("methods: --only: '" + options.only + "' is unknown; expected press or attack");
  for (const double rtt : options.rtt_ms) {
    if (!(rtt >= 0 && rtt <= kRttMaxMs))
      throw UserError(
          fmt::format("methods: --rtt-ms: {:g} is out of range; expected 0 to {:g}", rtt, kRttMaxMs));
  }
}

}  // namespace

void run_methods(const MethodsOptions& options) {
  check(options);
  const FigureFolder folder(options.out);
  if (!folder.has_gnuplot())
    std::fprintf(stderr, "methods: gnuplot is not installed: CSV only, no figures\n");
  const std::vector<control::Method> methods =
      options.methods.empty()
          ? std::vector<control::Method>(control::kAllMethods.begin(), control::kAllMethods.end())
          : options.methods;
  const auto begin = std::chrono::steady_clock::now();
  std::string html = page_begin(
      "Methods for a passive port, compared",
      fmt::format("commit {}; seed {}{}", kGitCommit, options.seed, options.quick ? "; quick run" : ""));
  if (options.only != kAttacks) {
    std::fprintf(stderr, "methods: presses on a wall ...\n");
    const auto presses =
        run_presses(methods, options.rtt_ms, nearest(options.rtt_ms, kTraceRttMs), options.seed);
    html += press_section(presses, folder);
    std::fputs(press_csv(presses).c_str(), stdout);
  }
  if (options.only != kPressing) {
    std::fprintf(stderr, "methods: hostile hands ...\n");
    const auto attacks = run_attacks(methods, options.rtt_ms, options.quick, options.seed);
    html += attack_section(attacks);
    folder.write("attacks.csv", attack_csv(attacks));
    if (options.only == kAttacks) std::fputs(attack_csv(attacks).c_str(), stdout);
  }
  folder.write("index.html", html + page_end());
  std::fprintf(stderr, "methods: %s, after %.1f s\n", (options.out / "index.html").c_str(),
               std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
}

void add_methods_command(CLI::App& app) {
  struct Arguments {
    MethodsOptions options;
    std::vector<std::string> methods;
    std::string rtt_ms;
  };
  const auto a = std::make_shared<Arguments>();
  std::string names;
  for (const control::Method method :
       std::vector<control::Method>(control::kAllMethods.begin(), control::kAllMethods.end()))
    names += (names.empty() ? "" : ", ") + std::string(control::method_name(method));
  CLI::App* command = app.add_subcommand(
      "methods",
      "For each control method: how a wall feels over a delay, and how much energy a hand can extract");
  command->add_option("--out", a->options.out, "output folder for index.html, CSV files and figures")
      ->capture_default_str();
  command->add_option("--methods", a->methods, "some of: " + names + " [all]")->delimiter(',');
  command->add_option("--rtt-ms", a->rtt_ms,
                      "round trips in ms, separated by commas [0,10,20,50,100,200,500,1000]");
  command->add_option("--only", a->options.only,
                      "press (what the hand feels) or attack (energy that can be extracted) [both]");
  command->add_flag("--quick", a->options.quick,
                    "fewer simulated hands and shorter searches: seconds, not minutes");
  command->add_option("--seed", a->options.seed, "random seed; the same seed gives the same bits")
      ->capture_default_str();
  command->callback([a, command] {
    for (const std::string& name : a->methods) a->options.methods.push_back(control::parse_method(name));
    if (command->count("--rtt-ms") > 0) a->options.rtt_ms = parse_list(a->rtt_ms, "methods: --rtt-ms");
    run_methods(a->options);
  });
}

}  // namespace telenano::studies

#include "tests/studies/stress/stress_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>

#include "telenano/common/base/error.h"
#include "telenano/common/config/shared_files.h"
#include "tests/studies/stress/hunt.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/real_programs_check.h"
#include "tests/studies/stress/realtime_check.h"
#include "tests/studies/stress/results.h"
#include "tests/studies/stress/sampled_bounds.h"
#include "tests/studies/stress/search.h"
#include "tests/studies/stress/stress_bench.h"
#include "tests/studies/stress/stress_report.h"
#include "tests/studies/stress/sweep.h"

namespace telenano::studies {
namespace {

using namespace stress;

struct Arguments {
  bool quick = false, full = false, replies = false, mutants = false, realtime = false, bench = false,
       no_report = false, wait = false;
  std::vector<std::string> methods, scenes;
  std::string out = "stress", rtt_ms, loss, shard, merge_folder, replay, shrink_spec, trace, results;
  std::string scene_folder = (config::shared_folder() / "scenes").string();
  std::uint64_t seed = 1;
  std::size_t sample = 0;
  unsigned threads = 0;
};

double parse_end(const std::string& text, const std::string& what) {
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size() || !std::isfinite(value))
    throw UserError(fmt::format("stress: {}: '{}' is no number; expected MIN:MAX", what, text));
  return value;
}

/// "MIN:MAX" or one number, within what a run may have.
Range parse_range(const std::string& text, const std::string& what, Range within) {
  if (text.empty()) return within;
  const auto colon = text.find(':');
  Range range;
  range.low = parse_end(text.substr(0, colon), what);
  range.high = colon == std::string::npos ? range.low : parse_end(text.substr(colon + 1), what);
  if (range.low > range.high)
    throw UserError(fmt::format("stress: {}: {:g}:{:g} contradicts itself: the first is the larger", what,
                                range.low, range.high));
  if (range.low < within.low || range.high > within.high)
    throw UserError(fmt::format("stress: {}: {} is out of range; expected within {:g}:{:g}", what, text,
                                within.low, within.high));
  return range;
}

Shard parse_shard(const std::string& text) {
  Shard shard;
  if (text.empty()) return shard;
  const auto slash = text.find('/');
  const double number = slash == std::string::npos ? -1 : parse_end(text.substr(0, slash), "--shard");
  const double of = slash == std::string::npos ? 0 : parse_end(text.substr(slash + 1), "--shard");
  if (!(number >= 0 && number < of && of <= 9999) || number != std::floor(number) || of != std::floor(of))
    throw UserError(
        fmt::format("stress: --shard: '{}': expected I/N with I from 0 to N-1, N at most 9999", text));
  shard.number = static_cast<std::size_t>(number);
  shard.of = static_cast<std::size_t>(of);
  return shard;
}

SweepOptions sweep_options(const Arguments& a) {
  SweepOptions options;
  options.profile.full = a.full;
  options.profile.replies = a.replies;
  options.profile.sample = a.sample;
  options.profile.seed = a.seed;
  std::vector<control::Method> wanted;
  for (const std::string& name : a.methods) wanted.push_back(control::parse_method(name));
  for (const control::Method method : control::kAllMethods) {
    if (wanted.empty() || std::find(wanted.begin(), wanted.end(), method) != wanted.end())
      options.profile.methods.push_back(method);
  }
  std::vector<SceneKind> scenes;
  for (const std::string& name : a.scenes) scenes.push_back(parse_scene_kind(name));
  // The last three have to be asked for: they are there for the twin, and slow.
  for (const SceneKind kind :
       {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPolystyrene, SceneKind::kPdms, SceneKind::kScan,
        SceneKind::kHard, SceneKind::kMoist, SceneKind::kMarks, SceneKind::kParticle}) {
    if ((scenes.empty() && kind < SceneKind::kMoist) ||
        std::find(scenes.begin(), scenes.end(), kind) != scenes.end())
      options.profile.scenes.push_back(kind);
  }
  if (scenes.empty())
    options.profile.across = {SceneKind::kScan, SceneKind::kMoist, SceneKind::kMarks, SceneKind::kParticle};
  options.profile.rtt_ms = parse_range(a.rtt_ms, "--rtt-ms", options.profile.rtt_ms);
  options.profile.loss = parse_range(a.loss, "--loss", options.profile.loss);
  options.out = a.out;
  options.scenes = a.scene_folder;
  options.shard = parse_shard(a.shard);
  options.threads = a.threads;
  options.wait = a.wait;
  return options;
}

/// On standard output what was found, for people who want one line; the table has the rest.
int conclude(const std::filesystem::path& folder, const std::vector<Row>& rows, const Arguments& a) {
  std::fputs(summary_csv(rows).c_str(), stdout);
  const Manifest manifest = read_manifest(folder);
  const bool sample = is_sample(manifest.text);
  if (sample) {
    std::ofstream out(folder / "bounds.csv");
    out << sampled_bounds_csv(rows);
    if (!out.flush()) throw RunError((folder / "bounds.csv").string() + ": cannot be written");
    std::fprintf(stderr, "stress: %s\n", (folder / "bounds.csv").c_str());
  }
  if (!a.no_report) {
    ReportOptions options;
    options.folder = folder;
    options.scenes = a.scene_folder;
    options.manifest = manifest.text;
    options.sample = sample;
    write_report(options, rows);
    std::fprintf(stderr, "stress: %s\n", (folder / "report" / "index.html").c_str());
    if (!a.results.empty()) {
      keep_results(folder, rows, a.results);
      std::fprintf(stderr, "stress: kept in %s\n", a.results.c_str());
    }
  }
  const auto broken = broken_promises(rows);
  for (std::size_t i = 0; i < std::min<std::size_t>(broken.size(), 10); ++i)
    std::fprintf(stderr, "stress: broken (%s): %s\n",
                 invariant_names(broken[i]->outcome.violated & promised(broken[i]->spec.method)).c_str(),
                 replay_command(broken[i]->spec).c_str());
  if (broken.empty()) return 0;
  std::fprintf(stderr, "stress: %zu promises were broken\n", broken.size());
  return 1;
}

int replay(const Arguments& a) {
  const RunSpec spec = parse_run_spec(a.replay);
  const Scenes scenes(a.scene_folder, {spec.scene});
  std::vector<TraceRow> trace;
  RunExtras extras;
  if (!a.trace.empty()) extras.trace = &trace;
  const Outcome outcome = run(spec, scenes, extras);
  if (!a.trace.empty()) {
    std::ofstream out(a.trace);
    out << "time_s,depth_mm,force_n,extracted_mj,account_mj,slave_mj,link_down\n";
    for (const TraceRow& row : trace)
      out << fmt::format("{},{},{},{},{},{},{}\n", row.time_s, row.depth_mm, row.force_n, row.extracted_mj,
                         row.account_mj, row.slave_mj, row.link_down ? 1 : 0);
    if (!out.flush()) throw UserError(a.trace + ": cannot be written");
  }
  std::printf("%s\n%s\n", table_columns().c_str(), to_csv({0, spec, outcome}).c_str());
  const std::uint32_t broken =
      outcome.violated & (spec.mutant == Mutant::kNone ? promised(spec.method) : ~0u);
  std::fprintf(stderr, "stress: violated: %s; of these promised: %s\n",
               invariant_names(outcome.violated).c_str(), invariant_names(broken).c_str());
  return broken == 0 ? 0 : 1;
}

int shrink_run(const Arguments& a) {
  const RunSpec spec = parse_run_spec(a.shrink_spec);
  const Scenes scenes(a.scene_folder, {SceneKind::kWall, spec.scene});
  const Outcome whole = run(spec, scenes);
  const std::uint32_t violated = whole.violated;
  // What violates must go on doing so; what does not must keep most of what it got out.
  const RunSpec small = shrink(spec, scenes, [&](const Outcome& o) {
    return violated != 0 ? (o.violated & violated) != 0 : o.extracted_mj >= 0.9 * whole.extracted_mj;
  });
  const Outcome outcome = run(small, scenes);
  std::printf("# extracted %.4g mJ, violated: %s\n%s\n", outcome.extracted_mj,
              invariant_names(outcome.violated).c_str(), to_text(small).c_str());
  return 0;
}

int hunt(const Arguments& a) {
  const Scenes scenes(a.scene_folder, {SceneKind::kWall, SceneKind::kOxide, SceneKind::kScan});
  const auto hunts = hunt_mutants(scenes, a.seed, a.threads);
  std::fputs(hunt_csv(hunts).c_str(), stdout);
  const auto survivors =
      std::count_if(hunts.begin(), hunts.end(), [](const Hunt& h) { return h.survived(); });
  std::fprintf(stderr, "stress: %zu wrong controllers, %td survived\n", hunts.size(), survivors);
  return survivors == 0 ? 0 : 1;
}

int run_stress(const Arguments& a) {
  const int modes = ((a.quick || a.full) && !a.realtime) + (a.sample > 0) + a.replies +
                    !a.merge_folder.empty() + !a.replay.empty() + !a.shrink_spec.empty() + a.mutants +
                    a.realtime + a.bench;
  if (a.quick && a.full) throw UserError("stress: --quick and --full contradict each other");
  if (modes != 1)
    throw UserError(
        "stress: expected one of --quick, --full, --sample, --reply-deadband, --merge, --replay, --shrink, "
        "--mutants, "
        "--realtime, "
        "--bench");
  if ((a.bench || a.mutants || a.realtime) && !(a.methods.empty() && a.scenes.empty()))
    throw UserError(
        "stress: --bench, --mutants and --realtime have methods and scenes of their own: omit "
        "--methods and --scenes");
  if (!a.results.empty() && a.no_report)
    throw UserError("stress: --results keeps the report, which --no-report leaves out");
  if (!a.replay.empty()) return replay(a);
  if (!a.shrink_spec.empty()) return shrink_run(a);
  if (a.mutants) return hunt(a);
  if (a.realtime) {
    if (a.quick) return check_real_programs(a.scene_folder, true);
    const int threads = check_realtime(a.scene_folder);
    return std::max(threads, check_real_programs(a.scene_folder, false));
  }
  if (a.bench) {
    StressBenchOptions options;
    options.scenes = a.scene_folder;
    std::fputs(stress_bench_csv(options).c_str(), stdout);
    return 0;
  }
  if (!a.merge_folder.empty()) return conclude(a.merge_folder, merge(a.merge_folder), a);
  const SweepOptions options = sweep_options(a);
  const SweepResult result = sweep(options);
  if (result.computed > 0)
    std::fprintf(stderr, "stress: %zu runs, %.4g million steps in %.1f s on %u threads\n", result.computed,
                 1e-6 * static_cast<double>(result.ticks), result.seconds, result.threads);
  if (options.shard.of > 1) return 0;
  return conclude(a.out, merge(a.out), a);
}

}  // namespace

void add_stress_command(CLI::App& app, int& exit_code) {
  const auto a = std::make_shared<Arguments>();
  std::string methods;
  for (const control::Method method : control::kAllMethods)
    methods += (methods.empty() ? "" : ", ") + std::string(control::method_name(method));
  CLI::App* command =
      app.add_subcommand("stress",
                         "Stress test in virtual time: sessions with all kinds of links, hands and failures; "
                         "every promise is checked against an independent account at every sample");
  command->add_flag("--quick", a->quick, "a few hundred short runs: about a minute");
  command->add_flag("--full", a->full, "more than 20 000 runs of at least 10 s");
  command
      ->add_option("--sample", a->sample,
                   "N random runs; bounds.csv contains the rate of broken promises for each feature")
      ->check(CLI::Range(std::size_t{1}, std::size_t{10'000'000}))
      ->type_name("N");
  command
      ->add_flag(
          "--reply-deadband", a->replies,
          "more than 30 000 runs in which the server leaves out replies whose force is within a deadband")
      // That of `run` and `fidelity` has a value; without a word "=100" would begin a sweep of minutes.
      ->check([](const std::string& word) {
        return word == "true" ? std::string()
                              : "'" + word +
                                    "': takes no value, its runs have deadbands of their own; one run: "
                                    "--replay 'reply-permille=...'";
      });
  command
      ->add_option("--merge", a->merge_folder,
                   "join the shards in this folder into runs.csv and write the report")
      ->type_name("DIR");
  command
      ->add_option("--replay", a->replay, "repeat one run, written as in the report's table of worst cases")
      ->type_name("'KEY=VALUE ...'");
  command->add_option("--trace", a->trace, "with --replay: write every tick as CSV")->type_name("FILE");
  command->add_option("--shrink", a->shrink_spec, "find the simplest run that still breaks the same promise")
      ->type_name("'KEY=VALUE ...'");
  command->add_flag("--mutants", a->mutants, "run deliberately wrong controllers: each must be detected");
  command->add_flag("--realtime", a->realtime,
                    "compare some runs in real time with the same runs in virtual time: over UDP and the "
                    "relay, then with the real programs over DTLS on a busy machine (three minutes; with "
                    "--quick only two runs of the programs, 15 s)");
  command->add_flag(
      "--bench", a->bench,
      "measure steps per second and core for each method, and two threads against one: half a minute");
  command
      ->add_option("--results", a->results,
                   "when the sweep is complete: copy the page, the summaries and the broken promises to this "
                   "folder, without the long table")
      ->type_name("DIR");
  command->add_option("--out", a->out, "output folder for tables and report")->capture_default_str();
  command->add_option("--methods", a->methods, "some of: " + methods + " [all]")->delimiter(',');
  command->add_option("--scenes", a->scenes, "some of: " + scene_kind_names() + " [the first six]")
      ->delimiter(',');
  command->add_option("--rtt-ms", a->rtt_ms, "only round trips from MIN:MAX, ms [0:1000]");
  command->add_option("--loss", a->loss, "only loss fractions from MIN:MAX [0:0.5]");
  command->add_option("--seed", a->seed, "random seed; the same seed gives the same bits")
      ->capture_default_str();
  command->add_option("--shard", a->shard,
                      "I/N: run only every N-th run, starting with number I (0 to N-1); see --merge");
  command->add_flag("--wait", a->wait, "if another process is writing this shard, wait until it has ended");
  command->add_option("--threads", a->threads, "number of threads [one per core]")
      ->check(CLI::Range(1u, 256u));
  command->add_option("--scene-folder", a->scene_folder, "folder with the scene files")
      ->capture_default_str();
  command->add_flag("--no-report", a->no_report, "write only the table");
  command->callback([a, &exit_code] { exit_code = run_stress(*a); });
}

}  // namespace telenano::studies

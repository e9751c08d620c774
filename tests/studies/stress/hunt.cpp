#include "tests/studies/stress/hunt.h"

#include <fmt/format.h>

#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/mutants.h"
#include "tests/studies/stress/wrong_wire.h"

namespace telenano::studies::stress {
namespace {

/// The hostile part of the quick profile in small: hands that want energy, persons with outages and
/// restarts; near and far.
std::vector<RunSpec> ground() {
  std::vector<RunSpec> runs;
  RunSpec plain;
  plain.seconds = 5;
  const auto add = [&](RunSpec s, HandKind hand, double a, double b) {
    s.hand = hand;
    s.hand_a = a;
    s.hand_b = b;
    runs.push_back(s);
  };
  for (const double rtt_ms : {0.0, 20.0, 100.0}) {
    for (const double scale : {1.0, 4.0, 20.0}) {
      RunSpec s = plain;
      s.rtt_ms = rtt_ms;
      s.scale = scale;
      add(s, HandKind::kGreedy, 0.1, 0.01);
      add(s, HandKind::kSquare, 0.008, 0.02);
      add(s, HandKind::kPassive, 1, 300);
      RunSpec outage = s;
      outage.outage_ms = 500;
      add(outage, HandKind::kPress, 0, 0);
      RunSpec stops = s;
      stops.act = Act::kStop;
      add(stops, HandKind::kPress, 0, 0);
      RunSpec lossy = s;
      lossy.loss = 0.1;
      add(lossy, HandKind::kPress, 0, 0);
      RunSpec bursts = s;
      bursts.loss = 0.3;
      add(bursts, HandKind::kGreedy, 0.1, 0.01);
      add(bursts, HandKind::kTelegraph, 0.012, 30);
      // Lost waves by the sample, not by the burst: what is held then comes twice.
      RunSpec short_bursts = s;
      short_bursts.loss = 0.3;
      short_bursts.burst_ms = 3;
      add(short_bursts, HandKind::kSine, 0.008, 3);
      RunSpec spite = s;
      spite.drops = Drops::kSpite;
      add(spite, HandKind::kGreedy, 0.5, 0);
      // Of a device with little damping nothing is paid back that a restart forgave.
      RunSpec restarts = s;
      restarts.restart = Restart::kRandom;
      restarts.damping_n_s_m = 0.2;
      restarts.seconds = 20;
      add(restarts, HandKind::kGreedy, 0.1, 0.01);
      RunSpec rescaled = s;
      rescaled.act = Act::kScale;
      rescaled.damping_n_s_m = 0.2;
      rescaled.seconds = 20;
      add(rescaled, HandKind::kGreedy, 0.1, 0.01);
    }
  }
  return runs;
}

/// What an ordinary hand feels over a good link (felt_limits.h): on level ground with adhesion, over a scan,
/// in a groove that it makes.
std::vector<RunSpec> calm_ground() {
  std::vector<RunSpec> runs;
  using Place = std::pair<SceneKind, HandKind>;
  for (const auto& [scene, hand] :
       {Place{SceneKind::kOxide, HandKind::kPress}, Place{SceneKind::kOxide, HandKind::kIndent},
        Place{SceneKind::kScan, HandKind::kRaster}}) {
    RunSpec spec;
    spec.seconds = 5;
    spec.rtt_ms = 20;
    spec.scene = scene;
    spec.hand = hand;
    runs.push_back(spec);
  }
  // Some methods show most of a force over the shortest link only.
  RunSpec near = runs.front();
  near.rtt_ms = 0;
  runs.push_back(near);
  // What the operator does besides, where the hand feels it.
  for (const Act act : {Act::kClutch, Act::kStop, Act::kScale, Act::kImpedance}) {
    RunSpec spec = near;
    spec.scene = act == Act::kScale ? SceneKind::kPdms : SceneKind::kOxide;
    spec.act = act;
    runs.push_back(spec);
  }
  // Of a device with little damping the planned scale is the stiffest that is passive.
  runs.push_back(runs.back());
  runs.back().damping_n_s_m = 0.2;
  return runs;
}

/// Replies left out within a deadband: a fine one, and one that everything is within.
std::vector<RunSpec> gated_ground() {
  std::vector<RunSpec> runs;
  for (const auto& [permille, n] : {std::pair{100.0, 0.02}, std::pair{1000.0, 100.0}}) {
    for (RunSpec& spec : calm_ground()) {
      spec.reply_permille = permille;
      spec.reply_n = n;
      runs.push_back(std::move(spec));
    }
  }
  return runs;
}

/// Commands held back within a deadband.
std::vector<RunSpec> held_back_ground() {
  std::vector<RunSpec> runs;
  for (RunSpec& spec : calm_ground()) {
    spec.deadband_nm = 0.1;
    runs.push_back(std::move(spec));
  }
  return runs;
}

/// Twenty times the planned scale, and nothing that holds a force back: the hand is thrown out.
std::vector<RunSpec> wild_ground() {
  std::vector<RunSpec> runs = calm_ground();
  for (RunSpec& spec : runs) spec.scale = 20;
  return runs;
}

std::vector<RunSpec> first_ground(Mutant mutant) {
  if (WrongWire::is_gate(mutant)) return gated_ground();
  if (mutant == Mutant::kCommandCoarse || mutant == Mutant::kCommandLate) return held_back_ground();
  if (mutant == Mutant::kStationNoTrip) return wild_ground();
  return calm_ground();
}

Hunt hunt(Mutant mutant, const Scenes& scenes, std::uint64_t seed) {
  Hunt result;
  result.mutant = mutant;
  const control::Method method = mutant_info(mutant).method;
  std::vector<RunSpec> runs = first_ground(mutant);
  for (RunSpec& spec : ground()) runs.push_back(std::move(spec));
  for (RunSpec& spec : runs) {
    if (!scenes.has(spec.scene)) continue;
    spec.method = method;
    spec.seed = seed;
    ++result.runs;
    RunSpec wrong = spec;
    wrong.mutant = mutant;
    const Outcome outcome = run(wrong, scenes);
    if (outcome.violated == 0) continue;
    const std::uint32_t caught_by = outcome.violated & ~run(spec, scenes).violated;
    if (caught_by == 0) continue;
    result.caught_by = caught_by;
    result.spec = wrong;
    result.outcome = outcome;
    break;
  }
  return result;
}

}  // namespace

std::vector<Hunt> hunt_mutants(const Scenes& scenes, std::uint64_t seed, unsigned threads) {
  const auto mutants = all_mutants();
  std::vector<Hunt> hunts(mutants.size());
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr failure;
  const auto work = [&] {
    try {
      for (std::size_t i = next++; i < mutants.size(); i = next++) hunts[i] = hunt(mutants[i], scenes, seed);
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  };
  std::vector<std::thread> others;
  const unsigned count = threads > 0 ? threads : std::max(1u, std::thread::hardware_concurrency());
  for (unsigned i = 1; i < count; ++i) others.emplace_back(work);
  work();
  for (std::thread& thread : others) thread.join();
  if (failure) std::rethrow_exception(failure);
  return hunts;
}

std::string hunt_csv(const std::vector<Hunt>& hunts) {
  std::string csv = "mutant,caught_by,runs,after_s,extracted_mj,run\n";
  for (const Hunt& h : hunts) {
    csv += fmt::format("{},{},{},{:.6g},{:.6g},{}\n", mutant_name(h.mutant),
                       h.survived() ? "nothing" : invariant_names(h.caught_by), h.runs, h.outcome.violated_s,
                       h.outcome.extracted_mj, h.survived() ? "" : to_text(h.spec));
  }
  return csv;
}

}  // namespace telenano::studies::stress

#include "tests/studies/stress/search.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/random.h"
#include "tests/studies/methods/climbing.h"
#include "tests/studies/stress/hands.h"

namespace telenano::studies::stress {
namespace {

constexpr double kSlowS = 0.025;  // below 20 Hz
constexpr PathRange kRange{-0.030, 0.010, -0.030, 0.010};

RunSpec with_path(const RunSpec& spec, double knot_s, const std::vector<double>& path_m) {
  RunSpec path = spec;
  path.hand = HandKind::kPath;
  path.hand_a = 0;
  path.hand_b = knot_s;
  const auto stride = static_cast<std::size_t>(std::max(1.0, std::round(knot_s * spec.rate_hz)));
  const auto count = static_cast<std::size_t>(spec.seconds * spec.rate_hz) / stride + 2;
  path.knots_m.assign(count, 0.0);
  for (std::size_t i = 0; i < count && !path_m.empty(); ++i)
    path.knots_m[i] = path_m[std::min(i * stride, path_m.size() - 1)];
  return path;
}

std::vector<double> path_of(const RunSpec& spec, const Scenes& scenes) {
  std::vector<double> path_m;
  RunExtras extras;
  extras.path_m = &path_m;
  run(spec, scenes, extras);
  return path_m;
}

}  // namespace

Climbed climb(const RunSpec& spec, const Scenes& scenes) {
  const double knot_s = spec.hand == HandKind::kClimbSlow ? kSlowS : 1 / spec.rate_hz;
  RunSpec greedy = spec;
  greedy.hand = HandKind::kGreedy;
  greedy.hand_a = 0.1;
  greedy.hand_b = 0.01;
  Climbed best;
  best.spec = with_path(spec, knot_s, path_of(greedy, scenes));
  best.outcome = run(best.spec, scenes);
  best.ticks = 2 * best.outcome.ticks;
  Random random(spec.seed * 1000003 + 17);
  for (int i = 0; i < static_cast<int>(spec.hand_a); ++i) {
    RunSpec next = best.spec;
    change_a_stretch(next.knots_m, knot_s, kRange, random);
    const Outcome outcome = run(next, scenes);
    best.ticks += outcome.ticks;
    if (outcome.extracted_mj > best.outcome.extracted_mj) {
      best.outcome = outcome;
      best.spec = std::move(next);
    }
  }
  return best;
}

RunSpec shrink(const RunSpec& given, const Scenes& scenes, const StillBad& bad) {
  RunSpec best = given;
  const auto still = [&](const RunSpec& spec) { return bad(run(spec, scenes)); };
  const auto keep_if = [&](const RunSpec& spec) {
    if (!still(spec)) return false;
    best = spec;
    return true;
  };
  if (best.hand == HandKind::kClimbWhite || best.hand == HandKind::kClimbSlow)
    best = climb(best, scenes).spec;
  // A hand that answers the force is written down as what it did: the trace then means the same whatever the
  // product answers.
  if (is_driven(best.hand) && best.hand != HandKind::kPath)
    keep_if(with_path(best, 1 / best.rate_hz, path_of(best, scenes)));

  // What happens after the worst is of no interest.
  double at_s = best.seconds;
  RunExtras extras;
  extras.most_extracted_at_s = &at_s;
  const Outcome whole = run(best, scenes, extras);
  for (const double end_s : {whole.violated_s + 0.01, at_s + 0.01}) {
    if (!(end_s > 0.02) || end_s >= best.seconds || best.hand != HandKind::kPath) continue;
    RunSpec shorter = best;
    shorter.seconds = std::max(0.1, std::ceil(100 * end_s) / 100);
    const auto knots = static_cast<std::size_t>(shorter.seconds / shorter.hand_b) + 2;
    if (knots < shorter.knots_m.size()) shorter.knots_m.resize(knots);
    if (keep_if(shorter)) break;
  }
  const RunSpec plain;
  for (const NumberField& field : number_fields()) {
    const bool essential = field.value == &RunSpec::seconds || field.value == &RunSpec::hand_a ||
                           field.value == &RunSpec::hand_b || field.value == &RunSpec::rtt_ms ||
                           field.value == &RunSpec::playout_ms;
    if (essential || best.*field.value == plain.*field.value) continue;
    RunSpec simpler = best;
    simpler.*field.value = plain.*field.value;
    keep_if(simpler);
  }
  for (const auto simplify :
       {+[](RunSpec& s) { s.drops = Drops::kNone; }, +[](RunSpec& s) { s.restart = Restart::kNever; },
        +[](RunSpec& s) { s.act = Act::kNone; },
        +[](RunSpec& s) {
          s.playout = RunSpec{}.playout;
          s.playout_ms = RunSpec{}.playout_ms;
        },
        +[](RunSpec& s) { s.scene = SceneKind::kWall; }}) {
    RunSpec simpler = best;
    simplify(simpler);
    keep_if(simpler);
  }
  for (const double rtt_ms : {0.0, 2.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0}) {
    if (rtt_ms >= best.rtt_ms) break;
    RunSpec nearer = best;
    nearer.rtt_ms = rtt_ms;
    if (keep_if(nearer)) break;
  }
  if (best.hand != HandKind::kPath) return best;
  // Coarser, then flat stretches, ever shorter, then round numbers.
  for (int i = 0; i < 6 && best.knots_m.size() > 4; ++i) {
    RunSpec coarser = best;
    coarser.hand_b *= 2;
    coarser.knots_m.clear();
    for (std::size_t k = 0; k < best.knots_m.size(); k += 2) coarser.knots_m.push_back(best.knots_m[k]);
    coarser.knots_m.push_back(best.knots_m.back());
    if (!keep_if(coarser)) break;
  }
  for (std::size_t length = best.knots_m.size() / 2; length > 0; length /= 2) {
    for (std::size_t from = 0; from + 1 < best.knots_m.size(); from += length) {
      RunSpec flatter = best;
      const double level_m = from == 0 ? 0 : best.knots_m[from - 1];
      for (std::size_t k = from; k < std::min(from + length, best.knots_m.size()); ++k)
        flatter.knots_m[k] = level_m;
      if (flatter.knots_m != best.knots_m) keep_if(flatter);
    }
  }
  for (const double grain_m : {1e-3, 1e-4, 1e-5}) {
    RunSpec rounder = best;
    for (double& knot_m : rounder.knots_m) knot_m = std::round(knot_m / grain_m) * grain_m;
    if (keep_if(rounder)) break;
  }
  return best;
}

}  // namespace telenano::studies::stress

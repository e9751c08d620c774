#include "tests/studies/stress/profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <utility>
#include <vector>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/link/recent_commands.h"
#include "tests/studies/stress/named_links.h"
#include "tests/studies/stress/summary.h"

namespace telenano::studies::stress {
namespace {

using control::Method;

constexpr double kRttMs[] = {0, 2, 10, 20, 50, 100, 200, 500, 1000};
constexpr double kLosses[] = {0, 0.01, 0.05, 0.1, 0.2, 0.3, 0.5};

struct Hand {
  HandKind kind;
  double a = 0, b = 0;
};
constexpr Hand kHands[] = {{HandKind::kPress},
                           {HandKind::kPosition},
                           {HandKind::kContact},
                           {HandKind::kIndent},
                           {HandKind::kRaster},
                           {HandKind::kHuman},
                           {HandKind::kPassive, 1, 4},
                           {HandKind::kPassive, 0.2, 80},
                           {HandKind::kPassive, 500, 300},
                           {HandKind::kPassive, 1, 450},
                           {HandKind::kSine, 0.008, 3},
                           {HandKind::kSine, 0.0025, 30},
                           {HandKind::kSquare, 0.008, 0.02},
                           {HandKind::kSquare, 0.03, 0.2},
                           {HandKind::kTelegraph, 0.012, 30},
                           {HandKind::kTelegraph, 0.003, 300},
                           {HandKind::kGreedy, 0.1, 0.01},
                           {HandKind::kGreedy, 0.5, 0},
                           {HandKind::kGreedy, 0.02, 0.05},
                           {HandKind::kWalk, 0.01, 0}};

/// A wall that is computed by hand has no scene that a station could run: with a twin the others take turns
/// in its place. False: there is none.
bool suits(const ProfileOptions& options, std::size_t turn, RunSpec& spec) {
  const auto has_scene = [](SceneKind kind) { return kind != SceneKind::kWall && kind != SceneKind::kHard; };
  if (spec.method != Method::kTwin || has_scene(spec.scene)) return true;
  std::vector<SceneKind> others;
  std::copy_if(options.scenes.begin(), options.scenes.end(), std::back_inserter(others), has_scene);
  if (others.empty()) return false;
  spec.scene = others[turn % others.size()];
  return true;
}

/// A field of a run, and the values that it takes.
template <class Value>
struct Axis {
  Value RunSpec::*field;
  std::vector<Value> values;
};
template <class Value>
Axis<Value> over(Value RunSpec::*field, std::initializer_list<Value> values) {
  return {field, values};
}
template <std::size_t kCount>
Axis<double> over(double RunSpec::*field, const double (&values)[kCount]) {
  return {field, {values, values + kCount}};
}

/// Collects the runs of a grid. Every section is a function of `base`; seeds come at the end.
class Grid {
 public:
  explicit Grid(const ProfileOptions& options) : options_(options) {}

  void add(RunSpec spec) {
    if (!suits(options_, specs.size(), spec)) return;
    const bool scene =
        std::find(options_.scenes.begin(), options_.scenes.end(), spec.scene) != options_.scenes.end();
    if (scene && options_.rtt_ms.holds(spec.rtt_ms) && options_.loss.holds(spec.loss)) specs.push_back(spec);
  }
  void add(RunSpec spec, const Hand& hand) {
    spec.hand = hand.kind;
    spec.hand_a = hand.a;
    spec.hand_b = hand.b;
    add(spec);
  }
  /// Every combination of the axes' values, the last axis varying fastest, each with these hands.
  void sweep(const RunSpec& spec, std::initializer_list<Hand> hands) {
    for (const Hand& hand : hands) add(spec, hand);
  }
  template <class Axis, class... Rest>
  void sweep(RunSpec spec, std::initializer_list<Hand> hands, const Axis& axis, const Rest&... rest) {
    for (const auto value : axis.values) {
      spec.*axis.field = value;
      sweep(spec, hands, rest...);
    }
  }
  std::vector<RunSpec> specs;

 private:
  const ProfileOptions& options_;
};

// Delay against bursts of loss: the survival map, and at no loss what is shown over the round trip.
void survival(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[16], kHands[6], kHands[8]},
             over(&RunSpec::scene, {SceneKind::kWall, SceneKind::kOxide}), over(&RunSpec::rtt_ms, kRttMs),
             over(&RunSpec::loss, kLosses));
}

void bursts(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[16]}, over(&RunSpec::burst_ms, {1.0, 5.0, 100.0, 500.0}),
             over(&RunSpec::loss, {0.1, 0.5}), over(&RunSpec::rtt_ms, {0.0, 20.0, 200.0}));
}

void rates(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[16]}, over(&RunSpec::rate_hz, {500.0, 1000.0, 2000.0, 4000.0, 8000.0}),
             over(&RunSpec::rtt_ms, {0.0, 20.0, 100.0}));
}

void deaths(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[14]},
             over(&RunSpec::scene, {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPdms}),
             over(&RunSpec::restart, {Restart::kFree, Restart::kContact, Restart::kSnapIn}),
             over(&RunSpec::rtt_ms, {0.0, 20.0, 200.0}), over(&RunSpec::down_ms, {0.0, 1000.0}));
}

void outages(Grid& grid, RunSpec spec) {
  for (const double outage : {100.0, 300.0, 1000.0, 3000.0, 10000.0}) {
    spec.outage_ms = outage;
    spec.seconds = outage > 3000 ? 20 : 10;
    grid.sweep(spec, {kHands[0], kHands[16]}, over(&RunSpec::rtt_ms, {0.0, 20.0, 200.0}),
               over(&RunSpec::scene, {SceneKind::kWall, SceneKind::kPolystyrene}));
  }
}

void late_ticks(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[14], kHands[16]}, over(&RunSpec::late, {0.01, 0.1}),
             over(&RunSpec::late_periods, {1.0, 10.0, 50.0}), over(&RunSpec::rtt_ms, {0.0, 50.0}));
}

void clocks(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[19]}, over(&RunSpec::rtt_ms, {2.0, 100.0}),
             over(&RunSpec::drift_ppm, {-200.0, 200.0}), over(&RunSpec::leap_ms, {0.0, 10.0, 1000.0}));
}

void disorder(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[16]}, over(&RunSpec::rtt_ms, {20.0, 200.0}),
             over(&RunSpec::jitter, {0.1, 0.5, 1.0}), over(&RunSpec::duplicate, {0.0, 0.2}),
             over(&RunSpec::reorder, {0.0, 0.05, 0.2}));
}

void spiteful_links(Grid& grid, RunSpec spec) {
  grid.sweep(spec, {kHands[0], kHands[8], kHands[12], kHands[16], kHands[17]},
             over(&RunSpec::drops, {Drops::kSpite, Drops::kFlatter, Drops::kStarve}),
             over(&RunSpec::rtt_ms, kRttMs));
}

using Playout = link::PlayoutConfig::Mode;

// A delay that is long enough for most replies: two standard deviations of each way's jitter.
double enough_ms(const RunSpec& spec) {
  return spec.rtt_ms + 10 + 2 * spec.jitter * std::max(spec.rtt_ms, 4.0);
}

void play_outs(Grid& grid, RunSpec spec) {
  for (const Playout mode : {Playout::kConstant, Playout::kAdaptive}) {
    spec.playout = mode;
    for (const double rtt : {0.0, 20.0, 200.0}) {
      spec.rtt_ms = rtt;
      for (const double jitter : {0.0, 0.5}) {
        spec.jitter = jitter;
        spec.playout_ms = enough_ms(spec);
        grid.sweep(spec, {kHands[0], kHands[16]}, over(&RunSpec::loss, {0.0, 0.1}));
      }
    }
  }
}

void repeated_commands(Grid& grid, RunSpec spec) {
  spec.rtt_ms = 20;
  grid.sweep(spec, {kHands[0], kHands[16]}, over(&RunSpec::redundancy, {1.0, 4.0}),
             over(&RunSpec::loss, {0.1, 0.5}), over(&RunSpec::burst_ms, {1.0, 5.0, 20.0}));
}

void deadbands(Grid& grid, RunSpec spec) {
  for (const auto& [nm, n] : {std::pair{0.05, 0.0}, std::pair{0.2, 0.02}, std::pair{2.0, 0.2}}) {
    spec.deadband_nm = nm;
    spec.deadband_n = n;
    grid.sweep(spec, {kHands[0], kHands[16]}, over(&RunSpec::rtt_ms, {0.0, 20.0, 200.0}),
               over(&RunSpec::loss, {0.0, 0.1}));
  }
}

// All of the link's options at once where things go wrong.
void options_in_trouble(Grid& grid, RunSpec spec) {
  spec.redundancy = 4;
  spec.deadband_nm = 0.1;
  spec.deadband_n = 0.02;
  for (const Playout mode : {Playout::kConstant, Playout::kAdaptive}) {
    spec.playout = mode;
    for (const double rtt : {20.0, 200.0}) {
      spec.rtt_ms = rtt;
      spec.playout_ms = enough_ms(spec);
      for (const Hand& hand : {kHands[0], kHands[8], kHands[16]}) {
        RunSpec death = spec, outage = spec, spite = spec, starve = spec, late = spec;
        death.restart = Restart::kContact;
        death.down_ms = 500;
        outage.outage_ms = 1000;
        spite.drops = Drops::kSpite;
        starve.drops = Drops::kStarve;
        late.late = 0.05;
        late.late_periods = 20;
        for (const RunSpec& s : {death, outage, spite, starve, late}) grid.add(s, hand);
      }
    }
  }
}

// What the operator does while the tip touches; only methods that promise energy change into each other.
void acts(Grid& grid, RunSpec spec) {
  for (const Act act :
       {Act::kScale, Act::kImpedance, Act::kMethod, Act::kClutch, Act::kStop, Act::kTask, Act::kTakeOver}) {
    if (act == Act::kMethod && !control::claims_energy_bound(spec.method)) continue;
    spec.act = act;
    grid.sweep(
        spec, {kHands[0], kHands[3], kHands[8], kHands[12], kHands[16]},
        over(&RunSpec::scene, {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPdms, SceneKind::kScan}),
        over(&RunSpec::rtt_ms, {0.0, 20.0, 200.0}), over(&RunSpec::loss, {0.0, 0.1}));
  }
}

// Attraction before contact shown stronger: there is none without a twin.
void companded(Grid& grid, RunSpec spec) {
  if (spec.method != Method::kTwin) return;
  grid.sweep(spec, {kHands[0], kHands[3], kHands[8], kHands[12], kHands[16]},
             over(&RunSpec::compand, {3.0, 10.0}),
             over(&RunSpec::scene, {SceneKind::kOxide, SceneKind::kPdms, SceneKind::kScan}),
             over(&RunSpec::rtt_ms, {0.0, 20.0, 200.0}), over(&RunSpec::loss, {0.0, 0.1}));
}

// A hand that goes across ground with friction, slopes, marks, a particle: where forces act along the ground.
void across_ground(std::vector<RunSpec>& runs, RunSpec spec, const ProfileOptions& options) {
  spec.hand = HandKind::kRaster;
  spec.seconds = 5;
  for (const SceneKind scene : options.across) {
    spec.scene = scene;
    for (const double rtt_ms : {0.0, 2.0}) {
      spec.rtt_ms = rtt_ms;
      if (options.rtt_ms.holds(rtt_ms) && options.loss.holds(0)) runs.push_back(spec);
    }
  }
}

void named_links(Grid& grid, RunSpec spec) {
  for (const NamedLink& link : kNamedLinks) {
    put_link(link, spec);
    grid.sweep(spec, {kHands[0], kHands[3], kHands[8], kHands[16]},
               over(&RunSpec::scene, {SceneKind::kWall, SceneKind::kOxide, SceneKind::kScan}));
  }
}

void everything(Grid& grid, RunSpec spec) {
  for (const SceneKind scene : {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPolystyrene,
                                SceneKind::kPdms, SceneKind::kScan, SceneKind::kHard}) {
    spec.scene = scene;
    for (const double scale : {1.0, 4.0, 20.0}) {
      spec.scale = scale;
      for (const double rtt : {0.0, 20.0, 200.0}) {
        spec.rtt_ms = rtt;
        for (const Hand& hand : kHands) grid.add(spec, hand);
      }
    }
  }
}

/// Belongs to a figure's smallest version.
bool is_drawn(const RunSpec& spec) {
  RunSpec at_any_rate = spec;
  at_any_rate.rate_hz = RunSpec{}.rate_hz;
  if (!is_plain(at_any_rate) || spec.scene != SceneKind::kWall) return false;
  const bool press = spec.hand == HandKind::kPress;
  if (spec.rate_hz != at_any_rate.rate_hz) return press && spec.rtt_ms == 20;
  if (press && spec.loss == 0) return true;
  const auto in = [](double x, std::initializer_list<double> list) {
    return std::find(list.begin(), list.end(), x) != list.end();
  };
  const bool mapped = press || spec.hand == HandKind::kGreedy || spec.hand == HandKind::kPassive;
  return mapped && in(spec.rtt_ms, {0, 20, 100, 500}) && in(spec.loss, {0, 0.1, 0.5});
}

double log_uniform(Random& random, double low, double high) {
  return low * det_exp(random.uniform() * det_log(high / low));
}

RunSpec random_run(const ProfileOptions& options, Random& random) {
  RunSpec s;
  const auto one_of = [&](const auto& list) { return list[random.below(std::size(list))]; };
  s.method = one_of(options.methods);
  // The default is what a user runs: half of the runs are about it.
  if (random.chance(0.5) &&
      std::find(options.methods.begin(), options.methods.end(), Method::kModel) != options.methods.end())
    s.method = Method::kModel;
  s.scene = one_of(options.scenes);
  const Hand hand = one_of(kHands);
  s.hand = hand.kind;
  s.hand_a = hand.a > 0 ? hand.a * log_uniform(random, 0.5, 2) : 0;
  s.hand_b = hand.b > 0 ? hand.b * log_uniform(random, 0.5, hand.kind == HandKind::kPassive ? 1.0 : 2.0) : 0;
  if (random.chance(0.4)) s.scale = log_uniform(random, 0.1, 30);
  if (random.chance(0.2)) s.velocity_scale = 1e-6 * log_uniform(random, 0.3, 3);
  constexpr double kRates[] = {500, 1000, 1000, 1000, 1000, 1000, 1000, 2000, 4000};
  s.rate_hz = one_of(kRates);
  if (random.chance(0.3)) s.damping_n_s_m = log_uniform(random, 0.1, 10);
  constexpr double kQuanta[] = {0, 0, 0, 1e-6, 1e-5};
  s.quantum_m = one_of(kQuanta);
  s.rtt_ms = random.chance(0.5) ? one_of(kRttMs) : log_uniform(random, 0.5, 1000);
  s.rtt_ms = std::clamp(s.rtt_ms, options.rtt_ms.low, options.rtt_ms.high);
  if (random.chance(0.4)) s.jitter = random.uniform();
  if (random.chance(0.5)) {
    s.loss = 0.5 * random.uniform();
    s.burst_ms = log_uniform(random, 1, 500);
  }
  s.loss = std::clamp(s.loss, options.loss.low, options.loss.high);
  if (random.chance(0.3)) s.duplicate = 0.2 * random.uniform();
  if (random.chance(0.3)) s.reorder = 0.2 * random.uniform();
  if (random.chance(0.3)) s.drift_ppm = random.uniform(-200, 200);
  if (random.chance(0.1)) s.leap_ms = log_uniform(random, 1, 3000);
  if (random.chance(0.15)) s.outage_ms = log_uniform(random, 100, 5000);
  if (random.chance(0.2)) {
    s.restart = static_cast<Restart>(1 + random.below(4));
    if (random.chance(0.5)) s.down_ms = log_uniform(random, 10, 2000);
  }
  if (random.chance(0.2)) {
    s.late = log_uniform(random, 0.001, 0.1);
    s.late_periods = std::floor(log_uniform(random, 1, 50));
  }
  if (random.chance(0.25)) {
    s.act = static_cast<Act>(1 + random.below(kActs));
    if (s.act == Act::kMethod && !control::claims_energy_bound(s.method)) s.act = Act::kClutch;
    if (s.act == Act::kTakeOver && s.restart != Restart::kNever) s.act = Act::kTask;
  }
  if (random.chance(0.15)) s.drops = static_cast<Drops>(1 + random.below(3));
  if (random.chance(0.25)) {
    s.playout = random.chance(0.5) ? Playout::kConstant : Playout::kAdaptive;
    // From too short for most replies to long enough for all.
    s.playout_ms = random.uniform(0.8, 1.3) * enough_ms(s);
  }
  if (random.chance(0.25)) s.redundancy = static_cast<double>(1 + random.below(link::kMaxRecent));
  if (random.chance(0.2)) {
    s.deadband_nm = log_uniform(random, 0.01, 3);
    if (random.chance(0.5)) s.deadband_n = log_uniform(random, 0.005, 0.5);
  }
  if (s.method == Method::kTwin && random.chance(0.3)) s.compand = log_uniform(random, 1, 10);
  return s;
}

// A deadband that a hand hardly notices, a coarse one, and one that everything is within: then a reply comes every 6 ms.
void replies_left_out(Grid& grid, RunSpec spec) {
  for (const auto& [permille, n] :
       {std::pair{50.0, 0.005}, std::pair{100.0, 0.02}, std::pair{400.0, 0.1}, std::pair{1000.0, 100.0}}) {
    spec.reply_permille = permille;
    spec.reply_n = n;
    grid.sweep(
        spec, {kHands[0], kHands[3], kHands[8], kHands[12], kHands[16], kHands[17]},
        over(&RunSpec::scene, {SceneKind::kWall, SceneKind::kOxide, SceneKind::kPdms, SceneKind::kScan}),
        over(&RunSpec::rtt_ms, {0.0, 20.0, 200.0}), over(&RunSpec::loss, {0.0, 0.1}));
    options_in_trouble(grid, spec);
    acts(grid, spec);
  }
}

// In a session with a twin every command is answered.
std::vector<RunSpec> make_replies(const ProfileOptions& options) {
  ProfileOptions others = options;
  std::erase(others.methods, Method::kTwin);
  if (others.methods.empty()) throw UserError("stress: with a twin no reply is left out; name other methods");
  Grid grid(others);
  for (const Method method : others.methods) {
    RunSpec base;
    base.method = method;
    replies_left_out(grid, base);
  }
  Random random(options.seed * 0x9e3779b97f4a7c15ull + 3);
  constexpr int kRandoms = 3000;
  for (int i = 0; i < kRandoms; ++i) {
    RunSpec spec = random_run(others, random);
    spec.reply_permille = random.chance(0.2) ? 1000 : log_uniform(random, 10, 1000);
    spec.reply_n = random.chance(0.2) ? 100 : log_uniform(random, 1e-4, 1);
    if (suits(others, grid.specs.size(), spec)) grid.specs.push_back(spec);
  }
  if (grid.specs.empty()) throw UserError("stress: these scenes and ranges leave no run");
  for (std::size_t i = grid.specs.size() - 1; i > 0; --i)
    std::swap(grid.specs[i], grid.specs[random.below(i + 1)]);
  std::uint64_t state = options.seed;
  for (RunSpec& spec : grid.specs) spec.seed = Random::splitmix64(state) >> 1;
  return std::move(grid.specs);
}

void climbs(Grid& grid, RunSpec spec, int tries) {
  spec.seconds = 3;
  for (const double rtt : {0.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0}) {
    spec.rtt_ms = rtt;
    for (const Drops drops : {Drops::kNone, Drops::kSpite, Drops::kFlatter, Drops::kStarve}) {
      spec.drops = drops;
      spec.scale = drops == Drops::kNone ? 1.25 : 4;
      grid.add(spec, {HandKind::kClimbWhite, static_cast<double>(tries)});
      grid.add(spec, {HandKind::kClimbSlow, static_cast<double>(tries)});
    }
  }
}

std::vector<RunSpec> make_sample(const ProfileOptions& options) {
  std::vector<RunSpec> runs;
  Random random(options.seed * 0x9e3779b97f4a7c15ull + 2);
  std::uint64_t state = options.seed;
  for (std::size_t turn = 0; runs.size() < options.sample; ++turn) {
    RunSpec spec = random_run(options, random);
    if (!suits(options, turn, spec)) throw UserError("stress: these scenes leave no run");
    spec.seed = Random::splitmix64(state) >> 1;
    runs.push_back(spec);
  }
  return runs;
}

}  // namespace

std::string ProfileOptions::text() const {
  std::string text = fmt::format("profile={} seed={} methods=",
                                 sample > 0 ? fmt::format("sample-{}", sample)
                                 : replies  ? "replies"
                                 : full     ? "full"
                                            : "quick",
                                 seed);
  for (std::size_t i = 0; i < methods.size(); ++i)
    text += fmt::format("{}{}", i == 0 ? "" : ",", control::method_name(methods[i]));
  text += " scenes=";
  for (std::size_t i = 0; i < scenes.size(); ++i)
    text += fmt::format("{}{}", i == 0 ? "" : ",", scene_kind_name(scenes[i]));
  const bool has_grid = sample == 0 && !replies;
  for (std::size_t i = 0; has_grid && i < across.size(); ++i)
    text += fmt::format("{}{}", i == 0 ? " across=" : ",", scene_kind_name(across[i]));
  return text + fmt::format(" rtt-ms={}:{} loss={}:{}", rtt_ms.low, rtt_ms.high, loss.low, loss.high);
}

bool is_sample(std::string_view profile_text) noexcept {
  return profile_text.find("profile=sample-") != std::string_view::npos;
}

std::vector<RunSpec> make_profile(const ProfileOptions& options) {
  if (options.sample > 0) return make_sample(options);
  if (options.replies) return make_replies(options);
  Grid grid(options);
  for (const Method method : options.methods) {
    RunSpec base;
    base.method = method;
    const std::size_t first = grid.specs.size();
    for (const auto section :
         {survival, bursts, rates, deaths, outages, late_ticks, clocks, disorder, spiteful_links, play_outs,
          repeated_commands, deadbands, options_in_trouble, acts, companded, named_links, everything})
      section(grid, base);
    if (options.full) continue;
    // What the figures are made of, and of the rest every so manieth, so that each section keeps some; the
    // step shares no factor with the sections' sizes.
    std::size_t kept = first;
    const std::size_t step = method == Method::kModel ? 7 : 41;
    for (std::size_t i = first; i < grid.specs.size(); ++i) {
      if (is_drawn(grid.specs[i]) || (i - first) % step == 0) grid.specs[kept++] = grid.specs[i];
    }
    grid.specs.resize(kept);
    for (std::size_t i = first; i < kept; ++i) grid.specs[i].seconds = std::min(grid.specs[i].seconds, 5.0);
  }
  for (const Method method : options.methods) {
    RunSpec base;
    base.method = method;
    across_ground(grid.specs, base, options);
  }
  Random random(options.seed * 0x9e3779b97f4a7c15ull + 1);
  const int randoms = options.full ? 9000 : 200;
  for (int i = 0; i < randoms; ++i) {
    RunSpec spec = random_run(options, random);
    if (!options.full) spec.seconds = 5;
    if (suits(options, grid.specs.size(), spec)) grid.specs.push_back(spec);
  }
  for (const Method method : options.methods) {
    RunSpec base;
    base.method = method;
    const std::size_t first = grid.specs.size();
    climbs(grid, base, options.full ? 100 : 8);
    if (options.full) continue;
    std::size_t kept = first;
    for (std::size_t i = first; i < grid.specs.size(); i += 19) grid.specs[kept++] = grid.specs[i];
    grid.specs.resize(kept);
    for (std::size_t i = first; i < kept; ++i) grid.specs[i].seconds = 2;
  }
  if (grid.specs.empty()) throw UserError("stress: these scenes and ranges leave no run");
  // Mixed: what is there of an unfinished table stands for the whole, shards take equally long, and the time
  // left can be told.
  for (std::size_t i = grid.specs.size() - 1; i > 0; --i)
    std::swap(grid.specs[i], grid.specs[random.below(i + 1)]);
  std::uint64_t state = options.seed;
  for (RunSpec& spec : grid.specs) spec.seed = Random::splitmix64(state) >> 1;
  return std::move(grid.specs);
}

}  // namespace telenano::studies::stress

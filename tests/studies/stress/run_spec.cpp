#include "tests/studies/stress/run_spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "telenano/common/base/error.h"
#include "telenano/common/link/recent_commands.h"
#include "tests/studies/stress/named_links.h"

namespace telenano::studies::stress {
namespace {

constexpr std::array<std::string_view, 9> kScenes = {"wall", "oxide", "polystyrene", "pdms",    "scan",
                                                     "hard", "moist", "marks",       "particle"};
constexpr std::array<std::string_view, 15> kHands = {
    "press",  "position",  "contact", "indent", "raster",      "human",      "passive", "sine",
    "square", "telegraph", "greedy",  "walk",   "climb-white", "climb-slow", "path"};
constexpr std::array<std::string_view, 4> kDrops = {"none", "spite", "flatter", "starve"};
constexpr std::array<std::string_view, 3> kPlayouts = {"newest", "constant", "adaptive"};
constexpr std::array<std::string_view, 5> kRestarts = {"never", "free", "contact", "snap-in", "random"};
constexpr std::array<std::string_view, kActs + 1> kActNames = {"none",   "scale", "impedance", "method",
                                                               "clutch", "stop",  "task",      "take-over"};
constexpr std::array<std::string_view, kMutants + 1> kMutantNames = {"none",
                                                                     "wrong-index",
                                                                     "credited-damping",
                                                                     "missing-epoch",
                                                                     "held-wave",
                                                                     "uncapped-damper",
                                                                     "no-clamp",
                                                                     "damper-after-clamp",
                                                                     "half-velocity",
                                                                     "free-tank",
                                                                     "sticky-force",
                                                                     "leap-on-resume",
                                                                     "double-force",
                                                                     "slave-too-strong",
                                                                     "falling-sums",
                                                                     "slave-no-force",
                                                                     "slave-half-force",
                                                                     "slave-late",
                                                                     "slave-no-adhesion",
                                                                     "slave-no-friction",
                                                                     "slave-tilted",
                                                                     "slave-reversed",
                                                                     "slave-swapped",
                                                                     "slave-low",
                                                                     "slave-soft",
                                                                     "slave-frozen",
                                                                     "slave-leaky",
                                                                     "slave-sticky",
                                                                     "slave-coarse",
                                                                     "slave-noisy",
                                                                     "slave-saturated",
                                                                     "slave-upside-down",
                                                                     "forgiving-change",
                                                                     "generous-change",
                                                                     "slave-stiff",
                                                                     "slave-creeping",
                                                                     "slave-blinking",
                                                                     "codec-swapped",
                                                                     "codec-unsigned",
                                                                     "codec-short",
                                                                     "codec-keeps-fields",
                                                                     "session-old-news",
                                                                     "session-one-epoch",
                                                                     "session-deaf",
                                                                     "record-late",
                                                                     "record-rendered",
                                                                     "record-gaps",
                                                                     "record-single",
                                                                     "record-swapped",
                                                                     "gate-creeping",
                                                                     "gate-silent",
                                                                     "gate-forgetful",
                                                                     "gate-blind",
                                                                     "slave-holds-on",
                                                                     "slave-drifts",
                                                                     "slave-gives-uncounted",
                                                                     "slave-takes-uncounted",
                                                                     "twin-half",
                                                                     "twin-late",
                                                                     "twin-no-friction",
                                                                     "twin-one-way",
                                                                     "ks-half",
                                                                     "clamp-half",
                                                                     "tdpa-half",
                                                                     "wave-half",
                                                                     "record-energy",
                                                                     "record-force",
                                                                     "station-holds-clutch",
                                                                     "station-holds-stop",
                                                                     "station-far",
                                                                     "station-swapped",
                                                                     "station-old-scale",
                                                                     "station-old-force",
                                                                     "station-too-stiff",
                                                                     "slave-slow",
                                                                     "command-coarse",
                                                                     "command-late",
                                                                     "slave-goes-back",
                                                                     "station-no-trip"};

constexpr NumberField kNumbers[] = {
    {"scale", &RunSpec::scale, 1e-3, 1e4},
    {"velocity-scale", &RunSpec::velocity_scale, 1e-9, 1e-3},
    {"rate-hz", &RunSpec::rate_hz, 100, 8000},
    {"seconds", &RunSpec::seconds, 0.1, 3600},
    {"hand-a", &RunSpec::hand_a, 0, 1e6},
    {"hand-b", &RunSpec::hand_b, 0, 1e6},
    {"damping", &RunSpec::damping_n_s_m, 0, 100},
    {"quantum-m", &RunSpec::quantum_m, 0, 1e-3},
    {"rtt-ms", &RunSpec::rtt_ms, 0, 5000},
    {"jitter", &RunSpec::jitter, 0, 4},
    {"loss", &RunSpec::loss, 0, 0.99},
    {"burst-ms", &RunSpec::burst_ms, 0.1, 10000},
    {"duplicate", &RunSpec::duplicate, 0, 1},
    {"reorder", &RunSpec::reorder, 0, 1},
    {"drift-ppm", &RunSpec::drift_ppm, -10000, 10000},
    {"leap-ms", &RunSpec::leap_ms, 0, 100000},
    {"outage-ms", &RunSpec::outage_ms, 0, 100000},
    {"down-ms", &RunSpec::down_ms, 0, 100000},
    {"late", &RunSpec::late, 0, 1},
    {"late-periods", &RunSpec::late_periods, 0, 1000},
    {"playout-ms", &RunSpec::playout_ms, 0, 5000},
    {"redundancy", &RunSpec::redundancy, 0, static_cast<double>(link::kMaxRecent), true},
    {"deadband-nm", &RunSpec::deadband_nm, 0, 100},
    {"deadband-n", &RunSpec::deadband_n, 0, 10},
    {"reply-permille", &RunSpec::reply_permille, 0, 1000},
    {"reply-n", &RunSpec::reply_n, 0, 100},
    {"compand", &RunSpec::compand, 1, 10},
};

template <std::size_t N>
std::string joined(const std::array<std::string_view, N>& names) {
  std::string all;
  for (const auto name : names) all += (all.empty() ? "" : ", ") + std::string(name);
  return all;
}

template <class Enum, std::size_t N>
Enum parse_enum(std::string_view name, const std::array<std::string_view, N>& names, const char* what) {
  for (std::size_t i = 0; i < N; ++i) {
    if (names[i] == name) return static_cast<Enum>(i);
  }
  throw UserError(fmt::format("{} '{}' is unknown; expected one of {}", what, name, joined(names)));
}

template <class Enum, std::size_t N>
std::string_view name_of(Enum value, const std::array<std::string_view, N>& names) noexcept {
  const auto index = static_cast<std::size_t>(value);
  return index < N ? names[index] : "unknown";
}

double parse_number(std::string_view text, std::string_view key) {
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size() || !std::isfinite(value))
    throw UserError(fmt::format("run: {}: '{}' is no number", key, text));
  return value;
}

}  // namespace

std::span<const NumberField> number_fields() noexcept {
  return kNumbers;
}
std::string_view scene_kind_name(SceneKind kind) noexcept {
  return name_of(kind, kScenes);
}
std::string_view hand_name(HandKind kind) noexcept {
  return name_of(kind, kHands);
}
std::string_view drops_name(Drops drops) noexcept {
  return name_of(drops, kDrops);
}
std::string_view restart_name(Restart restart) noexcept {
  return name_of(restart, kRestarts);
}
std::string_view act_name(Act act) noexcept {
  return name_of(act, kActNames);
}
std::string_view playout_name(link::PlayoutConfig::Mode playout) noexcept {
  return name_of(playout, kPlayouts);
}
std::string_view mutant_name(Mutant mutant) noexcept {
  return name_of(mutant, kMutantNames);
}
SceneKind parse_scene_kind(std::string_view name) {
  return parse_enum<SceneKind>(name, kScenes, "scene");
}
Mutant parse_mutant(std::string_view name) {
  return parse_enum<Mutant>(name, kMutantNames, "mutant");
}
std::string scene_kind_names() {
  return joined(kScenes);
}
std::array<Mutant, kMutants> all_mutants() noexcept {
  std::array<Mutant, kMutants> all{};
  for (std::size_t i = 0; i < kMutants; ++i) all[i] = static_cast<Mutant>(i + 1);
  return all;
}

std::string to_text(const RunSpec& spec) {
  const RunSpec plain;
  std::string text = fmt::format("method={} scene={} hand={}", control::method_name(spec.method),
                                 scene_kind_name(spec.scene), hand_name(spec.hand));
  if (spec.mutant != Mutant::kNone) text += fmt::format(" mutant={}", mutant_name(spec.mutant));
  if (spec.drops != Drops::kNone) text += fmt::format(" drops={}", drops_name(spec.drops));
  if (spec.restart != Restart::kNever) text += fmt::format(" restart={}", restart_name(spec.restart));
  if (spec.act != Act::kNone) text += fmt::format(" act={}", act_name(spec.act));
  if (spec.playout != plain.playout) text += fmt::format(" playout={}", playout_name(spec.playout));
  for (const NumberField& field : kNumbers) {
    if (spec.*field.value != plain.*field.value) text += fmt::format(" {}={}", field.key, spec.*field.value);
  }
  text += fmt::format(" seed={}", spec.seed);
  if (!spec.knots_m.empty()) {
    text += " knots-m=";
    for (std::size_t i = 0; i < spec.knots_m.size(); ++i)
      text += fmt::format("{}{}", i == 0 ? "" : ",", spec.knots_m[i]);
  }
  return text;
}

RunSpec parse_run_spec(const std::string& text) {
  RunSpec spec;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const auto equals = word.find('=');
    if (equals == std::string::npos)
      throw UserError(fmt::format("run: '{}' is not of the form key=value", word));
    const std::string key = word.substr(0, equals);
    const std::string value = word.substr(equals + 1);
    if (key == "method") {
      spec.method = control::parse_method(value);
    } else if (key == "scene") {
      spec.scene = parse_scene_kind(value);
    } else if (key == "hand") {
      spec.hand = parse_enum<HandKind>(value, kHands, "hand");
    } else if (key == "mutant") {
      spec.mutant = parse_mutant(value);
    } else if (key == "drops") {
      spec.drops = parse_enum<Drops>(value, kDrops, "drops");
    } else if (key == "restart") {
      spec.restart = parse_enum<Restart>(value, kRestarts, "restart");
    } else if (key == "link") {
      const auto* const named = std::find_if(kNamedLinks.begin(), kNamedLinks.end(),
                                             [&](const NamedLink& link) { return link.name == value; });
      if (named == kNamedLinks.end()) {
        std::string names;
        for (const NamedLink& link : kNamedLinks)
          names += (names.empty() ? "" : ", ") + std::string(link.name);
        throw UserError(fmt::format("run: link '{}' is unknown; expected one of {}", value, names));
      }
      put_link(*named, spec);
    } else if (key == "act") {
      spec.act = parse_enum<Act>(value, kActNames, "act");
    } else if (key == "playout") {
      spec.playout = parse_enum<link::PlayoutConfig::Mode>(value, kPlayouts, "playout");
    } else if (key == "seed") {
      const auto result = std::from_chars(value.data(), value.data() + value.size(), spec.seed);
      if (result.ec != std::errc() || result.ptr != value.data() + value.size())
        throw UserError(fmt::format("run: seed: '{}' is no whole number", value));
    } else if (key == "knots-m") {
      std::istringstream knots(value);
      for (std::string knot; std::getline(knots, knot, ',');) spec.knots_m.push_back(parse_number(knot, key));
    } else {
      const NumberField* found = nullptr;
      for (const NumberField& field : kNumbers) {
        if (key == field.key) found = &field;
      }
      if (found == nullptr) throw UserError(fmt::format("run: key '{}' is unknown", key));
      const double number = parse_number(value, key);
      if (!(number >= found->low && number <= found->high))
        throw UserError(fmt::format("run: {}={} is out of range; expected {} to {}", key, number, found->low,
                                    found->high));
      if (found->whole && number != std::floor(number))
        throw UserError(fmt::format("run: {}={}: expected a whole number", key, number));
      spec.*found->value = number;
    }
  }
  if (spec.hand == HandKind::kPath && (spec.knots_m.size() < 2 || !(spec.hand_b > 0)))
    throw UserError(
        "run: hand=path needs knots-m with two points at least, and hand-b, the seconds between them");
  if (spec.act == Act::kTakeOver && spec.restart != Restart::kNever)
    throw UserError(
        "run: act=take-over: both operators are at one server, which goes on; expected restart=never");
  return spec;
}

}  // namespace telenano::studies::stress

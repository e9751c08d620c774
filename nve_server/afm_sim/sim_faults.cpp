#include "telenano/nve_server/afm_sim/sim_faults.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <sstream>
#include <string_view>
#include <utility>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"

namespace telenano::afm_sim {
namespace {

[[noreturn]] void refuse(const std::string& what, const std::string& text) {
  throw UserError(what + " '" + text +
                  "': expected [@TIME] silent TIME | reset | garbage | slow TIME DELAY | sensor "
                  "frozen|high|low|noisy|inverted|swapped|good | dip DEPTH TIME | withdraw undone|half "
                  "N|ever, e.g. '@5s silent 500ms', 'dip 8nm 12ms'");
}

/// A number and its unit.
std::pair<double, std::string> parse_quantity(const std::string& word, const std::string& what,
                                              const std::string& text) {
  try {
    std::size_t end = 0;
    const double value = std::stod(word, &end);
    return {value, word.substr(end)};
  } catch (const std::exception&) {
    refuse(what, text);
  }
}

std::int64_t parse_time(const std::string& word, const std::string& what, const std::string& text) {
  const auto [value, unit] = parse_quantity(word, what, text);
  const double scale = unit == "s" ? 1e9 : unit == "ms" ? 1e6 : 0;
  if (scale == 0 || !(value >= 0 && value <= 1e6)) refuse(what, text);
  return static_cast<std::int64_t>(std::llround(value * scale));
}

}  // namespace

Fault parse_fault(const std::string& text, const std::string& what) {
  std::istringstream words(text);
  Fault fault;
  std::string word, rest;
  if (!(words >> word)) refuse(what, text);
  if (word[0] == '@') {
    fault.at_ns = parse_time(word.substr(1), what, text);
    if (!(words >> word)) refuse(what, text);
  }
  const auto next = [&] {
    std::string t;
    if (!(words >> t)) refuse(what, text);
    return t;
  };
  const auto time = [&] { return parse_time(next(), what, text); };
  if (word == "silent") {
    fault.kind = FaultKind::kSilent;
    fault.length_ns = time();
  } else if (word == "reset") {
    fault.kind = FaultKind::kReset;
  } else if (word == "garbage") {
    fault.kind = FaultKind::kGarbage;
  } else if (word == "slow") {
    fault.kind = FaultKind::kSlow;
    fault.length_ns = time();
    fault.delay_ns = time();
  } else if (word == "sensor") {
    fault.kind = FaultKind::kSensor;
    constexpr std::string_view kNames[] = {"good", "frozen", "high", "low", "noisy", "inverted", "swapped"};
    if (!(words >> word)) refuse(what, text);
    const auto* const found = std::find(std::begin(kNames), std::end(kNames), word);
    if (found == std::end(kNames)) refuse(what, text);
    fault.sensor = static_cast<SensorFault>(found - std::begin(kNames));
  } else if (word == "withdraw") {
    fault.kind = FaultKind::kWithdraw;
    std::string how, times;
    if (!(words >> how >> times) || (how != "undone" && how != "half")) refuse(what, text);
    fault.withdraw = how == "half" ? WithdrawFault::kHalf : WithdrawFault::kUndone;
    const char* const end = times.data() + times.size();
    fault.count = -1;
    if (times != "ever" &&
        (std::from_chars(times.data(), end, fault.count).ptr != end || fault.count < 0 || fault.count > 1000))
      refuse(what, text);
  } else if (word == "dip") {
    fault.kind = FaultKind::kDip;
    const auto [depth_nm, unit] = parse_quantity(next(), what, text);
    if (unit != "nm" || !(std::fabs(depth_nm) <= 1e6)) refuse(what, text);
    fault.depth_nm = depth_nm;
    fault.length_ns = time();
  } else {
    refuse(what, text);
  }
  if (words >> rest) refuse(what, text);
  return fault;
}

std::vector<Fault> random_faults(std::uint64_t seed, double per_minute, double duration_s) {
  Random random(seed);
  std::vector<Fault> faults;
  if (!(per_minute > 0)) return faults;
  for (double at_s = 0;;) {
    at_s += random.exponential() * 60 / per_minute;
    if (at_s > duration_s) return faults;
    Fault fault;
    fault.at_ns = static_cast<std::int64_t>(at_s * 1e9);
    fault.kind = static_cast<FaultKind>(random.below(4));
    fault.length_ns = static_cast<std::int64_t>(1e6 * det_exp(random.uniform(0, det_log(1e4))));
    fault.delay_ns = static_cast<std::int64_t>(1e6 * random.uniform(1, 100));
    faults.push_back(fault);
  }
}

}  // namespace telenano::afm_sim

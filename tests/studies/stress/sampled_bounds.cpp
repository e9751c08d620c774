#include "tests/studies/stress/sampled_bounds.h"

#include <fmt/format.h>

#include <map>
#include <tuple>

#include "tests/studies/stress/binomial_bounds.h"
#include "tests/studies/stress/invariants.h"

namespace telenano::studies::stress {
namespace {

constexpr double kEachSide = 0.975;

struct Count {
  std::size_t runs = 0, broken = 0;
};

}  // namespace

std::vector<SampledRate> sampled_rates(const std::vector<Row>& rows) {
  std::map<std::tuple<std::size_t, std::string, std::string>, Count> counts;
  for (const Row& row : rows) {
    const RunSpec& s = row.spec;
    const bool broken = (row.outcome.violated & promised(s.method)) != 0;
    const auto count = [&](const char* feature, std::string_view value) {
      Count& c = counts[{static_cast<std::size_t>(s.method), feature, std::string(value)}];
      ++c.runs;
      c.broken += broken;
    };
    count("", "");
    count("scene", scene_kind_name(s.scene));
    count("hand", hand_name(s.hand));
    count("act", act_name(s.act));
    count("restart", restart_name(s.restart));
    count("drops", drops_name(s.drops));
    count("playout", playout_name(s.playout));
    count("loss", s.loss > 0 ? "some" : "none");
    count("outage", s.outage_ms > 0 ? "some" : "none");
    count("late-ticks", s.late > 0 ? "some" : "none");
    count("round-trip", s.rtt_ms < 20 ? "below 20 ms" : s.rtt_ms < 200 ? "20 to 200 ms" : "200 ms and more");
    count("device-damping", s.damping_n_s_m < 1 ? "below 1 N s/m" : "1 N s/m and more");
  }
  std::vector<SampledRate> rates;
  for (const auto& [key, c] : counts) {
    const auto& [method, feature, value] = key;
    rates.push_back({static_cast<control::Method>(method), feature, value, c.runs, c.broken,
                     binomial_lower(c.broken, c.runs, kEachSide),
                     binomial_upper(c.broken, c.runs, kEachSide)});
  }
  return rates;
}

std::string sampled_bounds_csv(const std::vector<Row>& rows) {
  std::string csv = "method,feature,value,runs,broken_promises,rate_low_95,rate_high_95\n";
  for (const SampledRate& r : sampled_rates(rows))
    csv += fmt::format("{},{},{},{},{},{:.3g},{:.3g}\n", control::method_name(r.method), r.feature, r.value,
                       r.runs, r.broken, r.low, r.high);
  return csv;
}

}  // namespace telenano::studies::stress

#include "tests/studies/stress/summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tests/studies/stress/binomial_bounds.h"
#include "tests/studies/stress/stress_report.h"
#include "tests/studies/stress/sweep.h"

namespace telenano::studies::stress {

double MethodSummary::rate_at_most() const noexcept {
  return binomial_upper(broken, runs, 0.95);
}

std::vector<MethodSummary> summarise(const std::vector<Row>& rows) {
  std::vector<MethodSummary> all;
  for (const control::Method method : control::kAllMethods) {
    MethodSummary s;
    s.method = method;
    s.most_allowed_mj = 1e3 * promised_extraction_j(method, station::StationConfig{}.allowance_j);
    for (const Row& row : rows) {
      if (row.spec.method != method) continue;
      const Outcome& o = row.outcome;
      ++s.runs;
      s.broken += (o.violated & promised(method)) != 0;
      s.survived += o.survived();
      s.stopped += o.stopped_s >= 0;
      s.too_fast += o.too_fast_s >= 0;
      s.repeated += row.index % kRepeatEvery == 0;
      for (int i = 0; i < kInvariants; ++i) s.violated[static_cast<std::size_t>(i)] += (o.violated >> i) & 1u;
      s.most_extracted_mj = std::max(s.most_extracted_mj, o.extracted_mj);
      s.least_margin_mj = std::min(s.least_margin_mj, o.margin_mj);
      s.slowest_recovery_s = std::max(s.slowest_recovery_s, o.recover_s);
      s.most_tip_nn = std::max(s.most_tip_nn, o.tip_nn);
      if (std::isfinite(o.over_force)) s.most_over_force = std::max(s.most_over_force, o.over_force);
      s.ticks += o.ticks;
      s.simulated_s += static_cast<double>(o.ticks) / row.spec.rate_hz;
      s.clamp_ticks += o.clamp_ticks;
      s.limit_ticks += o.limit_ticks;
      s.stop_ticks += o.stop_ticks;
    }
    if (s.runs > 0) all.push_back(s);
  }
  return all;
}

bool is_plain(const RunSpec& spec) noexcept {
  const RunSpec plain;
  for (const NumberField& field : number_fields()) {
    if (field.value == &RunSpec::rtt_ms || field.value == &RunSpec::loss || field.value == &RunSpec::hand_a ||
        field.value == &RunSpec::hand_b || field.value == &RunSpec::seconds)
      continue;
    if (spec.*field.value != plain.*field.value) return false;
  }
  return spec.drops == Drops::kNone && spec.restart == Restart::kNever && spec.act == Act::kNone &&
         spec.playout == plain.playout && spec.mutant == Mutant::kNone;
}

std::string replay_command(const RunSpec& spec) {
  return "telenano-lab stress --replay '" + to_text(spec) + "'";
}

std::string summary_csv(const std::vector<Row>& rows) {
  std::string csv =
      "method,runs,broken_promises,rate_below_at_95,survived,stopped,most_extracted_mj,allowed_mj,"
      "least_margin_mj,slowest_recovery_s,simulated_s\n";
  for (const MethodSummary& s : summarise(rows))
    csv += fmt::format("{},{},{},{:.3g},{},{},{:.6g},{:g},{:.6g},{:.3g},{:.6g}\n",
                       control::method_name(s.method), s.runs, s.broken, s.rate_at_most(), s.survived,
                       s.stopped, s.most_extracted_mj, s.most_allowed_mj, s.least_margin_mj,
                       s.slowest_recovery_s, s.simulated_s);
  return csv;
}

}  // namespace telenano::studies::stress

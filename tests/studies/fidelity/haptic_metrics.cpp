#include "tests/studies/fidelity/haptic_metrics.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace telenano::studies::fidelity {

std::vector<std::size_t> effective_delays(std::span<const TouchTrace::Row> rows, std::size_t most,
                                          double change_n2, double& cost) {
  const std::size_t n = rows.size(), width = most + 1;
  constexpr double kNever = std::numeric_limits<double>::infinity();
  // best[d]: the least cost up to this tick with that d at its end; from[i][d]: d of the tick before.
  std::vector<double> best(width, kNever), next(width), reach(width);
  std::vector<std::uint16_t> from(n * width), reached_from(width);
  for (std::size_t i = 0; i < n; ++i) {
    // Of the tick before, the best from which d is reached by falling (any far) or staying.
    for (std::size_t k = width; k-- > 0;) {
      reach[k] = best[k];
      reached_from[k] = static_cast<std::uint16_t>(k);
      if (k + 1 < width && reach[k + 1] + change_n2 < reach[k]) {
        reach[k] = reach[k + 1] + change_n2;
        reached_from[k] = reached_from[k + 1];
      }
    }
    for (std::size_t d = 0; d < width; ++d) {
      next[d] = kNever;
      if (d > i) continue;
      double before = i == 0 ? 0 : reach[d];
      std::uint16_t by = i == 0 ? static_cast<std::uint16_t>(d) : reached_from[d];
      if (i > 0 && d > 0 && best[d - 1] + change_n2 < before) {
        before = best[d - 1] + change_n2;
        by = static_cast<std::uint16_t>(d - 1);
      }
      next[d] = before + (rows[i].felt_h_n - rows[i - d].true_h_n).squaredNorm();
      from[i * width + d] = by;
    }
    best.swap(next);
  }
  std::vector<std::size_t> delays(n);
  cost = 0;
  if (n == 0) return delays;
  auto d = static_cast<std::size_t>(std::min_element(best.begin(), best.end()) - best.begin());
  cost = best[d];
  for (std::size_t i = n; i-- > 0;) {
    delays[i] = d;
    d = from[i * width + d];
  }
  return delays;
}

namespace {

/// What one delay leaves, by regression with one gain for all axes and an offset of each.
Alignment aligned_at(std::span<const TouchTrace::Row> rows, std::size_t ticks) {
  Alignment a;
  a.ticks = ticks;
  Vec3 true_sum = Vec3::Zero(), felt_sum = Vec3::Zero();
  double true2 = 0, felt2 = 0, both = 0, count = 0;
  for (std::size_t i = ticks; i < rows.size(); ++i) {
    const Vec3 &felt = rows[i].felt_h_n, &shown = rows[i - ticks].true_h_n;
    if (!rows[i - ticks].touches && felt.norm() <= kJudgedN) continue;
    count += 1;
    true_sum += shown;
    felt_sum += felt;
    true2 += shown.squaredNorm();
    felt2 += felt.squaredNorm();
    both += felt.dot(shown);
  }
  if (count == 0) return a;
  a.found = true;
  const double true_varies = true2 - true_sum.squaredNorm() / count;
  const double together = both - true_sum.dot(felt_sum) / count;
  if (true_varies > count * kJudgedN * kJudgedN) a.gain = together / true_varies;
  a.offset_n = (felt_sum - a.gain * true_sum) / count;
  const double felt_varies = felt2 - felt_sum.squaredNorm() / count;
  a.left_n =
      std::sqrt(std::max(0.0, felt_varies - 2 * a.gain * together + a.gain * a.gain * true_varies) / count);
  return a;
}

}  // namespace

Alignment align(std::span<const TouchTrace::Row> rows, std::size_t most) {
  Alignment best = aligned_at(rows, 0);
  for (std::size_t ticks = 1; ticks <= std::min(most, rows.size() / 2); ++ticks) {
    const Alignment next = aligned_at(rows, ticks);
    if (next.found && (!best.found || next.left_n < best.left_n - 1e-9)) best = next;
  }
  return best;
}

namespace {

void judge_delay(const TouchTrace& trace, double delay_max_s, HapticMetrics& m) {
  const auto most = static_cast<std::size_t>(std::llround(delay_max_s / trace.period_s));
  double cost = 0;
  const auto delays = effective_delays(trace.rows, most, kJudgedN * kJudgedN, cost);
  const Alignment whole = align(trace.rows, most);
  if (whole.found) {
    m.time_offset_ms = 1e3 * trace.period_s * static_cast<double>(whole.ticks);
    m.value_gain = whole.gain;
    m.value_offset_n = whole.offset_n.norm();
  }
  double sum = 0, changes = 0, error2 = 0, true2 = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    const TouchTrace::Row &felt = trace.rows[i], &shown = trace.rows[i - delays[i]];
    if (!shown.touches && felt.felt_h_n.norm() <= kJudgedN) continue;
    ++count;
    sum += static_cast<double>(delays[i]);
    if (i > 0) changes += std::fabs(static_cast<double>(delays[i]) - static_cast<double>(delays[i - 1]));
    error2 += (felt.felt_h_n - shown.true_h_n).squaredNorm();
    true2 += shown.true_h_n.squaredNorm();
  }
  if (count == 0) return;
  m.effective_delay_ms = 1e3 * trace.period_s * sum / static_cast<double>(count);
  m.effective_delay_derivative = changes / static_cast<double>(count);
  if (true2 > 0) m.effective_nrmse = std::sqrt(error2 / true2);
}

void judge_deadband(const TouchTrace& trace, HapticMetrics& m) {
  if (trace.rows.empty()) return;
  Vec3 held = Vec3::Zero();
  std::size_t sent = 0;
  double error2 = 0, true2 = 0;
  for (const TouchTrace::Row& row : trace.rows) {
    if ((row.true_h_n - held).norm() > std::max(HapticMetrics::kWeber * held.norm(), kJudgedN)) {
      held = row.true_h_n;
      ++sent;
    }
    error2 += (row.true_h_n - held).squaredNorm();
    true2 += row.true_h_n.squaredNorm();
  }
  m.weber_sent_share = static_cast<double>(sent) / static_cast<double>(trace.rows.size());
  if (true2 > 0) m.weber_nrmse = std::sqrt(error2 / true2);
}

void judge_approach(const TouchTrace& trace, HapticMetrics& m) {
  double true_n = 0, felt_n = 0;
  for (const TouchTrace::Row& row : trace.rows) {
    if (row.touches) {
      m.approach_true_n = true_n;
      m.approach_felt_n = felt_n;
      return;
    }
    true_n = std::max(true_n, -row.true_h_n.z());
    felt_n = std::max(felt_n, -row.felt_h_n.z());
  }
}

}  // namespace

HapticMetrics measure_haptic(const TouchTrace& trace, double delay_max_s) {
  HapticMetrics m;
  judge_delay(trace, delay_max_s, m);
  judge_deadband(trace, m);
  judge_approach(trace, m);
  return m;
}

}  // namespace telenano::studies::fidelity

#include "tests/studies/fidelity/felt_metrics.h"

#include <algorithm>
#include <cmath>

#include "tests/studies/fidelity/lagged_products.h"

namespace telenano::studies::fidelity {
namespace {

using Row = TouchTrace::Row;

struct Span {
  std::size_t from = 0;
  std::size_t to = 0;  // beyond the last
};

std::size_t ticks(const TouchTrace& trace, double seconds) {
  return static_cast<std::size_t>(std::llround(seconds / trace.period_s));
}

std::vector<Span> contacts(const TouchTrace& trace) {
  const std::size_t least = ticks(trace, FeltMetrics::kContactS);
  std::vector<Span> found;
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    if (!trace.rows[i].touches) continue;
    if (!found.empty() && i - found.back().to < least) {
      found.back().to = i + 1;
    } else {
      found.push_back({i, i + 1});
    }
  }
  std::erase_if(found, [&](const Span& s) { return s.to - s.from < least; });
  return found;
}

bool in_window(const Row& row) {
  return row.touches || row.felt_h_n.norm() > kJudgedN;
}

double ratio(double error2, double true2) {
  return true2 > 0 ? std::sqrt(error2 / true2) : FeltMetrics::kNone;
}

void judge_whole(const TouchTrace& trace, FeltMetrics& m) {
  Vec3 error2 = Vec3::Zero(), true2 = Vec3::Zero();
  double both = 0, felt_lateral2 = 0;
  std::size_t count = 0, touching = 0;
  for (const Row& row : trace.rows) {
    touching += row.touches;
    if (!in_window(row)) continue;
    ++count;
    const Vec3 error = row.felt_h_n - row.true_h_n;
    error2 += error.cwiseProduct(error);
    true2 += row.true_h_n.cwiseProduct(row.true_h_n);
    both += row.felt_h_n.head<2>().dot(row.true_h_n.head<2>());
    felt_lateral2 += row.felt_h_n.head<2>().squaredNorm();
  }
  m.contact_share =
      trace.rows.empty() ? 0 : static_cast<double>(touching) / static_cast<double>(trace.rows.size());
  if (count == 0) return;
  const double n = static_cast<double>(count);
  m.true_rms_n = std::sqrt(true2.sum() / n);
  const double lateral2 = true2.x() + true2.y();
  m.true_lateral_rms_n = std::sqrt(lateral2 / n);
  m.nrmse = ratio(error2.sum(), true2.sum());
  const auto axis = [&](int i) {
    return std::sqrt(true2[i] / n) > kJudgedN ? ratio(error2[i], true2[i]) : FeltMetrics::kNone;
  };
  m.nrmse_x = axis(0);
  m.nrmse_y = axis(1);
  m.nrmse_z = axis(2);
  // Nothing felt at all is no likeness either.
  if (m.true_lateral_rms_n > kJudgedN)
    m.lateral_correlation = felt_lateral2 > 0 ? both / std::sqrt(lateral2 * felt_lateral2) : 0;
}

/// felt(k) beside true(k − lag): the coefficient of correlation (not centred) over the rows that both have.
void judge_lag(const TouchTrace& trace, double lag_max_s, FeltMetrics& m) {
  const auto n = static_cast<std::ptrdiff_t>(trace.rows.size());
  const auto reach = std::min(static_cast<std::ptrdiff_t>(ticks(trace, lag_max_s)), n / 2);
  const auto at_row = [&](std::ptrdiff_t i) -> const Row& { return trace.rows[static_cast<std::size_t>(i)]; };
  std::vector<double> felt2(trace.rows.size() + 1, 0), true2(felt2);  // sums of squares before each row
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    felt2[i + 1] = felt2[i] + trace.rows[i].felt_h_n.squaredNorm();
    true2[i + 1] = true2[i] + trace.rows[i].true_h_n.squaredNorm();
  }
  const auto between = [](const std::vector<double>& sum, std::ptrdiff_t from, std::ptrdiff_t to) {
    return sum[static_cast<std::size_t>(to)] - sum[static_cast<std::size_t>(from)];
  };
  // No further ahead than this: nobody feels what has not happened, and a prediction is not that bad.
  const std::ptrdiff_t ahead = std::min(reach, static_cast<std::ptrdiff_t>(ticks(trace, 0.02)));
  const std::vector<double> products = lagged_products(trace, ahead, reach);
  double best = 0;
  std::ptrdiff_t at = 0;
  for (std::ptrdiff_t lag = -ahead; lag <= reach; ++lag) {
    const double both = products[static_cast<std::size_t>(lag + ahead)];
    const std::ptrdiff_t from = std::max<std::ptrdiff_t>(0, lag), to = std::min(n, n + lag);
    const double norm = std::sqrt(between(felt2, from, to) * between(true2, from - lag, to - lag));
    if (norm > 0 && both / norm > best) {
      best = both / norm;
      at = lag;
    }
  }
  if (!(best > 0)) return;
  m.lag_ms = 1e3 * trace.period_s * static_cast<double>(at);
  double error2 = 0, moved_true2 = 0;
  for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, at); k < std::min(n, n + at); ++k) {
    const Row &felt = at_row(k), &earlier = at_row(k - at);
    if (!earlier.touches && felt.felt_h_n.norm() <= kJudgedN) continue;
    error2 += (felt.felt_h_n - earlier.true_h_n).squaredNorm();
    moved_true2 += earlier.true_h_n.squaredNorm();
  }
  m.nrmse_at_lag = ratio(error2, moved_true2);
}

struct Event {
  double true_n = 0;
  double error = FeltMetrics::kNone;
};

/// The greatest attraction in the span, true and felt; no event where there is less than is judged.
Event attraction(const TouchTrace& trace, const Span& span) {
  double most_true_n = 0, most_felt_n = 0;
  for (std::size_t i = span.from; i < span.to; ++i) {
    most_true_n = std::max(most_true_n, -trace.rows[i].true_h_n.z());
    most_felt_n = std::max(most_felt_n, -trace.rows[i].felt_h_n.z());
  }
  Event event;
  event.true_n = most_true_n;
  if (most_true_n > kJudgedN) event.error = most_felt_n / most_true_n - 1;
  return event;
}

double peak_error(const TouchTrace& trace, std::size_t at) {
  const std::size_t reach = ticks(trace, FeltMetrics::kEventS);
  double most_n = 0;
  for (std::size_t i = at > reach ? at - reach : 0; i < std::min(trace.rows.size(), at + reach); ++i)
    most_n = std::max(most_n, (trace.rows[i].felt_h_n - trace.rows[i].true_h_n).norm());
  return most_n;
}

void keep_worst(const Event& event, double& true_n, double& error) {
  if (!std::isfinite(event.error)) return;
  if (std::isfinite(error) && std::fabs(event.error) <= std::fabs(error)) return;
  true_n = event.true_n;
  error = event.error;
}

void keep_larger(double value, double& most) {
  if (!(most >= value)) most = value;
}

void judge_between(const TouchTrace& trace, const std::vector<Span>& all, FeltMetrics& m) {
  const std::size_t event = ticks(trace, FeltMetrics::kEventS);
  const auto near = [event](std::size_t i, std::size_t at) { return i + event >= at && i < at + event; };
  double error2 = 0, true2 = 0;
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    const Row& row = trace.rows[i];
    if (!in_window(row)) continue;
    if (std::any_of(all.begin(), all.end(), [&](const Span& s) { return near(i, s.from) || near(i, s.to); }))
      continue;
    error2 += (row.felt_h_n - row.true_h_n).squaredNorm();
    true2 += row.true_h_n.squaredNorm();
  }
  m.nrmse_between = ratio(error2, true2);
}

void judge_contacts(const TouchTrace& trace, FeltMetrics& m) {
  const std::vector<Span> all = contacts(trace);
  m.contacts = static_cast<int>(all.size());
  judge_between(trace, all, m);
  const std::size_t after = ticks(trace, FeltMetrics::kAfterS), event = ticks(trace, FeltMetrics::kEventS);
  const std::size_t release = ticks(trace, FeltMetrics::kReleaseS);
  for (std::size_t c = 0; c < all.size(); ++c) {
    const Span& span = all[c];
    const std::size_t begin = c > 0 ? all[c - 1].to : 0;
    const std::size_t end = c + 1 < all.size() ? all[c + 1].from : trace.rows.size();
    const std::size_t middle = span.from + (span.to - span.from) / 2;
    const std::size_t first = std::max(begin, span.from > event ? span.from - event : 0);
    keep_worst(attraction(trace, {first, std::min(middle, span.from + after)}), m.snap_in_true_n,
               m.snap_in_error);
    // A contact that lasts to the end of the rows is never let go.
    if (span.to < trace.rows.size())
      keep_worst(attraction(trace, {middle, std::min(end, span.to + after)}), m.pull_off_true_n,
                 m.pull_off_error);
    keep_larger(peak_error(trace, span.from), m.snap_in_peak_n);
    keep_larger(peak_error(trace, span.to), m.pull_off_peak_n);

    bool was_felt = false;
    std::size_t nothing = 0;
    for (std::size_t i = span.from; i < span.to; ++i) {
      const double felt_n = trace.rows[i].felt_h_n.norm(), true_n = trace.rows[i].true_h_n.norm();
      was_felt = was_felt || felt_n > 0.25 * m.true_rms_n;
      const bool lost = was_felt && felt_n < 0.02 * m.true_rms_n && true_n > 0.25 * m.true_rms_n;
      nothing = lost ? nothing + 1 : 0;
      if (nothing == release) {
        ++m.false_releases;
        was_felt = false;  // once for each time that it had been felt
      }
    }
  }
}

}  // namespace

FeltMetrics measure(const TouchTrace& trace, double lag_max_s) {
  FeltMetrics m;
  judge_whole(trace, m);
  judge_lag(trace, lag_max_s, m);
  judge_contacts(trace, m);
  for (std::size_t i = 1; i < trace.rows.size(); ++i) {
    const Vec3 moved_m = trace.rows[i].hand_pos_h_m - trace.rows[i - 1].hand_pos_h_m;
    m.work_true_mj -= 1e3 * trace.rows[i - 1].true_h_n.dot(moved_m);
    m.work_felt_mj -= 1e3 * trace.rows[i - 1].felt_h_n.dot(moved_m);
  }
  return m;
}

}  // namespace telenano::studies::fidelity

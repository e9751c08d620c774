#include "tests/studies/bench/paced_load.h"

#include <algorithm>

#include "tests/studies/bench/result_rows.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

double us(std::int64_t ns) noexcept {
  return 1e-3 * static_cast<double>(ns);
}

}  // namespace

PacedRecord::PacedRecord(const PacedOptions& options) : times_(options, 1, 0) {
  p99_of_seconds_us_.reserve(static_cast<std::size_t>(options.seconds) + 2);
}

void PacedRecord::begin(const PacedTimes& times) noexcept {
  times_ = times;
  second_ends_ns_ = times.start_ns() + kSecondNs;
}

void PacedRecord::sent(std::size_t commands, std::int64_t late_ns) noexcept {
  commands_ += commands;
  late_.add(late_ns);
}

void PacedRecord::end_second() noexcept {
  if (p99_of_seconds_us_.size() < p99_of_seconds_us_.capacity())
    p99_of_seconds_us_.push_back(us(of_this_second_.percentile_ns(0.99)));
  of_this_second_ = {};
  second_ends_ns_ += kSecondNs;
}

void PacedRecord::answered(std::size_t group, std::int64_t sent_ns, std::int64_t came_ns) noexcept {
  if (sent_ns < times_.start_ns()) return;
  service_.add(came_ns - sent_ns);
  since_due_.add(came_ns - times_.due_of_ns(sent_ns, group));
  while (came_ns >= second_ends_ns_) end_second();
  of_this_second_.add(came_ns - sent_ns);
}

PacedResult PacedRecord::result(std::int64_t end_ns, std::int64_t server_cpu_ns) const {
  const auto duration_ns = static_cast<double>(end_ns - times_.start_ns());
  PacedResult r;
  r.commands = commands_;
  r.left_out = left_out_;
  r.replies = service_.count();
  r.p50_us = us(service_.percentile_ns(0.5));
  r.p99_us = us(service_.percentile_ns(0.99));
  r.p999_us = us(service_.percentile_ns(0.999));
  r.max_us = us(service_.max_ns());
  r.since_due_p99_us = us(since_due_.percentile_ns(0.99));
  r.late_p99_us = us(late_.percentile_ns(0.99));
  r.sent_rate_hz = 1e9 * static_cast<double>(commands_) / duration_ns;
  r.server_share = static_cast<double>(server_cpu_ns) / duration_ns;
  // Of a run shorter than a second, that is the second.
  std::vector<double> seconds = p99_of_seconds_us_;
  if (seconds.empty()) seconds.push_back(us(of_this_second_.percentile_ns(0.99)));
  r.seconds = seconds.size();
  r.seconds_that_hold = static_cast<std::size_t>(
      std::count_if(seconds.begin(), seconds.end(), [](double p99) { return p99 < kServiceTargetUs; }));
  r.median_second_p99_us = median(seconds);
  return r;
}

}  // namespace telenano::studies

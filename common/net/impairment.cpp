#include "telenano/common/net/impairment.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/common/base/det_math.h"

namespace telenano::net {

Impairment::Impairment(ImpairmentConfig settings, std::uint64_t seed)
    : config(std::move(settings)), random_(seed), outage_random_(~seed) {}

Fate Impairment::send(std::size_t size, std::int64_t now_ns, std::size_t room) noexcept {
  Fate fate;
  ++counts.sent;
  const auto lose = [this](std::uint64_t& cause) {
    ++counts.lost;
    ++cause;
  };
  if (config.down || in_outage(now_ns)) {
    lose(counts.lost_outage);
    return fate;
  }
  const TraceRow* const row = trace_row(now_ns);
  if (row != nullptr && row->lost) {
    lose(counts.lost_trace);
    return fate;
  }
  if (lost_by_chance(now_ns)) {
    lose(counts.lost_chance);
    return fate;
  }
  const std::int64_t trace_delay_ns = row != nullptr ? row->delay_ns : 0;
  add_copy(fate, size, now_ns, trace_delay_ns, room);
  if (config.duplicate > 0 && random_.chance(config.duplicate)) {
    ++counts.duplicated;
    add_copy(fate, size, now_ns, trace_delay_ns, room);
  }
  return fate;
}

bool Impairment::lost_by_chance(std::int64_t now_ns) noexcept {
  if (config.loss <= 0) return false;
  if (config.burst_ns > 0) {
    // Gilbert–Elliott in time: a Markov chain of two states with mean stays burst = b and b (1 - p) / p, so
    // that the share of the bad one is p. Its correlation decays at the rate 1/b + p / (b (1 - p)) =
    // 1 / (b (1 - p)); after a time dt the state is bad with probability p + (bad ? 1 - p : -p) exp(-rate
    // dt).
    if (config.loss >= 1) return true;
    const double rate_per_ns = 1.0 / (static_cast<double>(config.burst_ns) * (1.0 - config.loss));
    const double memory =
        state_at_ns_ < 0 ? 0.0 : det_exp(-rate_per_ns * static_cast<double>(now_ns - state_at_ns_));
    state_at_ns_ = now_ns;
    bad_ = random_.chance(config.loss + (bad_ ? 1.0 - config.loss : -config.loss) * memory);
    return bad_;
  }
  if (config.burst_datagrams <= 1) return random_.chance(config.loss);
  // Gilbert–Elliott with loss 1 in the bad state: mean stay there = burst, share of time there = loss.
  const double leave = 1.0 / config.burst_datagrams;
  const double enter = config.loss >= 1 ? 1.0 : leave * config.loss / (1.0 - config.loss);
  bad_ = bad_ ? !(config.loss < 1 && random_.chance(leave)) : random_.chance(enter);
  return bad_;
}

bool Impairment::in_outage(std::int64_t now_ns) noexcept {
  for (const Outage& outage : config.outages) {
    if (now_ns >= outage.start_ns && now_ns - outage.start_ns < outage.length_ns) return true;
  }
  if (config.outage_gap_ns <= 0) return false;
  const auto draw_after = [this](std::int64_t end_ns) {
    next_outage_.start_ns = end_ns + static_cast<std::int64_t>(static_cast<double>(config.outage_gap_ns) *
                                                               outage_random_.exponential());
    next_outage_.length_ns = static_cast<std::int64_t>(static_cast<double>(config.outage_length_ns) *
                                                       outage_random_.exponential());
  };
  if (!next_outage_known_) draw_after(0);
  next_outage_known_ = true;
  while (now_ns >= next_outage_.start_ns + next_outage_.length_ns)
    draw_after(next_outage_.start_ns + next_outage_.length_ns);
  return now_ns >= next_outage_.start_ns;
}

const TraceRow* Impairment::trace_row(std::int64_t now_ns) const noexcept {
  const auto& trace = config.trace;
  if (trace.empty()) return nullptr;
  if (trace.size() == 1) return &trace.front();
  const std::int64_t last_ns = trace.back().time_ns;
  const std::int64_t period_ns = last_ns + (last_ns - trace[trace.size() - 2].time_ns);
  const auto after =
      std::upper_bound(trace.begin(), trace.end(), now_ns % period_ns,
                       [](std::int64_t time_ns, const TraceRow& row) { return time_ns < row.time_ns; });
  return after == trace.begin() ? &trace.front() : &*(after - 1);
}

std::int64_t Impairment::jitter_ns() noexcept {
  if (config.jitter_ns <= 0) return 0;
  const auto scale = static_cast<double>(config.jitter_ns);
  switch (config.jitter) {
    case ImpairmentConfig::Jitter::kUniform:
      return static_cast<std::int64_t>(scale * random_.uniform());
    case ImpairmentConfig::Jitter::kHalfNormal:
      return static_cast<std::int64_t>(scale * std::fabs(random_.normal()));
    case ImpairmentConfig::Jitter::kExponential:
      return static_cast<std::int64_t>(scale * random_.exponential());
  }
  return 0;
}

std::int64_t Impairment::leaves_ns(std::size_t size, std::int64_t now_ns) noexcept {
  if (config.rate_bit_s <= 0) return now_ns;
  // What still waits is what the link sends until it is free. That time is kept in fractions of nanoseconds,
  // so that the rate is right however short a datagram; in an hour they are right to 0.5 ps.
  const double ns_per_byte = 8e9 / config.rate_bit_s;
  const auto bytes = static_cast<double>(size + kHeaderBytes);
  const auto now = static_cast<double>(now_ns);
  const double begin_ns = std::max(now, link_free_ns_);
  const double waiting_bytes = (begin_ns - now) / ns_per_byte;
  // A hundredth of a byte for the rounding: whole bytes that just fit must fit.
  if (waiting_bytes + bytes > static_cast<double>(config.queue_bytes) + 0.01) return -1;
  link_free_ns_ = begin_ns + bytes * ns_per_byte;
  return static_cast<std::int64_t>(std::ceil(link_free_ns_));
}

void Impairment::add_copy(Fate& fate, std::size_t size, std::int64_t now_ns, std::int64_t trace_delay_ns,
                          std::size_t& room) noexcept {
  if (room == 0) {
    ++counts.lost;
    ++counts.lost_room;
    return;
  }
  const std::int64_t leaves = leaves_ns(size, now_ns);
  if (leaves < 0) {
    ++counts.lost;
    ++counts.lost_rate;
    return;
  }
  --room;
  std::int64_t delay_ns = config.delay_ns + trace_delay_ns;
  if (config.drift_ppm != 0) {
    delay_ns += std::llround(config.drift_ppm * 1e-6 * static_cast<double>(now_ns));
    delay_ns = std::max<std::int64_t>(delay_ns, 0);
  }
  Fate::Copy& copy = fate.copies[fate.n++];
  copy.size = size;
  copy.arrival_ns = leaves + delay_ns + jitter_ns();
  if (config.reorder > 0 && random_.chance(config.reorder)) {
    ++counts.reordered;
    copy.arrival_ns += config.reorder_ns;
  } else if (config.in_order) {
    copy.arrival_ns = last_in_order_ns_ = std::max(copy.arrival_ns, last_in_order_ns_);
  }
  if (config.truncate > 0 && size > 0 && random_.chance(config.truncate)) {
    ++counts.truncated;
    copy.size = random_.below(size);
  }
  if (config.corrupt > 0 && copy.size > 0 && random_.chance(config.corrupt)) {
    ++counts.corrupted;
    copy.corrupted = true;
    copy.byte = random_.below(copy.size);
    copy.mask = static_cast<std::uint8_t>(1u << random_.below(8));
  }
}

}  // namespace telenano::net

#include "telenano/common/link/rate_control.h"

#include <algorithm>
#include <cmath>

namespace telenano::link {
namespace {

constexpr std::int64_t kWindowNs = 50'000'000;     // of the least round trip: longer than a stall of 20 ms
constexpr std::size_t kWindowLeast = 3;            // replies in it, at a low rate over a longer time
constexpr std::int64_t kBlockNs = 10'000'000'000;  // of the base: one to two of these
constexpr double kTargetNs = 4e6;                  // and the time between two datagrams, and jitter
constexpr double kJitters = 3;
constexpr double kJitterMostNs = 12e6;
constexpr double kJitterMostReorderedNs = 60e6;
constexpr double kReorders = 0.02;             // of the replies late: no queue does that
constexpr double kJitterMostWithBulkNs = 4e6;  // pieces between two replies look like jitter
constexpr double kDoubleLeastNs = 20e6;        // of the start
constexpr double kDrainNs = 100e6;             // β = 1 − q/this
constexpr double kBetaLeast = 0.5;
constexpr double kBetaMost = 0.85;
constexpr double kDeliveredWindowNs = 200e6;
constexpr double kRiseHzS = 40;         // a second,
constexpr double kCalmS = 1.5;          // and after so long without a queue
constexpr double kFasterHzS2 = 120;     // so much more each second
constexpr double kLossByChance = 0.19;  // 10 % each way: 1 − 0.9²
// Of three replies in 20 ms all are then lost once in five hours (50 · 0.01³ a second); of two, at a low rate, every
// few minutes, and the force begins to fade.
constexpr double kLossForDeadband = 0.01;
constexpr std::int64_t kProbeNs = 10'000'000'000;
constexpr std::int64_t kLossWindowNs = 500'000'000;
constexpr std::uint64_t kLossLeast = 40;            // commands: 10 % of them are four
constexpr std::int64_t kSilenceNs = 200'000'000;    // as the session's own
constexpr std::int64_t kNotOursNs = 1'500'000'000;  // a queue that does not drain at the least rate
constexpr double kOursFalls = 0.05;                 // of the time: one that drains falls faster
constexpr double kStepsOfADatagram = 50;            // new ones; some are repeated
constexpr double kCreditMost = 2;
constexpr double kBulkFirst = 0.2;  // pieces for each datagram
constexpr double kBulkLast = 2;
constexpr double kBulkLeast = 0.5;  // after a queue
constexpr double kBulkBeta = 0.7;
constexpr double kBulkDoubleS = 0.08;  // longer than the window in which a queue is seen
constexpr double kBulkRise = 0.1;      // a second, after a queue
constexpr std::int64_t kBulkOverNs = 1'000'000'000;

}  // namespace

const char* name(RateReason reason) noexcept {
  switch (reason) {
    case RateReason::kFull:
      return "nothing limits it";
    case RateReason::kStart:
      return "the link is not known yet";
    case RateReason::kQueue:
      return "a queue on the way";
    case RateReason::kLoss:
      return "losses";
    case RateReason::kSilence:
      return "nothing comes back";
    case RateReason::kRising:
      return "rising again";
    case RateReason::kFixed:
      return "as told";
  }
  return "?";
}

RateControl::RateControl(const RateControlConfig& config) noexcept : config_(config) {
  config_.least_hz = std::min(config_.least_hz, config_.full_hz);
  config_.start_hz = std::clamp(config_.start_hz, config_.least_hz, config_.full_hz);
  lowest_hz_ = config_.full_hz;
  reset();
}

void RateControl::reset() noexcept {
  rate_hz_ = config_.adapts ? config_.start_hz : config_.full_hz;
  starts_ = config_.adapts;
  reason_ = config_.adapts ? RateReason::kStart : RateReason::kFixed;
  jitter_ns_ = 0;
  late_share_ = 0;
  held_down_ = false;
  credit_ = 1;
  last_income_ = 0;
  bulk_of_a_datagram_ = kBulkFirst;
  bulk_begins_ = true;
  bulk_ns_ = kNeverNs;
  count_ = 0;
  base_now_ns_ = base_last_ns_ = kUnknown;
  queue_ns_ = 0;
  rests_ = false;
  at_least_ns_ = -1;
  first_ = newest_ = {};
  arrived_ = exchanges_ = 0;
  loss_ = 0;
  spares_replies_ = false;
  waits_since_ns_ = -1;
}

double RateControl::base_ns() const noexcept {
  const std::int64_t base = std::min(base_now_ns_, base_last_ns_);
  return base == kUnknown ? 0 : static_cast<double>(base);
}

double RateControl::least_hz() const noexcept {
  if (!carries_steps_) return config_.least_hz;
  return std::min(std::max(config_.least_with_steps_hz, config_.full_hz / kStepsOfADatagram),
                  config_.least_hz);
}

void RateControl::carry_steps(bool steps) noexcept {
  carries_steps_ = steps;
  rate_hz_ = std::max(rate_hz_, least_hz());
}

/// 0 at the full rate, 1 at the least.
double RateControl::down() const noexcept {
  if (config_.full_hz <= least_hz()) return 0;
  return std::clamp((config_.full_hz - rate_hz_) / (config_.full_hz - least_hz()), 0.0, 1.0);
}

double RateControl::deadband_factor() const noexcept {
  return 1 + (config_.deadband_most - 1) * down();
}

double RateControl::reply_deadband_share() const noexcept {
  return spares_replies_ && loss_ <= kLossForDeadband ? spared_share_ : 0;
}

void RateControl::note_base(std::int64_t now_ns, std::int64_t rtt_ns) noexcept {
  if (base_now_ns_ == kUnknown && base_last_ns_ == kUnknown) block_ns_ = now_ns;
  if (now_ns - block_ns_ > kBlockNs) {
    base_last_ns_ = base_now_ns_;
    base_now_ns_ = kUnknown;
    block_ns_ = now_ns;
  }
  base_now_ns_ = std::min(base_now_ns_, rtt_ns);
}

void RateControl::on_reply(std::int64_t now_ns, std::int64_t rtt_ns, const ReplyNumbers& reply) noexcept {
  news_ns_ = now_ns;
  waits_since_ns_ = -1;
  late_share_ -= late_share_ / kLateReplies;
  // Another session counts from 1 again.
  const bool another = newest_.command == 0 || reply.command < newest_.command;
  exchanges_ += another || reply.left_out <= newest_.left_out ? 1 : 1 + reply.left_out - newest_.left_out;
  if (rtt_ns >= 0) {
    note_base(now_ns, rtt_ns);
    if (count_ > 0) {
      const auto change_ns = static_cast<double>(rtt_ns - sample_[(count_ - 1) % kSamples].rtt_ns);
      jitter_ns_ +=
          (std::abs(change_ns) - jitter_ns_) / static_cast<double>(std::min<std::size_t>(count_, 16));
    }
    sample_[count_++ % kSamples] = {now_ns, rtt_ns, exchanges_};
  }
  newest_ = reply;
  if (another || reply.sequence < first_.sequence || reply.left_out < first_.left_out) {
    first_ = reply;
    arrived_ = 0;
    loss_since_ns_ = now_ns;
    return;
  }
  arrived_ = std::min(arrived_ + 1, newest_.sequence - first_.sequence);
}

bool RateControl::reorders() const noexcept {
  return late_share_ > kReorders;
}

double RateControl::jitter_most_ns(std::int64_t now_ns) const noexcept {
  if (reorders()) return kJitterMostReorderedNs;
  return fetches(now_ns) ? kJitterMostWithBulkNs : kJitterMostNs;
}

/// Is the least round trip of the window above the base by more than the target? Sets queue_ns_.
bool RateControl::standing(std::int64_t now_ns) noexcept {
  const std::size_t kept = std::min(count_, kSamples);
  std::int64_t least = kUnknown;
  std::size_t seen = 0;
  for (std::size_t i = 0; i < kept; ++i) {
    const Sample& s = sample_[(count_ - 1 - i) % kSamples];
    if (seen >= kWindowLeast && now_ns - s.time_ns > kWindowNs) break;
    least = std::min(least, s.rtt_ns);
    ++seen;
  }
  // A window that has not been filled yet says nothing: a session's first exchanges are slow ones.
  if (seen < kWindowLeast || now_ns - sample_[(count_ - seen) % kSamples].time_ns < kWindowNs / 2) {
    return false;
  }
  queue_ns_ = std::max(0.0, static_cast<double>(least) - base_ns());
  return queue_ns_ > kTargetNs + 1e9 / rate_hz_ + std::min(jitter_most_ns(now_ns), kJitters * jitter_ns_);
}

double RateControl::delivered_hz(std::int64_t now_ns) const noexcept {
  const std::size_t kept = std::min(count_, kSamples);
  std::size_t n = 0;
  Sample oldest{now_ns, 0, exchanges_};
  for (; n < kept; ++n) {
    const Sample& s = sample_[(count_ - 1 - n) % kSamples];
    if (n >= 4 && static_cast<double>(now_ns - s.time_ns) > kDeliveredWindowNs) break;
    oldest = s;
  }
  if (n < 4 || now_ns <= oldest.time_ns) return rate_hz_;
  const std::uint64_t exchanges = sample_[(count_ - 1) % kSamples].exchanges - oldest.exchanges;
  return static_cast<double>(exchanges) * 1e9 / static_cast<double>(now_ns - oldest.time_ns);
}

/// How long until a new rate shows in the replies: a round trip with its queue, and the window.
std::int64_t RateControl::settle_ns() const noexcept {
  const double window_ns = std::max(static_cast<double>(kWindowNs), kWindowLeast * 1e9 / rate_hz_);
  return static_cast<std::int64_t>(base_ns() + 2 * queue_ns_ + window_ns);
}

void RateControl::lower(std::int64_t now_ns, double rate_hz, RateReason reason) noexcept {
  rate_hz_ = std::clamp(rate_hz, least_hz(), rate_hz_);
  reason_ = reason;
  lowest_hz_ = std::min(lowest_hz_, rate_hz_);
  ++lowered_;
  rests_ = true;
  starts_ = bulk_begins_ = false;
  lowered_ns_ = calm_ns_ = now_ns;
  held_down_ = true;
  arrived_ = 0;
  first_ = newest_;
  loss_since_ns_ = now_ns;
}

/// Of the commands so many were accepted, and of their replies that were sent so many came. On a path that reorders what was
/// not accepted may have been overtaken.
void RateControl::look_for_loss(std::int64_t now_ns) noexcept {
  const std::uint64_t asked = newest_.command - first_.command;
  const std::uint64_t sent = newest_.sequence - first_.sequence;
  if (now_ns - loss_since_ns_ < kLossWindowNs || asked < kLossLeast || sent == 0) return;
  const double accepted = static_cast<double>(std::min(newest_.accepted() - first_.accepted(), asked));
  const double back = static_cast<double>(arrived_) / static_cast<double>(sent);
  const double there = reorders() ? std::max(back, accepted / static_cast<double>(asked))
                                  : accepted / static_cast<double>(asked);
  const double loss = 1 - there * back;
  loss_ = loss;
  first_ = newest_;
  arrived_ = 0;
  loss_since_ns_ = now_ns;
  if (loss > kLossByChance) lower(now_ns, rate_hz_ * (1 - 0.5 * loss), RateReason::kLoss);
}

void RateControl::rise(std::int64_t now_ns, double dt_s) noexcept {
  if (rate_hz_ >= config_.full_hz) {
    reason_ = RateReason::kFull;
    held_down_ = starts_ = spares_replies_ = false;
    return;
  }
  if (spares_replies_ && now_ns - calm_ns_ > kProbeNs) {
    spares_replies_ = false;
    calm_ns_ = now_ns;  // slowly at first
  }
  const bool left_out = newest_.left_out > left_out_before_;
  if (spares_replies_ && left_out && rate_hz_ >= roof_hz_) {
    reason_ = RateReason::kQueue;
    return;
  }
  if (starts_) {
    const double doublings = 1e9 * dt_s / std::max(kDoubleLeastNs, base_ns());
    rate_hz_ = std::min(config_.full_hz, rate_hz_ * (1 + 0.7 * std::min(doublings, 1.0)));
    return;
  }
  const double calm_s = 1e-9 * static_cast<double>(now_ns - calm_ns_);
  const double slope = kRiseHzS + kFasterHzS2 * std::max(0.0, calm_s - kCalmS);
  // A piece takes twice the bytes of a reply: with bulk, a slower rise is as many bytes.
  const double bytes = fetches(now_ns) ? 1 + 2 * bulk_of_a_datagram_ : 1;
  rate_hz_ = std::min(config_.full_hz, rate_hz_ + slope / bytes * dt_s);
  if (calm_s > 1) reason_ = RateReason::kRising;
}

/// Has a piece been asked for of late?
bool RateControl::fetches(std::int64_t now_ns) const noexcept {
  return bulk_ns_ != kNeverNs && now_ns - bulk_ns_ <= kBulkOverNs;
}

void RateControl::bulk_sent(std::int64_t now_ns) noexcept {
  if (!fetches(now_ns)) {
    bulk_of_a_datagram_ = kBulkFirst;
    bulk_begins_ = true;
  }
  bulk_ns_ = now_ns;
}

/// True while it has to.
bool RateControl::bulk_gives_way(std::int64_t now_ns) noexcept {
  if (queue_ns_ <= kTargetNs + 1e9 / rate_hz_) return false;
  bulk_begins_ = false;
  if (now_ns - bulk_lowered_ns_ <= settle_ns()) return true;
  bulk_lowered_ns_ = now_ns;
  if (bulk_of_a_datagram_ > kBulkLeast)
    bulk_of_a_datagram_ = std::max(kBulkLeast, kBulkBeta * bulk_of_a_datagram_);
  return true;
}

/// Only while pieces are asked for: what was not tried says nothing of the link.
void RateControl::rise_bulk(std::int64_t now_ns, double dt_s) noexcept {
  if (!fetches(now_ns)) return;
  const double more =
      bulk_begins_ ? bulk_of_a_datagram_ * (std::exp2(dt_s / kBulkDoubleS) - 1) : kBulkRise * dt_s;
  bulk_of_a_datagram_ = std::min(kBulkLast, bulk_of_a_datagram_ + more);
}

/// Is the queue another's, or a longer way? One of ours falls at the least rate, once the round trips of
/// before are over.
void RateControl::watch_the_least(std::int64_t now_ns) noexcept {
  const auto since_ns = static_cast<double>(now_ns - at_least_ns_);
  const bool falls = queue_ns_ < least_queue_ns_ - 1e6 - kOursFalls * since_ns;
  if (rate_hz_ > least_hz() || at_least_ns_ < 0 || falls || queue_ns_ > 1.1 * least_queue_ns_) {
    at_least_ns_ = now_ns;
    least_queue_ns_ = queue_ns_;
    return;
  }
  if (since_ns < kNotOursNs + 2 * (base_ns() + queue_ns_)) return;
  base_now_ns_ = static_cast<std::int64_t>(base_ns() + queue_ns_);
  base_last_ns_ = kUnknown;
  block_ns_ = now_ns;
  at_least_ns_ = -1;
}

void RateControl::update(std::int64_t now_ns) noexcept {
  const double dt_s =
      ticked_ ? 1e-9 * static_cast<double>(std::max<std::int64_t>(0, now_ns - ticked_ns_)) : 0;
  ticked_ = true;
  ticked_ns_ = now_ns;
  if (config_.adapts) {
    const std::int64_t silence_ns =
        kSilenceNs + static_cast<std::int64_t>(2 * base_ns() + 2 * queue_ns_ + 4e9 / rate_hz_);
    if (waits_since_ns_ >= 0 && now_ns - waits_since_ns_ > silence_ns) {
      waits_since_ns_ = now_ns;
      lower(now_ns, 0.5 * rate_hz_, RateReason::kSilence);
    } else if (count_ > 0) {
      const bool stands = standing(now_ns);
      const bool gives_way = bulk_gives_way(now_ns);
      if (rests_ && now_ns - lowered_ns_ > settle_ns()) rests_ = false;
      if (stands) {
        calm_ns_ = now_ns;
        bulk_begins_ = false;
        if (!rests_) {
          const double beta = std::clamp(1 - queue_ns_ / kDrainNs, kBetaLeast, kBetaMost);
          // Of what was overtaken nothing tells that it was carried.
          roof_hz_ = reorders() ? rate_hz_ : std::min(rate_hz_, delivered_hz(now_ns));
          lower(now_ns, beta * roof_hz_, RateReason::kQueue);
          spares_replies_ = true;
          spared_share_ = down();
          left_out_before_ = newest_.left_out;
        }
        watch_the_least(now_ns);
      } else {
        at_least_ns_ = -1;
        look_for_loss(now_ns);
        // While nothing comes back there is no sign that there is room.
        const bool waits = (waits_since_ns_ >= 0 && now_ns - waits_since_ns_ > silence_ns / 2) ||
                           (reason_ == RateReason::kSilence && news_ns_ < lowered_ns_);
        if (!rests_ && !waits) {
          rise(now_ns, dt_s);
          if (!gives_way) rise_bulk(now_ns, dt_s);
        }
      }
    }
  }
  // No burst after a pause: what was not sent then is in the next datagram anyway.
  last_income_ = std::min(1.0, rate_hz_ * dt_s);
  credit_ = std::min(credit_ + rate_hz_ * dt_s, kCreditMost);
}

void RateControl::sent(std::int64_t now_ns) noexcept {
  credit_ = std::max(credit_ - 1, -8.0);
  if (waits_since_ns_ < 0) waits_since_ns_ = now_ns;
}

}  // namespace telenano::link

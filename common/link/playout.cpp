#include "telenano/common/link/playout.h"

#include <algorithm>

namespace telenano::link {
namespace {

std::size_t room(const PlayoutConfig& config) {
  if (config.mode == PlayoutConfig::Mode::kNewest) return 1;
  const std::int64_t longest_ns = config.mode == PlayoutConfig::Mode::kAdaptive
                                      ? std::max(config.delay_ns, config.delay_max_ns)
                                      : config.delay_ns;
  return static_cast<std::size_t>(1e-9 * static_cast<double>(longest_ns) * config.rate_hz) + 64;
}

}  // namespace

Playout::Playout(const PlayoutConfig& config)
    : config_(config),
      ring_(room(config)),
      delay_ns_(static_cast<double>(config.delay_ns)),
      target_ns_(delay_ns_) {}

void Playout::clear() noexcept {
  first_ = count_ = 0;
  last_played_ = newest_ = 0;
  newest_faults_ = newest_hold_ = 0;
  urgent_ = false;
}

bool Playout::is_due(const Reply& reply, std::int64_t now_ns) const noexcept {
  // The echoed time is the session's own, checked there; differences are defined modulo 2^64 all the same.
  const auto since_ns =
      static_cast<std::int64_t>(static_cast<std::uint64_t>(now_ns) - reply.command_send_time_ns);
  return since_ns >= static_cast<std::int64_t>(delay_ns_);
}

void Playout::push(const Reply& reply) noexcept {
  if (reply.sequence > newest_) {
    newest_ = reply.sequence;
    newest_faults_ = reply.fault_bits;
    const bool changes_hands = reply.tip.hold != newest_hold_;
    newest_hold_ = reply.tip.hold;
    if ((reply.fault_bits & kUrgentFaults) != 0 || changes_hands) {
      first_ = count_ = 0;
      shown_ = reply;
      urgent_ = true;
      return;
    }
  }
  // The tick that should have shown it has passed, or has shown a newer one.
  if (reply.sequence <= last_played_ || (urgent_ && reply.sequence < shown_.sequence) ||
      (looked_ && is_due(reply, last_look_ns_))) {
    ++counts_.late;
    return;
  }
  if (count_ == ring_.size()) {
    first_ = (first_ + 1) % ring_.size();
    --count_;
    ++counts_.overrun;
  }
  std::size_t i = count_++;
  for (; i > 0 && at(i - 1).sequence > reply.sequence; --i) at(i) = at(i - 1);
  at(i) = reply;
}

void Playout::set_link(double srtt_ns, double rttvar_ns) noexcept {
  if (config_.mode != PlayoutConfig::Mode::kAdaptive) return;
  target_ns_ = std::min(srtt_ns + config_.jitter_factor * rttvar_ns + 1e9 / config_.rate_hz,
                        static_cast<double>(config_.delay_max_ns));
}

const Reply* Playout::due(std::int64_t now_ns) noexcept {
  if (looked_) {
    const double elapsed_ns = static_cast<double>(std::max<std::int64_t>(now_ns - last_look_ns_, 0));
    delay_ns_ = std::clamp(target_ns_, delay_ns_ - config_.slew_down * elapsed_ns,
                           delay_ns_ + config_.slew_up * elapsed_ns);
  }
  looked_ = true;
  last_look_ns_ = now_ns;
  if (urgent_) {
    urgent_ = false;
    last_played_ = shown_.sequence;
    ++counts_.urgent;
    return &shown_;
  }
  bool any = false;
  while (count_ > 0 && is_due(at(0), now_ns)) {
    if (any) ++counts_.skipped;
    shown_ = at(0);
    first_ = (first_ + 1) % ring_.size();
    --count_;
    any = true;
  }
  if (!any) return nullptr;
  ++counts_.played;
  last_played_ = shown_.sequence;
  shown_.fault_bits |= newest_faults_;
  return &shown_;
}

}  // namespace telenano::link

#include "telenano/common/link/link_stats.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::link {
namespace {

/// Over a link whose delay is constant the spreads halve without end. Below the least normal number each sum with them
/// takes the processor a hundred cycles, and they never come to zero.
double settled(double spread_ns) noexcept {
  return spread_ns < std::numeric_limits<double>::min() ? 0 : spread_ns;
}

}  // namespace

bool LinkStats::on_reply(const Reply& reply, std::int64_t now_ns) noexcept {
  // The peer's clock has any origin and the fields come from the network: differences modulo 2^64 are well
  // defined.
  const auto minus = [](std::uint64_t a, std::uint64_t b) { return static_cast<std::int64_t>(a - b); };
  const auto t4 = static_cast<std::uint64_t>(now_ns);
  const std::int64_t total_ns = minus(t4, reply.command_send_time_ns);
  if (total_ns < 0 || reply.hold_time_ns > static_cast<std::uint64_t>(total_ns)) {
    ++rejected_;
    return false;
  }
  const std::int64_t rtt_ns = total_ns - static_cast<std::int64_t>(reply.hold_time_ns);
  const std::int64_t transit_ns = minus(t4, reply.server_time_ns);
  const auto r = static_cast<double>(rtt_ns);
  if (samples_ == 0) {
    srtt_ns_ = r;
    rttvar_ns_ = r / 2;
    rtt_min_ns_ = rtt_ns;
    block_start_ns_ = now_ns;
  } else {
    rttvar_ns_ = settled(rttvar_ns_ + (std::fabs(srtt_ns_ - r) - rttvar_ns_) / 4);
    srtt_ns_ += (r - srtt_ns_) / 8;
    const double d = static_cast<double>(
        minus(static_cast<std::uint64_t>(transit_ns), static_cast<std::uint64_t>(last_transit_ns_)));
    jitter_ns_ = settled(jitter_ns_ + (std::fabs(d) - jitter_ns_) / 16);
    if (rtt_ns < rtt_min_ns_) rtt_min_ns_ = rtt_ns;
  }
  last_transit_ns_ = transit_ns;
  rtt_last_ns_ = rtt_ns;
  ++samples_;

  if (now_ns - block_start_ns_ >= kBlockNs) {
    last_block_ = block_;
    block_ = {};
    block_start_ns_ = now_ns;
  }
  const std::int64_t up_ns = minus(reply.server_time_ns - reply.hold_time_ns, reply.command_send_time_ns);
  if (rtt_ns <= block_.rtt_ns) {
    block_ = {rtt_ns, 0.5 * (static_cast<double>(up_ns) - static_cast<double>(transit_ns)), now_ns};
  }
  drift_.add(now_ns, rtt_ns, up_ns, transit_ns);
  up_excess_ns_ = std::max(0.0, static_cast<double>(up_ns) - drift_.base_up_ns(now_ns));
  down_excess_ns_ = std::max(0.0, static_cast<double>(transit_ns) - drift_.base_down_ns(now_ns));
  down_delay_ns_ = std::clamp(static_cast<double>(transit_ns) + offset_ns(now_ns), 0.0, r);
  return true;
}

}  // namespace telenano::link

#include "common/link/link_stats.h"

#include <cmath>

namespace telenano::link {

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
    rttvar_ns_ += (std::fabs(srtt_ns_ - r) - rttvar_ns_) / 4;
    srtt_ns_ += (r - srtt_ns_) / 8;
    const double d = static_cast<double>(
        minus(static_cast<std::uint64_t>(transit_ns), static_cast<std::uint64_t>(last_transit_ns_)));
    jitter_ns_ += (std::fabs(d) - jitter_ns_) / 16;
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
  if (rtt_ns <= block_.rtt_ns) {
    const std::int64_t t2_minus_t1 =
        minus(reply.server_time_ns - reply.hold_time_ns, reply.command_send_time_ns);
    block_ = {rtt_ns, 0.5 * (static_cast<double>(t2_minus_t1) - static_cast<double>(transit_ns))};
  }
  return true;
}

}  // namespace telenano::link

#pragma once

#include <cstdint>

#include "telenano/common/link/clock_drift.h"
#include "telenano/common/link/messages.h"

namespace telenano::link {

/// What the station knows of the link, from the times that replies carry. Times in ns.
///
/// With T1 = command sent (station clock), T2 = command received, T3 = reply sent (server clock), T4 = reply
/// received:
///   round trip R = (T4 - T1) - (T3 - T2)                     the server's hold time taken out
///   smoothed   SRTT, RTTVAR by RFC 6298 (gains 1/8, 1/4)
///   jitter     J += (|D| - J)/16, D = (T4 - T4') - (T3 - T3')  RFC 3550, of the way back
///   offset     θ = ((T2 - T1) + (T3 - T4))/2, server clock minus station clock, as NTP: taken from the
///   sample with the
///              least R of the last 10 to 20 s, wrong by at most R/2 (all of R on one way).
///   drift      dθ/dt, and delays of each way above the least: clock_drift.h
class LinkStats {
 public:
  void reset() noexcept { *this = {}; }

  /// One accepted reply. False if its times are impossible (hold longer than the round trip); then nothing
  /// changes.
  bool on_reply(const Reply& reply, std::int64_t now_ns) noexcept;

  std::uint64_t samples() const noexcept { return samples_; }
  std::uint64_t rejected() const noexcept { return rejected_; }
  double rtt_ns() const noexcept { return srtt_ns_; }  ///< smoothed
  double rtt_var_ns() const noexcept { return rttvar_ns_; }
  std::int64_t rtt_last_ns() const noexcept { return rtt_last_ns_; }
  std::int64_t rtt_min_ns() const noexcept { return rtt_min_ns_; }  ///< since the start
  double jitter_ns() const noexcept { return jitter_ns_; }
  double offset_ns() const noexcept { return best().offset_ns; }
  double offset_error_ns() const noexcept { return 0.5 * static_cast<double>(best().rtt_ns); }
  /// The offset carried on to `now_ns` by the drift: the best sample may be 20 s old, 4 ms at 200 ppm.
  double offset_ns(std::int64_t now_ns) const noexcept {
    return best().offset_ns + 1e-6 * drift_.drift_ppm() * static_cast<double>(now_ns - best().time_ns);
  }
  /// Server's clock against the station's, parts per million; 0 until it is known (a second).
  double drift_ppm() const noexcept { return drift_.drift_ppm(); }
  double drift_error_ppm() const noexcept { return drift_.drift_error_ppm(); }
  /// How much longer than over the idle link the newest exchange was on its way, to the server and back.
  double up_excess_ns() const noexcept { return up_excess_ns_; }
  double down_excess_ns() const noexcept { return down_excess_ns_; }
  /// On the way back, by the offset: right within half of the least round trip; 0 … the last round trip.
  double down_delay_ns() const noexcept { return down_delay_ns_; }
  /// RFC 6298 without its 1 s floor: how long an answer may take before it is worth worrying.
  double timeout_ns() const noexcept { return srtt_ns_ + 4 * rttvar_ns_; }

 private:
  static constexpr std::int64_t kBlockNs = 10'000'000'000;

  struct OffsetSample {
    std::int64_t rtt_ns = INT64_MAX;
    double offset_ns = 0;
    std::int64_t time_ns = 0;
  };
  const OffsetSample& best() const noexcept {
    return block_.rtt_ns <= last_block_.rtt_ns ? block_ : last_block_;
  }

  std::uint64_t samples_ = 0;
  std::uint64_t rejected_ = 0;
  double srtt_ns_ = 0;
  double rttvar_ns_ = 0;
  double jitter_ns_ = 0;
  std::int64_t rtt_last_ns_ = 0;
  std::int64_t rtt_min_ns_ = 0;
  std::int64_t last_transit_ns_ = 0;  ///< T4 - T3 of the last reply
  std::int64_t block_start_ns_ = 0;
  OffsetSample block_;
  OffsetSample last_block_;
  ClockDrift drift_;
  double up_excess_ns_ = 0;
  double down_excess_ns_ = 0;
  double down_delay_ns_ = 0;
};

}  // namespace telenano::link

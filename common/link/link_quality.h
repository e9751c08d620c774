#pragma once

#include <cstdint>

namespace telenano::link {

/// What a station knows of its link at one moment, for people and programs that watch. Plain data. Counts are
/// those of all sessions of this ClientSession so far; times are of the present peer.
struct LinkQuality {
  double rtt_us = 0;  ///< smoothed, the server's hold time taken out
  double rtt_min_us = 0;
  double rtt_last_us = 0;
  double jitter_us = 0;  ///< of the way back, RFC 3550
  double offset_us = 0;  ///< server clock minus station clock, now
  double drift_ppm = 0;  ///< server clock against station clock
  double drift_error_ppm = 0;
  double up_excess_us = 0;    ///< newest exchange: above the least delay to the server
  double down_excess_us = 0;  ///< and back
  double force_age_ms = 0;    ///< since the slave measured the newest force; 0 before the first
  std::uint64_t commands_sent = 0;
  std::uint64_t commands_lost = 0;  ///< that the server had not accepted when it sent the newest reply
  std::uint64_t replies = 0;        ///< different ones that came
  std::uint64_t replies_lost = 0;
  std::uint64_t replies_left_out = 0;  ///< by the server, within the deadband: neither come nor lost
  std::uint64_t reordered = 0;
  std::uint64_t duplicates = 0;
  std::uint64_t dropped = 0;  ///< for any cause
};

/// Server's side of a session's link: what commands alone tell.
class PeerStats {
 public:
  void reset() noexcept { *this = {}; }

  /// An accepted command: its send time by the station's clock, when it came, the newest reply that it
  /// acknowledges.
  void on_command(std::uint64_t send_time_ns, std::int64_t now_ns, std::uint64_t newest_reply) noexcept {
    const std::uint64_t transit = static_cast<std::uint64_t>(now_ns) - send_time_ns;
    if (commands_++ > 0) {
      const double d = static_cast<double>(static_cast<std::int64_t>(transit - last_transit_));
      jitter_ns_ += ((d < 0 ? -d : d) - jitter_ns_) / 16;
    }
    last_transit_ = transit;
    if (waiting_for_ == 0 || newest_reply < waiting_for_) return;
    const auto rtt_ns = static_cast<double>(now_ns - sent_ns_);
    rtt_ns_ = rtt_ns_ == 0 ? rtt_ns : rtt_ns_ + (rtt_ns - rtt_ns_) / 8;
    waiting_for_ = 0;
  }
  void on_reply(std::uint64_t sequence, std::int64_t sent_ns) noexcept {
    if (waiting_for_ != 0) return;
    waiting_for_ = sequence;
    sent_ns_ = sent_ns;
  }

  double jitter_ns() const noexcept { return jitter_ns_; }  ///< of the way here, RFC 3550
  /// Smoothed, from a reply to the first command that acknowledges it: the wait for the station's next tick
  /// is in it. 0 = none yet.
  double rtt_ns() const noexcept { return rtt_ns_; }

 private:
  std::uint64_t commands_ = 0;
  std::uint64_t last_transit_ = 0;
  double jitter_ns_ = 0;
  std::uint64_t waiting_for_ = 0;
  std::int64_t sent_ns_ = 0;
  double rtt_ns_ = 0;
};

}  // namespace telenano::link

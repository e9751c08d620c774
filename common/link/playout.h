#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/link/messages.h"

namespace telenano::link {

struct PlayoutConfig {
  /// newest: each reply when it comes. constant: each reply delay_ns after its command was sent. adaptive:
  /// likewise, with a delay that follows the link slowly.
  enum class Mode : std::uint8_t { kNewest, kConstant, kAdaptive } mode = Mode::kNewest;
  std::int64_t delay_ns = 20'000'000;  ///< from command to reply; adaptive: where it begins
  std::int64_t delay_max_ns = 500'000'000;
  double rate_hz = 1000;  ///< of replies, for the room that is taken
  /// Adaptive: the delay goes to SRTT + jitter_factor·RTTVAR + a tick, by no more than this much of the time.
  double jitter_factor = 4;
  double slew_up = 0.2;
  double slew_down = 0.01;
};

/// What play-out did, since the start.
struct PlayoutCounts {
  std::uint64_t played = 0;
  std::uint64_t late = 0;     ///< came after their time, or after a newer one had been played: not used
  std::uint64_t skipped = 0;  ///< due in the same tick as a newer one
  std::uint64_t urgent = 0;   ///< that did not wait
  std::uint64_t overrun = 0;  ///< no room: the oldest was given up
};

/// A buffer that makes the delay which a controller sees constant: a reply is shown at the first tick that is
/// at least D after its command was sent, so D … D + one tick after it, however the link jitters. D counts
/// from the command's own send time, which the reply echoes: one clock, so nothing drifts.
///
/// In time is what has come when that tick looks; the rest is late, and is dropped as a stale one would be:
/// energies and waves are sums, the next reply has them. Replies that overtook one another are put in order.
/// What nobody may wait for does not: a reply with one of kUrgentFaults (zero force, retracting) discards
/// what waits and is shown in the next tick; the other fault bits of the newest reply are shown with whatever
/// is due. After the last reply of a link that has gone down, those that wait are still shown, as by a link
/// that much longer; the station's stale-force policy begins when there are no more.
///
/// Nothing allocates after construction.
class Playout {
 public:
  static constexpr std::uint32_t kUrgentFaults = kFaultNonFinite | kFaultRetracted;

  explicit Playout(const PlayoutConfig& config);

  bool active() const noexcept { return config_.mode != PlayoutConfig::Mode::kNewest; }
  /// Another session: what waits belongs to the old one.
  void clear() noexcept;

  /// A reply that the session accepted, or found stale (overtaken, not repeated).
  void push(const Reply& reply) noexcept;
  /// The link as it is now, for the adaptive delay. ns.
  void set_link(double srtt_ns, double rttvar_ns) noexcept;
  /// What this tick is to show; null: nothing new. Valid until the next call.
  const Reply* due(std::int64_t now_ns) noexcept;

  std::int64_t delay_ns() const noexcept { return static_cast<std::int64_t>(delay_ns_); }
  std::size_t waiting() const noexcept { return count_; }
  const PlayoutCounts& counts() const noexcept { return counts_; }

 private:
  Reply& at(std::size_t i) noexcept { return ring_[(first_ + i) % ring_.size()]; }
  bool is_due(const Reply& reply, std::int64_t now_ns) const noexcept;

  PlayoutConfig config_;
  std::vector<Reply> ring_;
  std::size_t first_ = 0;
  std::size_t count_ = 0;
  double delay_ns_ = 0;
  double target_ns_ = 0;
  bool looked_ = false;
  std::int64_t last_look_ns_ = 0;
  std::uint64_t last_played_ = 0;
  std::uint64_t newest_ = 0;
  std::uint32_t newest_faults_ = 0;
  std::uint32_t newest_hold_ = 0;  // of a shared tip: who loses it must not feel it a moment longer
  bool urgent_ = false;
  Reply shown_;
  PlayoutCounts counts_;
};

}  // namespace telenano::link

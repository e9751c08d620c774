#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace telenano::server {

/// A party that has not commanded for so long has no share.
inline constexpr std::int64_t kPartyActiveNs = 1'000'000'000;

/// Bounds the work (slave::SlaveOutput::work, a unit is about a microsecond) that sessions may have done for
/// them, so that one cannot take the server from the others. A count, not a time: the same commands at the
/// same times are given the same.
///
/// A session at `rate_hz` gets as many units a second as the greater of
///   alone_per_s where no other is active, else all_per_s / active sessions, and
///   min(motion_per_s + per_tick · rate_hz, session_per_s) + per_balance · SlaveLimits::balances_per_s.
/// So alone it may have the whole core, beside another a fifth, and among many what an ordinary hand
/// takes: 2 to 15 units a tick at rest in a contact, 20 to 150 where it pushes a particle or goes 10 µm/s
/// over a scan. A party (a key, or in the clear an IP address) has the same over the parties that are
/// active, in all. All numbers positive; the default bounds nothing.
struct WorkBounds {
  bool enforced = false;
  double alone_per_s = 1e6;
  /// Of one worker. More than half a core is left: for answers, for what is no work, for slower machines.
  double all_per_s = 4e5;
  double motion_per_s = 40'000;
  double per_tick = 30;
  double session_per_s = 150'000;
  double per_balance = 20;
  /// What a datagram takes up to here is not counted for its party: sessions that stand still do not wait for
  /// their key's others.
  double free_a_datagram = 10;
  double a_datagram = 500;  ///< at most, and one balance more: half a millisecond that the others wait
  double a_stop = 50;       ///< that a stop may always take
  double saved_s = 0.005;   ///< of work may be saved up, and no less than two datagrams' most

  double of_session(double rate_hz, double balances_per_s, std::size_t active) const noexcept {
    const double ordinary =
        std::min(motion_per_s + per_tick * rate_hz, session_per_s) + per_balance * balances_per_s;
    return std::max(of_party(active), ordinary);
  }
  double of_party(std::size_t active) const noexcept {
    return active <= 1 ? alone_per_s : all_per_s / static_cast<double>(active);
  }
};

/// What is left of a bound now. What a step took beyond is owed, and waited for.
class WorkBudget {
 public:
  /// What is left, where `per_s` has come in since the last look.
  double left(std::int64_t now_ns, double per_s, const WorkBounds& bounds) noexcept {
    const double most = std::max(2 * bounds.a_datagram, bounds.saved_s * per_s);
    if (!filled_) {
      left_ = most;
    } else if (now_ns > filled_ns_) {
      left_ = std::min(most, left_ + 1e-9 * per_s * static_cast<double>(now_ns - filled_ns_));
    }
    filled_ns_ = filled_ ? std::max(filled_ns_, now_ns) : now_ns;
    filled_ = true;
    return left_;
  }
  void take(double work) noexcept { left_ -= work; }

 private:
  bool filled_ = false;
  double left_ = 0;
  std::int64_t filled_ns_ = 0;
};

}  // namespace telenano::server

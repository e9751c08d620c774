#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/net/rights.h"

namespace telenano::server {

/// Who moves the one tip that all sessions share. One session at most holds it; the others observe.
///
/// The tip goes to a session with the right to operate
///   - that begins (its first command without kFlagHandOver), while nobody holds the tip;
///   - that asks (kFlagTakeOver is set), as soon as nobody holds it, or its holder has not
///     engaged for kReleasedNs; with the right to administer at once, from anybody. What has brought the tip
///     once must be clear before it asks again: two that ask do not take it from each other for ever.
/// A session holds it until another one gets it, it hands over (kFlagHandOver), may no longer operate, falls
/// silent or ends. A tip that was left (not handed over) is withdrawn before it is free again; only who
/// administers may have it before.
///
/// Pure; slots are those of the session table.
class TipHolder {
 public:
  static constexpr std::size_t kNobody = SIZE_MAX;
  static constexpr std::int64_t kReleasedNs = 2'000'000'000;

  explicit TipHolder(std::size_t slots) : claims_(slots) {}

  void begin_session(std::size_t slot) noexcept { claims_[slot] = {}; }
  /// Goes on under a new id: may have a free tip back without asking, but what it had asked for stays used
  /// up.
  void resume_session(std::size_t slot) noexcept { claims_[slot].begins = true; }
  /// An accepted command of `slot`. True if it brings the tip to this session: a new holding begins.
  bool on_command(std::size_t slot, net::Rights rights, std::uint32_t flags, std::int64_t now_ns) noexcept;
  /// A session is silent, ended or forgotten.
  void leave(std::size_t slot, std::int64_t now_ns) noexcept;

  std::size_t holder() const noexcept { return holder_; }
  bool holds(std::size_t slot) const noexcept { return holder_ == slot; }
  /// Of the present or last holding, from 1: the wire's tip_hold.
  std::uint32_t number() const noexcept { return number_; }
  /// The same holder's, but a new holding: the slave has moved the tip away by itself and brought it back,
  /// and what the holder's commands were anchored to is gone.
  void renew() noexcept {
    if (holder_ != kNobody && ++number_ == 0) number_ = 1;
  }

  /// Must the tip be withdrawn now? While nobody holds it: after its holder has left, or when it was handed
  /// over to nobody for `unattended_ns`; until withdrawn().
  bool must_withdraw(std::int64_t now_ns, std::int64_t unattended_ns) noexcept;
  void withdrawn() noexcept;

 private:
  struct Claim {
    bool begins = true;    // no command yet that wanted the tip, and found it free or held
    bool granted = false;  // its kFlagTakeOver has brought it the tip, and was not clear since
  };

  void release(std::int64_t now_ns) noexcept;

  std::vector<Claim> claims_;
  std::size_t holder_ = kNobody;
  std::uint32_t number_ = 0;
  std::int64_t engaged_ns_ = 0;  // the holder's last command that moved the tip, or its first
  std::int64_t free_since_ns_ = 0;
  bool withdrawing_ = false;
  bool withdrawn_ = true;  // since it was held last
};

}  // namespace telenano::server

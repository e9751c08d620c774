#include "telenano/nve_server/server/tip_holder.h"

#include "telenano/common/link/messages.h"

namespace telenano::server {

bool TipHolder::on_command(std::size_t slot, net::Rights rights, std::uint32_t flags,
                           std::int64_t now_ns) noexcept {
  Claim& claim = claims_[slot];
  const bool takes = (flags & link::kFlagTakeOver) != 0;
  const bool operates = rights >= net::Rights::kOperate && (flags & link::kFlagHandOver) == 0;
  if (!takes) claim.granted = false;
  if (holder_ == slot) {
    constexpr std::uint32_t kEngaged = link::kFlagClutch | link::kFlagDeadman;
    claim.granted = takes;
    if (!operates) {
      release(now_ns);
    } else if ((flags & kEngaged) == kEngaged) {
      engaged_ns_ = now_ns;
    }
    return false;
  }
  const bool begins = claim.begins, asks = takes && !claim.granted;
  if (!operates || !(asks || begins)) return false;
  if (!withdrawing_) claim.begins = false;  // who comes while the tip is on its way up waits
  const bool free = holder_ == kNobody && !withdrawing_;
  const bool released = holder_ != kNobody && now_ns - engaged_ns_ > kReleasedNs;
  const bool by_right = rights == net::Rights::kAdminister || released;
  if (!free && !(asks && by_right)) return false;
  claim = {false, takes};
  holder_ = slot;
  if (++number_ == 0) number_ = 1;
  engaged_ns_ = now_ns;
  withdrawing_ = withdrawn_ = false;
  return true;
}

void TipHolder::leave(std::size_t slot, std::int64_t now_ns) noexcept {
  if (holder_ != slot) return;
  release(now_ns);
  withdrawing_ = true;
}

void TipHolder::release(std::int64_t now_ns) noexcept {
  holder_ = kNobody;
  free_since_ns_ = now_ns;
}

bool TipHolder::must_withdraw(std::int64_t now_ns, std::int64_t unattended_ns) noexcept {
  if (holder_ != kNobody || withdrawn_) return false;
  if (now_ns - free_since_ns_ > unattended_ns) withdrawing_ = true;
  return withdrawing_;
}

void TipHolder::withdrawn() noexcept {
  withdrawing_ = false;
  withdrawn_ = true;
}

}  // namespace telenano::server

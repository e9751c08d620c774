#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>

#include "telenano/common/rt/latest_value.h"
#include "telenano/common/surface/height_view.h"

namespace telenano::web {

/// What a browser sees of one tip. Frame W, z up.
struct TipView {
  std::array<double, 3> tip_pos_w_nm{};
  std::array<double, 3> force_w_nn{};  ///< on the tip
  std::uint32_t contact_state = 0;     ///< link::ContactState
  std::uint32_t fault_bits = 0;
  bool moved = false;  ///< by whom the slot has now: false hides what the last one left
};

/// One wait-free slot for each tip, written by the thread that moves it and read by the web thread. Tips
/// beyond kSlots are not seen. No name, key or address is in it.
class TipSlots {
 public:
  static constexpr std::size_t kSlots = 64;
  struct Slot {
    std::atomic<bool> taken{false};
    rt::LatestValue<TipView> value;

    /// What this tip's sample looks like; null: no marks stay in it. Held for a moment, when a slot is taken.
    void set_heights(std::shared_ptr<const surface::HeightView> heights) {
      const std::lock_guard lock(mutex_);
      heights_ = std::move(heights);
    }
    std::shared_ptr<const surface::HeightView> heights() const {
      const std::lock_guard lock(mutex_);
      return heights_;
    }

   private:
    mutable std::mutex mutex_;
    std::shared_ptr<const surface::HeightView> heights_;
  };

  /// Any thread; null when all are taken.
  Slot* take() noexcept {
    for (Slot& slot : slots_) {
      bool expected = false;
      if (slot.taken.compare_exchange_strong(expected, true, std::memory_order_acq_rel)) return &slot;
    }
    return nullptr;
  }
  const std::array<Slot, kSlots>& slots() const noexcept { return slots_; }

 private:
  std::array<Slot, kSlots> slots_;
};

}  // namespace telenano::web

#include "telenano/common/net/delay_line.h"

#include <algorithm>
#include <cstring>

namespace telenano::net {

DelayLine::DelayLine(std::size_t capacity, std::size_t slot_bytes)
    : slot_bytes_(slot_bytes),
      // Not cleared: thousands of short sessions each have one, and touch little of it.
      bytes_(std::make_unique_for_overwrite<std::uint8_t[]>(capacity * slot_bytes)),
      slots_(capacity),
      queue_(capacity) {
  free_.reserve(capacity);
  for (std::size_t i = capacity; i-- > 0;) free_.push_back(i);
  heap_.reserve(capacity);
}

void DelayLine::put(std::span<const std::uint8_t> bytes, const Fate::Copy& copy, std::uint64_t tag) noexcept {
  const std::size_t index = free_.back();
  free_.pop_back();
  slots_[index] = {copy.size, tag};
  std::uint8_t* const at = bytes_.get() + index * slot_bytes_;
  const std::size_t kept = std::min({copy.size, bytes.size(), slot_bytes_});
  if (kept > 0) std::memcpy(at, bytes.data(), kept);
  if (copy.corrupted && copy.byte < kept) at[copy.byte] ^= copy.mask;
  const Arrival arrival{copy.arrival_ns, order_++, index};
  if (waiting_ == 0 || arrival.arrival_ns >= queue_[wrapped(front_ + waiting_ - 1)].arrival_ns) {
    queue_[wrapped(front_ + waiting_++)] = arrival;
    return;
  }
  heap_.push_back(arrival);
  std::push_heap(heap_.begin(), heap_.end(), later);
}

DelayLine::Item DelayLine::front() const noexcept {
  const Arrival& next = first();
  const Slot& slot = slots_[next.slot];
  return {next.arrival_ns,
          slot.size,
          slot.tag,
          {bytes_.get() + next.slot * slot_bytes_, std::min(slot.size, slot_bytes_)}};
}

void DelayLine::pop() noexcept {
  if (queue_is_next()) {
    free_.push_back(queue_[front_].slot);
    front_ = wrapped(front_ + 1);
    --waiting_;
    return;
  }
  std::pop_heap(heap_.begin(), heap_.end(), later);
  free_.push_back(heap_.back().slot);
  heap_.pop_back();
}

}  // namespace telenano::net

#include "common/net/delay_line.h"

#include <algorithm>
#include <cstring>

namespace telenano::net {

DelayLine::DelayLine(std::size_t capacity, std::size_t slot_bytes)
    : slot_bytes_(slot_bytes),
      // Not cleared: thousands of short sessions each have one, and touch little of it.
      bytes_(std::make_unique_for_overwrite<std::uint8_t[]>(capacity * slot_bytes)),
      slots_(capacity) {
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
  heap_.push_back({copy.arrival_ns, order_++, index});
  std::push_heap(heap_.begin(), heap_.end(), later);
}

DelayLine::Item DelayLine::front() const noexcept {
  const Arrival& first = heap_.front();
  const Slot& slot = slots_[first.slot];
  return {first.arrival_ns,
          slot.size,
          slot.tag,
          {bytes_.get() + first.slot * slot_bytes_, std::min(slot.size, slot_bytes_)}};
}

void DelayLine::pop() noexcept {
  std::pop_heap(heap_.begin(), heap_.end(), later);
  free_.push_back(heap_.back().slot);
  heap_.pop_back();
}

}  // namespace telenano::net

#pragma once

#include <algorithm>
#include <array>

#include "telenano/common/net/datagram.h"

namespace telenano::security {

/// A slot for each datagram on its way, without the heap: what a test of allocations and a benchmark need.
class MemoryWire final : public net::Datagram {
 public:
  explicit MemoryWire(const net::Address& address) : address_(address) {}
  void join(MemoryWire& other) { other_ = &other; }
  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address&) noexcept override {
    other_->size_ = std::min(bytes.size(), other_->bytes_.size());
    std::copy_n(bytes.begin(), other_->size_, other_->bytes_.begin());
    return net::SendStatus::kSent;
  }
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override {
    if (size_ == 0) return false;
    std::copy_n(bytes_.begin(), std::min(size_, buffer.size()), buffer.begin());
    received.size = size_;
    received.from = other_->address_;
    size_ = 0;
    return true;
  }
  void spoil() noexcept { bytes_[40] ^= 1; }
  const net::Address& address() const { return address_; }

 private:
  net::Address address_;
  MemoryWire* other_ = nullptr;
  std::size_t size_ = 0;
  std::array<std::uint8_t, 2048> bytes_{};
};

}  // namespace telenano::security

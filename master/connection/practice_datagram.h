#pragma once

#include <cstdint>
#include <vector>

#include "telenano/common/link/practice_link.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/net/delay_line.h"
#include "telenano/common/net/impairment.h"

namespace telenano::connection {

/// Datagrams over a worse link than `inner`. What is on its way moves on with each call, so a caller that
/// sends, receives or flushes every millisecond has delays to a millisecond. Everything is allocated at
/// construction (13 MB); one thread.
class PracticeDatagram final : public net::Datagram {
 public:
  using Clock = std::int64_t (*)() noexcept;  ///< ns of the monotonic clock
  PracticeDatagram(net::Datagram& inner, Clock clock, const link::PracticeLink& link, std::uint64_t seed = 1);

  /// From now on; what is on its way arrives as it was to.
  void set(const link::PracticeLink& link) noexcept;
  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override;
  void flush() noexcept override;

 private:
  static constexpr std::size_t kCapacity = 4096;
  static constexpr std::size_t kSlotBytes = 1600;  // beyond an Ethernet frame nothing is sent

  std::int64_t now_ns() const noexcept { return clock_() - began_ns_; }
  void move_on(std::int64_t now_ns) noexcept;

  net::Datagram& inner_;
  Clock clock_;
  std::int64_t began_ns_;
  net::Impairment up_;
  net::Impairment down_;
  net::DelayLine going_;
  net::DelayLine coming_;
  net::Address to_;  // a station has one server at a time; what is on its way goes there
  std::vector<net::Received> coming_from_;
  std::uint64_t came_ = 0;
  std::int64_t came_ns_ = 0;  // when the newest did
  std::vector<std::uint8_t> buffer_;
};

}  // namespace telenano::connection

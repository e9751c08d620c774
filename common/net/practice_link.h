#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "telenano/common/net/datagram.h"
#include "telenano/common/net/delay_line.h"
#include "telenano/common/net/impairment.h"

namespace telenano::net {

/// A worse link than there is, to practise on: what is added to each round trip, in both directions alike.
struct PracticeLink {
  double rtt_ms = 0;     ///< added to the round trip, 0 to 2000
  double jitter_ms = 0;  ///< of each way besides: half-normal, in order; 0 to 500
  double loss = 0;       ///< of each way, independent; 0 to 0.5
  bool any() const noexcept { return rtt_ms > 0 || jitter_ms > 0 || loss > 0; }
};

inline constexpr double kPracticeRttMost_ms = 2000;
inline constexpr double kPracticeJitterMost_ms = 500;
inline constexpr double kPracticeLossMost = 0.5;

/// "rtt=100,jitter=5,loss=2" (ms, ms, percent), each optional; "0" or "off": nothing is added yet. Throws
/// UserError naming `flag`.
PracticeLink parse_practice_link(const std::string& text, const std::string& flag);
/// "+100 ms, 2 % lost": for a person; empty when nothing is added.
std::string practice_text(const PracticeLink& link);

/// Datagrams over a worse link than `inner`. What is on its way moves on with each call, so a caller that
/// sends, receives or flushes every millisecond has delays to a millisecond. Everything is allocated at
/// construction (13 MB); one thread.
class PracticeDatagram final : public Datagram {
 public:
  using Clock = std::int64_t (*)() noexcept;  ///< ns of the monotonic clock
  PracticeDatagram(Datagram& inner, Clock clock, const PracticeLink& link, std::uint64_t seed = 1);

  /// From now on; what is on its way arrives as it was to.
  void set(const PracticeLink& link) noexcept;
  SendStatus send(std::span<const std::uint8_t> bytes, const Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, Received& received) noexcept override;
  void flush() noexcept override;

 private:
  static constexpr std::size_t kCapacity = 4096;
  static constexpr std::size_t kSlotBytes = 1600;  // beyond an Ethernet frame nothing is sent
  static ImpairmentConfig impairment_of(const PracticeLink& link);

  std::int64_t now_ns() const noexcept { return clock_() - began_ns_; }
  void move_on(std::int64_t now_ns) noexcept;

  Datagram& inner_;
  Clock clock_;
  std::int64_t began_ns_;
  Impairment up_;
  Impairment down_;
  DelayLine going_;
  DelayLine coming_;
  Address to_;  // a station has one server at a time; what is on its way goes there
  std::vector<Received> coming_from_;
  std::uint64_t came_ = 0;
  std::int64_t came_ns_ = 0;  // when the newest did
  std::vector<std::uint8_t> buffer_;
};

}  // namespace telenano::net

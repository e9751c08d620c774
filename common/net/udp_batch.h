#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "telenano/common/net/datagram.h"
#include "telenano/common/net/udp.h"

namespace telenano::net {

/// Many datagrams a system call (recvmmsg, sendmmsg), behind the same seam as one: receive() gives out what
/// one call has fetched, send() keeps the answers until all of it is given out or `batch` are kept. So the
/// answers to what came together leave together, before anything else is fetched; flush() sends them at once.
///
/// A call that brought fewer than it had room for has emptied the socket: the next receive() says so without
/// asking the kernel. A short wait() is a receive that waits. So an exchange that comes alone costs one
/// receive and one send; where all have come alone for a while, a wait asks for one only, except each
/// sixteenth, which sees whether that is still so.
///
/// Allocates at construction only. One thread.
class UdpBatch final : public Datagram {
 public:
  /// Longer datagrams are received cut (Received::size tells) and sent by a call of their own.
  static constexpr std::size_t kSlotBytes = 2048;

  /// `socket` must outlive it, and be used through it only. `batch`: 1 … 1024.
  explicit UdpBatch(Udp& socket, std::size_t batch = 32);
  ~UdpBatch() override;  ///< sends what is kept
  UdpBatch(const UdpBatch&) = delete;
  UdpBatch& operator=(const UdpBatch&) = delete;

  /// kSent: kept, or handed over. What the kernel then refuses is lost, as a network may lose it, and
  /// counted.
  SendStatus send(std::span<const std::uint8_t> bytes, const Address& to) noexcept override;
  /// `age_ns` is that at the moment of the fetch; 0 on a socket without arrival times.
  bool receive(std::span<std::uint8_t> buffer, Received& received) noexcept override;
  void flush() noexcept override;
  /// Sleeps until a datagram is there (true), or about the time has passed or a signal has come (false). Up
  /// to kShortWaitNs it fetches what it has waited for, and may be some milliseconds late with nothing: the
  /// kernel counts this time in ticks.
  bool wait(std::int64_t timeout_ns) noexcept;
  static constexpr std::int64_t kShortWaitNs = 2'000'000;

  struct Counters {
    std::uint64_t receive_calls = 0;  ///< of the kernel
    std::uint64_t send_calls = 0;
    std::uint64_t received = 0;  ///< datagrams
    std::uint64_t sent = 0;
    std::uint64_t not_sent = 0;  ///< refused by the kernel: a full queue, no route, a filter
  };
  const Counters& counters() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::net

#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace telenano::studies {

/// The floors: plain system calls on loopback sockets, and nothing of the product.
class RawUdp {
 public:
  RawUdp();  ///< bound to 127.0.0.1, any port. Throws RunError.
  ~RawUdp();
  RawUdp(const RawUdp&) = delete;
  RawUdp& operator=(const RawUdp&) = delete;
  int handle() const noexcept { return handle_; }
  std::uint16_t port() const noexcept { return port_; }
  void connect_to(std::uint16_t port) const;  ///< on loopback. Throws RunError.
  /// Receives and sends wait, at most 50 ms; or never.
  void blocking(bool yes) const;

 private:
  int handle_ = -1;
  std::uint16_t port_ = 0;
};

/// Answers each datagram with `reply_bytes`, one call each way; the socket's own blocking or not.
void echo_one_by_one(const RawUdp& socket, std::size_t reply_bytes, const std::atomic<bool>& stop);

/// The same by recvmmsg and sendmmsg, 32 at a time, `work_ns` of spinning for each; waits by ppoll when there
/// is nothing. `answered` is what it has sent.
void echo_batched(const RawUdp& socket, std::size_t reply_bytes, std::int64_t work_ns,
                  const std::atomic<bool>& stop, std::atomic<std::uint64_t>& answered);

}  // namespace telenano::studies

#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "telenano/common/net/datagram.h"

namespace telenano::net {

/// A TCP connection that never waits. Small segments leave at once (no Nagle).
class TcpStream {
 public:
  enum class Status : std::uint8_t {
    kOk,
    kWouldBlock,
    kClosed,  ///< by the other end, or broken: nothing more comes
  };

  TcpStream() noexcept;  ///< closed
  TcpStream(TcpStream&&) noexcept;
  TcpStream& operator=(TcpStream&&) noexcept;
  ~TcpStream();

  /// Begins to connect; poll connecting() until it is over. Closed if that is refused at once.
  static TcpStream begin_connect(const Address& peer);
  /// Connects within the time; throws RunError with one line that says why not.
  static TcpStream connect(const Address& peer, std::int64_t timeout_ns);

  bool open() const noexcept;
  /// True while a begun connection is neither there nor refused; where it was refused, open() is false after.
  bool connecting() noexcept;
  Status read(std::span<std::uint8_t> buffer, std::size_t& n) noexcept;
  Status write(std::span<const std::uint8_t> bytes, std::size_t& n) noexcept;
  void close() noexcept;
  void reset() noexcept;        ///< close so that the other end sees a reset
  int handle() const noexcept;  ///< the file descriptor, −1 when closed

 private:
  struct Impl;
  explicit TcpStream(std::unique_ptr<Impl> impl) noexcept;
  friend class TcpListener;
  std::unique_ptr<Impl> impl_;
};

class TcpListener {
 public:
  /// Throws UserError if the port is taken or the address is not this machine's.
  explicit TcpListener(const Address& local);
  TcpListener(TcpListener&&) noexcept;
  TcpListener& operator=(TcpListener&&) noexcept;
  ~TcpListener();

  TcpStream accept() noexcept;  ///< closed when nobody waits
  Address local() const noexcept;
  int handle() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::net

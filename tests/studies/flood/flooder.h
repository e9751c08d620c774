#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/net/udp.h"

namespace telenano::studies {

/// What a hostile machine sends: random bytes, truncated and forged datagrams, Hellos with wrong cookies,
/// Byes for sessions that it guesses, and replays of what it has overheard; from several sockets of its own,
/// at a steady rate.
class Flooder {
 public:
  Flooder(const net::Address& to, double rate_per_s, std::uint64_t seed);
  ~Flooder();  ///< stops
  Flooder(const Flooder&) = delete;
  Flooder& operator=(const Flooder&) = delete;

  /// A datagram of the station's, to be replayed. From one thread; takes no longer than a copy.
  void overhear(std::span<const std::uint8_t> datagram) noexcept;

  std::uint64_t sent() const noexcept { return sent_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t kSockets = 4;
  static constexpr std::size_t kPool = 4096;  ///< datagrams made beforehand
  static constexpr std::size_t kBatch = 32;
  struct Bytes {
    std::array<std::uint8_t, link::kMaxDatagramBytes + 64> data{};
    std::size_t size = 0;
  };

  void fill_pool();
  void run();

  net::Address to_;
  double rate_per_s_;
  Random random_;
  std::vector<net::Udp> sockets_;
  std::vector<Bytes> pool_;
  std::mutex overheard_mutex_;
  Bytes overheard_;
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace telenano::studies

#pragma once

#include <poll.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "telenano/common/net/delay_line.h"
#include "telenano/common/net/impairment.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/clock.h"
#include "telenano/common/rt/log_histogram.h"

namespace telenano::studies {

struct RelayConfig {
  net::Address listen;  ///< where clients send to
  net::Address to;      ///< the server
  net::ImpairmentConfig to_server;
  net::ImpairmentConfig to_client;
  std::uint64_t seed = 1;
  std::size_t max_clients = 64;           ///< more are refused
  std::int64_t idle_ns = 60'000'000'000;  ///< a client unheard of for so long gives its place up
  std::size_t capacity = 16384;           ///< datagrams on their way, each direction
  /// Sees every datagram that comes, before its fate is known; `up`: from a client. None: nobody looks.
  std::function<void(std::span<const std::uint8_t> bytes, bool up)> tap;
};

/// Stands between clients and one server: what a client sends arrives at the server from a socket of its
/// own, as behind a NAT, and the answers go back. Each direction is one link that all clients share. After
/// construction it allocates for a new client only, never for a datagram. One thread.
class Relay {
 public:
  struct Direction {
    Direction(const net::ImpairmentConfig& config, std::uint64_t seed, std::size_t capacity)
        : impairment(config, seed), line(capacity, kDatagramBytes) {}
    net::Impairment impairment;  ///< its counts: `delivered` is what was handed to the kernel
    net::DelayLine line;
    std::int64_t last_sent_ns = 0;
    std::uint64_t too_long = 0;  ///< above kDatagramBytes: dropped on arrival, not counted as sent
    std::uint64_t not_sent = 0;  ///< due, but the kernel refused it or its client was gone
    rt::LogHistogram late;       ///< how much later than due it was sent
  };
  struct Clients {
    std::size_t now = 0;
    std::uint64_t seen = 0;
    std::uint64_t idled = 0;
    std::uint64_t refused = 0;  ///< datagrams of clients that found no place
  };
  /// Longer than any Ethernet carries in one piece.
  static constexpr std::size_t kDatagramBytes = 2048;

  /// Throws UserError if it cannot listen there. `clock` outlives the relay.
  Relay(const RelayConfig& config, const rt::Clock& clock);

  /// Waits until a datagram comes or is due, or `wait_ns` is over, or a signal came; then takes what came and
  /// sends what is due.
  void step(std::int64_t wait_ns) noexcept;

  net::Address local() const noexcept { return listen_.local(); }
  std::int64_t now_ns() const noexcept { return clock_.now_ns() - start_ns_; }
  const Direction& to_server() const noexcept { return to_server_; }
  const Direction& to_client() const noexcept { return to_client_; }
  const Clients& clients() const noexcept { return counts_; }

 private:
  struct Client {
    std::optional<net::Udp> socket;  // none: a free place
    net::Address address;
    std::int64_t heard_ns = 0;
    std::uint32_t generation = 0;  // tells this client's datagrams from those of the place's last one
  };

  void take_from_clients() noexcept;
  void take_from_server(std::size_t index) noexcept;
  void put(Direction& direction, const net::Received& received, std::size_t index) noexcept;
  void send_due(Direction& direction) noexcept;
  std::size_t place_of(const net::Address& address) noexcept;  // clients_.size(): none
  void reap() noexcept;

  RelayConfig config_;
  const rt::Clock& clock_;
  std::int64_t start_ns_;
  net::Udp listen_;
  std::vector<Client> clients_;
  std::vector<pollfd> waiting_;  // of the listening socket, then of each place
  Direction to_server_;
  Direction to_client_;
  Clients counts_;
  std::int64_t next_reap_ns_ = 0;
  std::size_t last_place_ = 0;
  std::array<std::uint8_t, kDatagramBytes> buffer_{};
};

}  // namespace telenano::studies

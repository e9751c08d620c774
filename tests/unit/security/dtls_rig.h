#pragma once

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "telenano/common/rt/clock.h"
#include "telenano/common/security/dtls_client.h"
#include "telenano/common/security/dtls_server.h"
#include "tests/unit/security/datagram_pipe.h"

namespace telenano::security {

inline Psk psk_of(std::uint8_t fill) {
  Psk psk;
  psk.bytes.fill(fill);
  return psk;
}

inline KeyList two_keys() {
  KeyList list;
  list.keys.push_back({"omega-1", psk_of(1), net::Rights::kOperate});
  list.keys.push_back({"guest", psk_of(2), net::Rights::kObserve});
  return list;
}

inline std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

/// A server and a station in memory. Time stands still unless moved, but for OpenSSL's repetitions, which go
/// by the wall clock (the first after 200 ms).
struct DtlsRig {
  rt::VirtualClock clock;
  DatagramNet network;
  DatagramNet::End server_end{network, DatagramNet::address(1, 5100)};
  DatagramNet::End station_end{network, DatagramNet::address(2, 40000)};
  std::unique_ptr<DtlsServer> server;
  std::unique_ptr<DtlsClient> station;
  net::Received received;
  std::array<std::uint8_t, 513> buffer{};
  net::Received station_received;
  std::array<std::uint8_t, 513> station_buffer{};

  /// `work`: what the server measures its handshakes by; left out: by the clock, so by nothing.
  explicit DtlsRig(KeyList keys = two_keys(), DtlsServerConfig config = {}, const rt::Clock* work = nullptr) {
    clock.advance_to(1'000'000'000);
    server = std::make_unique<DtlsServer>(config, std::move(keys), server_end, clock,
                                          work != nullptr ? work : &clock);
  }
  void connect(const std::string& identity = "omega-1", std::uint8_t fill = 1) {
    DtlsClientConfig config;
    config.key = StationKey{identity, psk_of(fill)};
    connect(config);
  }
  /// A station that an address is known by: another one makes it begin anew.
  void connect_without_id(const std::string& identity = "omega-1", std::uint8_t fill = 1) {
    DtlsClientConfig config;
    config.key = StationKey{identity, psk_of(fill)};
    config.connection_id = false;
    connect(config);
  }
  void connect(const DtlsClientConfig& config) {
    station = std::make_unique<DtlsClient>(config, station_end, server_end.address(), clock);
  }
  /// Both ends look at what has come, one after the other. True if the server has something to read.
  bool turn() {
    const bool got = server->receive(buffer, received);
    if (station) station->receive(station_buffer, station_received);
    return got;
  }
  void turns(int n) {
    for (int i = 0; i < n; ++i) turn();
  }
  void pass_ms(std::int64_t ms) { clock.advance_to(clock.now_ns() + ms * 1'000'000); }
  std::uint64_t events(SecurityEvent event) const { return server->counters()[event]; }
  /// The station says something, the server hears it?
  bool hears(std::string_view text) {
    station->send(bytes_of(text), server_end.address());
    return server->receive(buffer, received) && received.size == text.size() &&
           std::memcmp(buffer.data(), text.data(), text.size()) == 0;
  }
};

}  // namespace telenano::security

// Thousands of sessions of one server.
#include <gtest/gtest.h>

#include <vector>

#include "spring_slave.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

using link::ClientState;

net::Address address_of(std::uint16_t port) {
  net::Address address;
  address.ip[15] = 1;
  address.port = port;
  return address;
}

link::ClientConfig client_config(std::uint64_t seed) {
  link::ClientConfig config;
  config.nonce_seed = seed;
  return config;
}

TEST(LargeTable, FindsEverySessionAmongThousands) {
  ServerConfig config = test_config();
  config.table.capacity = 2000;
  config.openings_per_s = 1e6;
  Server server(config, spring_scene());
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
  std::int64_t now_ns = 1'000'000'000;
  std::vector<std::unique_ptr<link::ClientSession>> stations;
  net::Standing proven;
  proven.address_proven = true;
  const auto at = [](std::size_t k) { return address_of(static_cast<std::uint16_t>(1000 + k)); };
  for (std::size_t k = 0; k < 2000; ++k) {
    stations.push_back(std::make_unique<link::ClientSession>(client_config(k + 1)));
    stations.back()->start(now_ns);
    const std::size_t n = stations.back()->poll(now_ns, in);
    const std::size_t m = server.on_datagram({in.data(), n}, at(k), now_ns, out, nullptr, proven);
    stations.back()->on_datagram({out.data(), m}, now_ns);
    ASSERT_EQ(stations.back()->state(), ClientState::kEstablished) << k;
  }
  EXPECT_EQ(server.sessions().active(), 2000u);
  for (std::size_t k = 0; k < 2000; ++k) {
    link::Command command = VirtualSession::engaged();
    command.tip_pos_w_nm.z() = -1 - 0.001 * static_cast<double>(k);
    const std::size_t n = stations[k]->make_command(command, now_ns, in);
    const std::size_t m = server.on_datagram({in.data(), n}, at(k), now_ns, out);
    stations[k]->on_datagram({out.data(), m}, now_ns);
    EXPECT_EQ(stations[k]->reply().force_w_nn.z(), 1 + 0.001 * static_cast<double>(k));
  }
  now_ns += 60'000'000'000;
  server.poll(now_ns);
  now_ns += 60'000'000'000;
  server.poll(now_ns);
  EXPECT_EQ(server.sessions().occupied(), 0u);
  EXPECT_EQ(server.sessions().active(), 0u);
}

}  // namespace
}  // namespace telenano::server

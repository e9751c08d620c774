// What a secure channel costs an exchange, next to the floor: the same AES-GCM work by OpenSSL's plain cipher
// calls. And what a handshake, a stranger and a forger cost the server.
#include <benchmark/benchmark.h>
#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <vector>

#include "telenano/common/rt/steady_clock.h"
#include "tests/unit/security/dtls_rig.h"
#include "tests/unit/security/memory_wire.h"

namespace telenano::security {
namespace {

constexpr std::size_t kReplyBytes = 171;

void floor_aes_gcm_seal_and_open(benchmark::State& state) {
  EVP_CIPHER_CTX* const seal = EVP_CIPHER_CTX_new();
  EVP_CIPHER_CTX* const open = EVP_CIPHER_CTX_new();
  const std::array<unsigned char, 16> key{1};
  std::array<unsigned char, 12> nonce{};
  const std::array<unsigned char, 13> head{};
  std::array<unsigned char, kReplyBytes> plain{}, cipher{}, back{};
  std::array<unsigned char, 16> tag{};
  EVP_EncryptInit_ex(seal, EVP_aes_128_gcm(), nullptr, key.data(), nullptr);
  EVP_DecryptInit_ex(open, EVP_aes_128_gcm(), nullptr, key.data(), nullptr);
  int n = 0;
  for (auto _ : state) {
    ++nonce[0];
    EVP_EncryptInit_ex(seal, nullptr, nullptr, nullptr, nonce.data());
    EVP_EncryptUpdate(seal, nullptr, &n, head.data(), head.size());
    EVP_EncryptUpdate(seal, cipher.data(), &n, plain.data(), plain.size());
    EVP_EncryptFinal_ex(seal, cipher.data(), &n);
    EVP_CIPHER_CTX_ctrl(seal, EVP_CTRL_AEAD_GET_TAG, 16, tag.data());
    EVP_DecryptInit_ex(open, nullptr, nullptr, nullptr, nonce.data());
    EVP_DecryptUpdate(open, nullptr, &n, head.data(), head.size());
    EVP_DecryptUpdate(open, back.data(), &n, cipher.data(), cipher.size());
    EVP_CIPHER_CTX_ctrl(open, EVP_CTRL_AEAD_SET_TAG, 16, tag.data());
    if (EVP_DecryptFinal_ex(open, back.data(), &n) != 1) state.SkipWithError("does not open");
  }
  EVP_CIPHER_CTX_free(seal);
  EVP_CIPHER_CTX_free(open);
}
BENCHMARK(floor_aes_gcm_seal_and_open);

DtlsClientConfig omega_1() {
  DtlsClientConfig config;
  config.key = StationKey{"omega-1", psk_of(1)};
  return config;
}

void dtls_seal_and_open(benchmark::State& state) {
  rt::SteadyClock clock;
  MemoryWire a{DatagramNet::address(1, 1)}, b{DatagramNet::address(2, 2)};
  a.join(b);
  b.join(a);
  DtlsServerConfig config;
  config.datagrams_per_peer_s = 1e9;
  config.datagrams_per_peer_burst = 1e9;
  DtlsServer server(config, two_keys(), a, clock);
  DtlsClient station(omega_1(), b, a.address(), clock);
  std::array<std::uint8_t, 513> buffer{};
  net::Received received;
  for (int i = 0; i < 6; ++i) {
    server.receive(buffer, received);
    station.receive(buffer, received);
  }
  const std::array<std::uint8_t, kReplyBytes> reply{};
  for (auto _ : state) {
    station.send(reply, a.address());
    if (!server.receive(buffer, received)) state.SkipWithError("does not open");
  }
}
BENCHMARK(dtls_seal_and_open);

/// Sealed with another key: what a forger costs the server, per datagram.
void forged(benchmark::State& state) {
  DtlsServerConfig config;
  config.datagrams_per_peer_s = 1e9;
  config.datagrams_per_peer_burst = 1e9;
  DtlsRig rig(two_keys(), config);
  rig.connect();
  rig.turns(4);
  rig.station->send(std::array<std::uint8_t, kReplyBytes>{}, rig.server_end.address());
  DatagramNet::Packet packet = rig.network.sent().back();
  rig.network.drop_waiting(rig.server_end.address());
  packet.bytes[50] ^= 1;
  for (auto _ : state) {
    state.PauseTiming();
    rig.network.sent().clear();
    rig.network.deliver(packet);
    state.ResumeTiming();
    benchmark::DoNotOptimize(rig.server->receive(rig.buffer, rig.received));
  }
}
BENCHMARK(forged)->Iterations(20000);

/// The first ClientHello of an address that was never seen: a cookie goes back.
void stranger(benchmark::State& state) {
  DtlsServerConfig config;
  config.cookies_per_s = 1e9;
  DtlsRig rig(two_keys(), config);
  rig.connect();
  const DatagramNet::Packet packet = rig.network.sent().at(0);
  rig.network.drop_waiting(rig.server_end.address());
  for (auto _ : state) {
    state.PauseTiming();
    rig.network.sent().clear();
    rig.network.deliver(packet);
    state.ResumeTiming();
    benchmark::DoNotOptimize(rig.server->receive(rig.buffer, rig.received));
  }
}
BENCHMARK(stranger)->Iterations(20000);

/// A whole handshake with a pre-shared key, both ends; and the longest that the server's part held its loop.
void handshake_with_key(benchmark::State& state) {
  DtlsServerConfig config;
  config.handshakes_per_address_s = config.handshakes_per_address_burst = 1e9;
  config.cookies_per_s = 1e9;
  DtlsRig rig(two_keys(), config);
  const rt::SteadyClock time;
  std::array<std::vector<double>, 4> steps_ns;  // of the server, by the station's flight
  for (auto _ : state) {
    rig.connect();
    for (int i = 0; i < 4; ++i) {
      const std::int64_t begin_ns = time.now_ns();
      rig.server->receive(rig.buffer, rig.received);
      steps_ns[i].push_back(static_cast<double>(time.now_ns() - begin_ns));
      rig.station->receive(rig.station_buffer, rig.station_received);
    }
    if (!rig.station->established()) state.SkipWithError("no association");
    rig.network.sent().clear();
  }
  double sum_us = 0, longest_us = 0;
  for (auto& step : steps_ns) {
    std::nth_element(step.begin(), step.begin() + step.size() / 2, step.end());
    const double us = 1e-3 * step[step.size() / 2];
    sum_us += us;
    longest_us = std::max(longest_us, us);
  }
  state.counters["server_us"] = sum_us;
  state.counters["longest_step_us"] = longest_us;
}
BENCHMARK(handshake_with_key)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace telenano::security

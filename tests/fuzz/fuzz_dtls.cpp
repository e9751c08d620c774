// A script of what strangers and a bad network can do to the encrypted port, with a real station among them.
// Whatever the script: what the server reads are the station's own words, each at most once; a stranger is sent
// no more bytes than he sent, or three times as many if he was the first to bring what the station has sealed;
// and no stranger's address is ever proven.
#include <openssl/crypto.h>
#include <openssl/rand.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <vector>

#include "fuzz_input.h"
#include "telenano/common/security/dtls_client.h"
#include "telenano/common/security/dtls_server.h"
#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

using fuzz::Script;

/// OpenSSL's random numbers from a counter, so that a script does the same each time.
namespace fixed_random {
std::uint64_t state = 1;
int bytes(unsigned char* out, int n) {
  for (int i = 0; i < n; ++i) out[i] = static_cast<unsigned char>(Random::splitmix64(state));
  return 1;
}
int status() {
  return 1;
}
const RAND_METHOD kMethod{nullptr, bytes, nullptr, nullptr, bytes, status};
}  // namespace fixed_random

#if TELENANO_FUZZ
/// OpenSSL allocates thousands of times in a handshake: from the C library itself that costs half of what it
/// does through the sanitizer. What our own code allocates is watched as ever.
namespace plain_memory {
extern "C" void* __libc_malloc(std::size_t);
extern "C" void* __libc_realloc(void*, std::size_t);
extern "C" void __libc_free(void*);
const bool kSet =
    CRYPTO_set_mem_functions([](std::size_t n, const char*, int) { return __libc_malloc(n); },
                             [](void* p, std::size_t n, const char*, int) { return __libc_realloc(p, n); },
                             [](void* p, const char*, int) { __libc_free(p); }) == 1;
}  // namespace plain_memory
#endif

class World {
 public:
  World() {
    rig_.connect();
    strangers_.reserve(3);
    for (std::uint8_t i = 0; i < 3; ++i)
      strangers_.push_back(DatagramNet::address(static_cast<std::uint8_t>(10 + i), 4000));
  }

  void run(Script script) {
    for (int step = 0; step < 200 && !script.done(); ++step) act(script);
    // What the wire still holds comes too.
    for (int i = 0; i < 8; ++i) serve();
    check();
  }

 private:
  /// As many as can come, and no more that would have to be made each time.
  static DtlsServerConfig few() {
    DtlsServerConfig config;
    config.capacity = 6;
    return config;
  }

  void act(Script& script) {
    const std::uint8_t op = script.byte();
    const net::Address stranger = strangers_[(op >> 4) % strangers_.size()];
    switch (op & 15) {
      case 0:
        rig_.pass_ms(script.byte());
        break;
      case 1:
        rig_.pass_ms(1000 * script.byte());
        break;
      case 2:
      case 3:
      case 4:
        serve();
        hear();
        break;
      case 5:
        say();
        break;
      case 6: {  // out of nothing
        const auto raw = script.take(script.word() % 2000);
        put(stranger, {raw.begin(), raw.end()});
        break;
      }
      case 7:  // out of nothing, in the station's name
      {
        const auto raw = script.take(script.word() % 2000);
        put(rig_.station_end.address(), {raw.begin(), raw.end()});
        break;
      }
      case 8:  // seen before, from a stranger
        put(stranger, seen(script));
        break;
      case 9:  // seen before, in the station's name
        put(rig_.station_end.address(), seen(script));
        break;
      case 10: {  // changed, from a stranger
        auto bytes = seen(script);
        change(bytes, script);
        put(stranger, std::move(bytes));
        break;
      }
      case 11: {  // changed, in the station's name
        auto bytes = seen(script);
        change(bytes, script);
        put(rig_.station_end.address(), std::move(bytes));
        break;
      }
      case 12: {  // changed, in the server's name
        auto bytes = seen(script);
        change(bytes, script);
        rig_.network.deliver({rig_.server_end.address(), rig_.station_end.address(), std::move(bytes)});
        hear();
        break;
      }
      case 13: {  // two in one, or the head of a record written by hand
        auto bytes = seen(script);
        const auto more = seen(script);
        bytes.insert(bytes.end(), more.begin(), more.end());
        put(stranger, std::move(bytes));
        break;
      }
      case 14:
        rig_.network.drop_waiting(rig_.server_end.address());
        break;
      default:
        rig_.connect();  // the station starts again
        break;
    }
    serve();
  }

  void say() {
    std::array<std::uint8_t, 9> words{};
    for (std::size_t i = 0; i < 8; ++i) words[i] = static_cast<std::uint8_t>(said_ >> (8 * i));
    words[8] = 0x5a;
    ++said_;
    rig_.station->send(words, rig_.server_end.address());
  }

  void serve() {
    while (rig_.server->receive(rig_.buffer, rig_.received)) {
      FUZZ_CHECK(rig_.received.from.channel != 0);
      FUZZ_CHECK(rig_.received.from == rig_.station_end.address() || !rig_.received.standing.address_proven);
      FUZZ_CHECK(rig_.received.size == 9 && rig_.buffer[8] == 0x5a);
      std::uint64_t number = 0;
      for (std::size_t i = 0; i < 8; ++i) number |= std::uint64_t{rig_.buffer[i]} << (8 * i);
      FUZZ_CHECK(number < said_);
      FUZZ_CHECK(heard_.insert(number).second);  // nothing twice
      FUZZ_CHECK(rig_.received.standing.rights == net::Rights::kOperate);
      const std::array<std::uint8_t, 4> answer{1, 2, 3, 4};
      rig_.server->send(answer, rig_.received.from);
    }
  }
  void hear() {
    while (rig_.station->receive(rig_.station_buffer, rig_.station_received)) {
      FUZZ_CHECK(rig_.station_received.size == 4 && rig_.station_buffer[0] == 1 &&
                 rig_.station_buffer[3] == 4);
    }
  }

  void put(const net::Address& from, std::vector<std::uint8_t> bytes) {
    if (!(from == rig_.station_end.address())) from_[from.ip[15]] += bytes.size();
    rig_.network.deliver({from, rig_.server_end.address(), std::move(bytes)});
  }
  std::vector<std::uint8_t> seen(Script& script) {
    const auto& sent = rig_.network.sent();
    const std::size_t back = script.byte();
    return sent.empty() ? std::vector<std::uint8_t>() : sent[sent.size() - 1 - back % sent.size()].bytes;
  }
  static void change(std::vector<std::uint8_t>& bytes, Script& script) {
    const std::uint8_t how = script.byte();
    if (bytes.empty()) return;
    if (how < 32) {
      bytes.resize(std::min<std::size_t>(2000, script.word()));
    } else {
      for (int i = 0; i < 1 + how % 6; ++i) bytes[script.word() % bytes.size()] = script.byte();
    }
  }

  void check() {
    for (const auto& packet : rig_.network.sent()) {
      if (!(packet.from == rig_.server_end.address())) continue;
      const bool stranger = std::find(strangers_.begin(), strangers_.end(), packet.to) != strangers_.end();
      if (stranger) to_[packet.to.ip[15]] += packet.bytes.size();
    }
    const std::uint64_t share = rig_.events(SecurityEvent::kMoved) > 0 ? 3 : 1;
    for (const auto& [who, bytes] : to_) FUZZ_CHECK(bytes <= share * from_[who]);
    // One that a stranger has taken elsewhere stays, beside the station's next.
    if (rig_.events(SecurityEvent::kMoved) == 0) FUZZ_CHECK(rig_.server->established() <= 1);
    FUZZ_CHECK(rig_.server->under_way() <= 1 + strangers_.size());
  }

  DtlsRig rig_{two_keys(), few()};
  std::vector<net::Address> strangers_;
  std::map<std::uint8_t, std::uint64_t> from_;  ///< bytes from a stranger
  std::map<std::uint8_t, std::uint64_t> to_;    ///< and to him
  std::uint64_t said_ = 0;
  std::set<std::uint64_t> heard_;
};

}  // namespace
}  // namespace telenano::security

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telenano::security;
#if TELENANO_FUZZ
  FUZZ_CHECK(plain_memory::kSet);
#endif
  RAND_set_rand_method(&fixed_random::kMethod);
  fixed_random::state = 1;
  World().run({data, size});
  return 0;
}

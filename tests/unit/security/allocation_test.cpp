// The established exchange takes nothing from the heap, whoever calls it: OpenSSL's own allocations count
// too. From 3.2 on it takes two small blocks for each record that it writes, and gives them back before
// SSL_write returns: glibc has them in the thread's own cache then, without a lock or a call of the kernel.
#include <gtest/gtest.h>
#include <openssl/opensslv.h>

#include "tests/support/alloc_guard.h"
#include "tests/unit/security/dtls_rig.h"
#include "tests/unit/security/memory_wire.h"

namespace telenano::security {
namespace {

TEST(DtlsAllocation, NoneForValidDatagrams) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "a sanitizer has its own allocator";
  rt::VirtualClock clock;
  clock.advance_to(1'000'000'000);
  MemoryWire a(DatagramNet::address(1, 1)), b(DatagramNet::address(2, 2));
  a.join(b);
  b.join(a);
  DtlsServer server({}, two_keys(), a, clock);
  DtlsClientConfig config;
  config.key = StationKey{"omega-1", psk_of(1)};
  DtlsClient station(config, b, a.address(), clock);
  std::array<std::uint8_t, 513> in{};
  net::Received received;
  for (int i = 0; i < 10; ++i) {
    server.receive(in, received);
    station.receive(in, received);
  }
  ASSERT_TRUE(station.established());
  const std::array<std::uint8_t, 126> command{};
  const std::array<std::uint8_t, 171> reply{};
  const auto exchange = [&] {
    clock.advance_to(clock.now_ns() + 1'000'000);
    bool good = station.send(command, a.address()) == net::SendStatus::kSent;
    good = server.receive(in, received) && received.size == command.size() && good;
    good = server.send(reply, received.from) == net::SendStatus::kSent && good;
    good = station.receive(in, received) && received.size == reply.size() && good;
    server.receive(in, received);  // and both look in vain
    station.receive(in, received);
    return good;
  };
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(exchange());
  int good = 0;
  const support::AllocGuard guard;
  for (int i = 0; i < 10'000; ++i) good += exchange() ? 1 : 0;
  const std::uint64_t sent = 2 * 10'000;
  const std::uint64_t taken = OPENSSL_VERSION_NUMBER < 0x30200000L ? 0 : 2 * sent;
  EXPECT_EQ(guard.allocations(), taken);
  EXPECT_EQ(guard.frees(), taken);
  EXPECT_EQ(good, 10'000);

  // Forged ones may take a little, but keep nothing: what was taken was given back, to within what OpenSSL's
  // list of errors holds on to.
  const support::AllocGuard forged;
  for (int i = 0; i < 1000; ++i) {
    station.send(command, a.address());
    a.spoil();
    server.receive(in, received);
  }
  EXPECT_EQ(server.counters()[SecurityEvent::kForged], 1000u);
  EXPECT_LE(forged.allocations(), 4u * 1000u);
  EXPECT_LE(forged.allocations() - forged.frees(), 64u);
}

}  // namespace
}  // namespace telenano::security

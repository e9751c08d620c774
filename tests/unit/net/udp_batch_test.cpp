// Many datagrams a system call, over real loopback sockets: nothing may be lost, cut or mixed up that one
// call a datagram would not lose, and the kernel is asked no oftener than promised.
#include "telenano/common/net/udp_batch.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <thread>
#include <vector>

#include "tests/support/alloc_guard.h"

namespace telenano::net {
namespace {

using Bytes = std::vector<std::uint8_t>;

struct Pair {
  explicit Pair(std::size_t n = 8, const char* at = "127.0.0.1:0")
      : socket(Udp::listen(parse_address(at, "test"))),
        batch(socket, n),
        peer(Udp::open_for(socket.local())) {}
  Udp socket;
  UdpBatch batch;
  Udp peer;
  std::array<std::uint8_t, 3000> buffer{};
  Received received;

  void say(const Bytes& bytes) { ASSERT_EQ(peer.send(bytes, socket.local()), SendStatus::kSent); }
  /// Loopback delivers within the call that sends.
  bool take() { return batch.receive(buffer, received); }
};

class Family : public testing::TestWithParam<const char*> {};

TEST_P(Family, CarriesDatagramsBothWays) {
  std::unique_ptr<Pair> p;
  try {
    p = std::make_unique<Pair>(8, GetParam());
  } catch (const std::exception& e) {
    GTEST_SKIP() << "not on this machine: " << e.what();
  }
  EXPECT_FALSE(p->take()) << "never waits";
  p->say({1, 2, 3});
  ASSERT_TRUE(p->take());
  EXPECT_EQ(p->received.size, 3u);
  EXPECT_EQ(p->buffer[2], 3);
  EXPECT_EQ(p->received.from.port, p->peer.local().port);
  EXPECT_TRUE(is_loopback(p->received.from));
  EXPECT_EQ(p->batch.send(Bytes{4, 5}, p->received.from), SendStatus::kSent);
  p->batch.flush();
  ASSERT_TRUE(p->peer.wait_readable(10'000'000'000));
  ASSERT_TRUE(p->peer.receive(p->buffer, p->received));
  EXPECT_EQ(p->received.size, 2u);
  EXPECT_EQ(p->buffer[1], 5);
  EXPECT_EQ(p->received.from, p->socket.local());
}
INSTANTIATE_TEST_SUITE_P(Families, Family, testing::Values("127.0.0.1:0", "[::1]:0"),
                         [](const auto& instance) { return instance.index == 0 ? "IPv4" : "IPv6"; });

TEST(UdpBatch, AnIpv6SocketServesIpv4Peers) {
  try {
    Udp socket = Udp::listen(parse_address("[::]:0", "test"));
    UdpBatch batch(socket);
    Address at = parse_address("127.0.0.1:0", "test");
    at.port = socket.local().port;
    Udp peer = Udp::open_for(at);
    std::array<std::uint8_t, 16> buffer{};
    Received received;
    peer.send(Bytes{7}, at);
    ASSERT_TRUE(batch.receive(buffer, received));
    EXPECT_EQ(to_string(received.from),
              to_string(parse_address("127.0.0.1:" + std::to_string(peer.local().port), "")));
    batch.send(Bytes{8, 9}, received.from);
    batch.flush();
    ASSERT_TRUE(peer.wait_readable(10'000'000'000));
    ASSERT_TRUE(peer.receive(buffer, received));
    EXPECT_EQ(received.size, 2u);
  } catch (const std::exception& e) {
    GTEST_SKIP() << "not on this machine: " << e.what();
  }
}

TEST(UdpBatch, AnIpv4SocketCannotReachIpv6) {
  Pair p;
  Address v6;
  v6.ip[15] = 1;
  v6.port = 9;
  EXPECT_EQ(p.batch.send(Bytes{1}, v6), SendStatus::kFailed);
  p.batch.flush();
  EXPECT_EQ(p.batch.counters().send_calls, 0u);
}

TEST(UdpBatch, OneCallFetchesWhatHasComeAndKnowsWhenItWasAll) {
  Pair p(8);
  for (std::uint8_t i = 0; i < 5; ++i) p.say({i});
  for (std::uint8_t i = 0; i < 5; ++i) {
    ASSERT_TRUE(p.take());
    EXPECT_EQ(p.buffer[0], i) << "in order";
  }
  EXPECT_FALSE(p.take()) << "five of eight: that was all";
  EXPECT_EQ(p.batch.counters().receive_calls, 1u);
  p.say({9});
  ASSERT_TRUE(p.take()) << "it asks again after it has said so";
  EXPECT_EQ(p.buffer[0], 9);
}

TEST(UdpBatch, AFullBatchIsFollowedByAnother) {
  Pair p(4);
  for (std::uint8_t i = 0; i < 8; ++i) p.say({i});
  for (std::uint8_t i = 0; i < 8; ++i) {
    ASSERT_TRUE(p.take());
    EXPECT_EQ(p.buffer[0], i);
  }
  EXPECT_FALSE(p.take());
  EXPECT_EQ(p.batch.counters().receive_calls, 3u) << "4, 4, none";
  EXPECT_EQ(p.batch.counters().received, 8u);
}

TEST(UdpBatch, AnswersLeaveTogetherBeforeMoreIsFetched) {
  Pair p(4);
  for (std::uint8_t i = 0; i < 4; ++i) p.say({i});
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(p.take());
    p.batch.send({p.buffer.data(), 1}, p.received.from);
  }
  EXPECT_EQ(p.batch.counters().send_calls, 0u) << "kept back";
  EXPECT_FALSE(p.peer.wait_readable(0));
  EXPECT_FALSE(p.take());
  EXPECT_EQ(p.batch.counters().send_calls, 1u);
  EXPECT_EQ(p.batch.counters().sent, 4u);
  for (std::uint8_t i = 0; i < 4; ++i) {
    ASSERT_TRUE(p.peer.wait_readable(10'000'000'000));
    ASSERT_TRUE(p.peer.receive(p.buffer, p.received));
    EXPECT_EQ(p.buffer[0], i);
  }
}

TEST(UdpBatch, MoreAnswersThanItKeepsGoInSeveralCalls) {
  Pair p(4);
  Address to = p.socket.local();
  to.port = p.peer.local().port;
  for (std::uint8_t i = 0; i < 10; ++i) EXPECT_EQ(p.batch.send(Bytes{i}, to), SendStatus::kSent);
  p.batch.flush();
  EXPECT_EQ(p.batch.counters().send_calls, 3u) << "4, 4, 2";
  for (std::uint8_t i = 0; i < 10; ++i) {
    ASSERT_TRUE(p.peer.wait_readable(10'000'000'000));
    ASSERT_TRUE(p.peer.receive(p.buffer, p.received));
    EXPECT_EQ(p.buffer[0], i);
  }
}

TEST(UdpBatch, TheDestructorSendsWhatIsKept) {
  Udp socket = Udp::listen(parse_address("127.0.0.1:0", "test"));
  Udp peer = Udp::listen(parse_address("127.0.0.1:0", "test"));
  { UdpBatch(socket).send(Bytes{1}, peer.local()); }
  EXPECT_TRUE(peer.wait_readable(10'000'000'000));
}

TEST(UdpBatch, EmptyCutAndOversizeDatagramsTellTheirSize) {
  Pair p;
  p.say({});
  p.say(Bytes(UdpBatch::kSlotBytes, 3));
  p.say(Bytes(UdpBatch::kSlotBytes + 1, 4));
  p.say(Bytes(60000, 5));
  p.say({6});
  ASSERT_TRUE(p.take());
  EXPECT_EQ(p.received.size, 0u);
  std::array<std::uint8_t, 10> small{};
  ASSERT_TRUE(p.batch.receive(small, p.received)) << "cut to the reader's buffer";
  EXPECT_EQ(p.received.size, UdpBatch::kSlotBytes);
  EXPECT_EQ(small[9], 3);
  ASSERT_TRUE(p.take());
  EXPECT_EQ(p.received.size, UdpBatch::kSlotBytes + 1) << "cut, with its true size";
  ASSERT_TRUE(p.take());
  EXPECT_EQ(p.received.size, 60000u);
  ASSERT_TRUE(p.take());
  EXPECT_EQ(p.received.size, 1u);
  EXPECT_EQ(p.buffer[0], 6) << "a long neighbour spills nothing";

  Address to = p.received.from;
  EXPECT_EQ(p.batch.send(Bytes{}, to), SendStatus::kSent);
  EXPECT_EQ(p.batch.send(Bytes(3000, 7), to), SendStatus::kSent) << "by a call of its own, in order";
  p.batch.send(Bytes{8}, to);
  p.batch.flush();
  for (const std::size_t size : {std::size_t{0}, std::size_t{3000}, std::size_t{1}}) {
    ASSERT_TRUE(p.peer.wait_readable(10'000'000'000));
    ASSERT_TRUE(p.peer.receive(p.buffer, p.received));
    EXPECT_EQ(p.received.size, size);
  }
}

TEST(UdpBatch, OneThatCannotGoDoesNotKeepTheOthers) {
  Pair p;
  Address good = p.socket.local();
  good.port = p.peer.local().port;
  Address nowhere = good;
  nowhere.port = 0;  // EINVAL
  Address broadcast = good;
  broadcast.ip[12] = broadcast.ip[13] = broadcast.ip[14] = broadcast.ip[15] = 255;  // EACCES
  p.batch.send(Bytes{1}, good);
  p.batch.send(Bytes{2}, nowhere);
  p.batch.send(Bytes{3}, good);
  p.batch.send(Bytes{4}, broadcast);
  p.batch.send(Bytes{5}, good);
  p.batch.flush();
  for (const int byte : {1, 3, 5}) {
    ASSERT_TRUE(p.peer.wait_readable(10'000'000'000));
    ASSERT_TRUE(p.peer.receive(p.buffer, p.received));
    EXPECT_EQ(p.buffer[0], byte);
  }
  EXPECT_FALSE(p.peer.receive(p.buffer, p.received));
  EXPECT_EQ(p.batch.counters().sent, 3u);
  EXPECT_EQ(p.batch.counters().not_sent, 2u);
}

TEST(UdpBatch, AnUnreachablePortIsNotFatal) {
  Pair p;
  Address gone = p.socket.local();
  gone.port = Udp::listen(parse_address("127.0.0.1:0", "test")).local().port;  // closed again at once
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(p.batch.send(Bytes{1}, gone), SendStatus::kSent);
    p.batch.flush();
    EXPECT_FALSE(p.take());
  }
  p.say({1});
  EXPECT_TRUE(p.take());
}

TEST(UdpBatch, AFullSendQueueLosesAnswersAndNeverWaits) {
  Udp socket = Udp::listen(parse_address("127.0.0.1:0", "test"));
  const int least = 1;  // the kernel makes some thousand bytes of it
  ASSERT_EQ(::setsockopt(socket.handle(), SOL_SOCKET, SO_SNDBUF, &least, sizeof least), 0);
  UdpBatch batch(socket, 64);
  // Nobody empties the peer: what is delivered is charged to it, or dropped, so the sender's own queue only
  // fills while a datagram is on its way. Whatever the kernel says, all are accounted for.
  Udp peer = Udp::listen(parse_address("127.0.0.1:0", "test"));
  const Bytes big(2000, 1);
  for (int i = 0; i < 640; ++i) EXPECT_EQ(batch.send(big, peer.local()), SendStatus::kSent);
  batch.flush();
  EXPECT_EQ(batch.counters().sent + batch.counters().not_sent, 640u);
}

TEST(UdpBatch, AgesAreThoseOfTheKernel) {
  // The kernel begins to stamp arrivals some time after the first socket of the machine has asked for it;
  // until then a datagram gets its time as it is read.
  for (int i = 0; i < 500; ++i) {
    Pair warm;
    warm.say({0});
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    ASSERT_TRUE(warm.take());
    if (warm.received.age_ns > 1'900'000) break;
  }
  Pair p;
  p.say({1});
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  p.say({2});
  ASSERT_TRUE(p.take());
  EXPECT_GE(p.received.age_ns, 19'000'000) << "it has waited for 20 ms; the wall clock may be slewed";
  const std::int64_t first = p.received.age_ns;
  ASSERT_TRUE(p.take());
  EXPECT_LT(p.received.age_ns, first - 19'000'000);
  EXPECT_GE(p.received.age_ns, 0);
}

TEST(UdpBatch, WithoutArrivalTimesThereIsNoAge) {
  Udp socket = Udp::listen(parse_address("127.0.0.1:0", "test"), {.arrival_times = false});
  UdpBatch batch(socket, 4);
  Udp peer = Udp::open_for(socket.local());
  std::array<std::uint8_t, 16> buffer{};
  Received received;
  received.age_ns = 1;
  for (std::uint8_t i = 0; i < 10; ++i) peer.send(Bytes{i, i}, socket.local());
  std::this_thread::sleep_for(std::chrono::milliseconds(2));
  for (std::uint8_t i = 0; i < 10; ++i) {
    ASSERT_TRUE(batch.receive(buffer, received));
    EXPECT_EQ(received.size, 2u);
    EXPECT_EQ(buffer[0], i);
    EXPECT_EQ(received.from.port, peer.local().port);
    EXPECT_EQ(received.age_ns, 0);
  }
}

TEST(UdpBatch, AWaitEndsWithADatagramOrWithItsTime) {
  for (const std::int64_t timeout_ns : {UdpBatch::kShortWaitNs, std::int64_t{30'000'000}}) {
    Pair p;
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_FALSE(p.batch.wait(timeout_ns));
    const std::chrono::duration<double, std::nano> waited = std::chrono::steady_clock::now() - begin;
    EXPECT_GE(waited.count(), 0.9 * static_cast<double>(timeout_ns)) << "the kernel's ticks round a little";
    p.say({1});
    p.say({2});
    ASSERT_TRUE(p.batch.wait(timeout_ns));
    ASSERT_TRUE(p.batch.wait(timeout_ns)) << "what was fetched is still there";
    ASSERT_TRUE(p.take());
    EXPECT_EQ(p.buffer[0], 1);
    ASSERT_TRUE(p.take());
    EXPECT_EQ(p.buffer[0], 2);
    EXPECT_FALSE(p.take()) << "and never waits";
    EXPECT_FALSE(p.batch.wait(0));
  }
}

TEST(UdpBatch, AShortWaitIsTheReceive) {
  Pair p;
  p.say({1});
  ASSERT_TRUE(p.batch.wait(UdpBatch::kShortWaitNs));
  ASSERT_TRUE(p.take());
  p.batch.send(Bytes{2}, p.received.from);
  EXPECT_FALSE(p.take());
  EXPECT_EQ(p.batch.counters().receive_calls, 1u);
  EXPECT_EQ(p.batch.counters().send_calls, 1u);
}

TEST(UdpBatch, ManyAreFoundAgainAfterALongTimeOfSingleOnes) {
  Pair p(8);
  for (int i = 0; i < 100; ++i) {
    p.say({1});
    ASSERT_TRUE(p.batch.wait(UdpBatch::kShortWaitNs));
    ASSERT_TRUE(p.take());
    EXPECT_EQ(p.received.size, 1u);
    EXPECT_EQ(p.received.from.port, p.peer.local().port);
    EXPECT_FALSE(p.take());
  }
  const std::uint64_t before = p.batch.counters().receive_calls;
  EXPECT_EQ(before, 100u) << "a call for each, as long as they come alone";
  for (std::uint8_t i = 0; i < 100; ++i) p.say(Bytes(std::size_t{1} + i, i));
  std::size_t came = 0;
  while (came < 100 && p.batch.wait(UdpBatch::kShortWaitNs)) {
    while (p.take()) {
      EXPECT_EQ(p.buffer[0], came) << "in order";
      EXPECT_EQ(p.received.size, 1 + came++);
    }
  }
  EXPECT_EQ(came, 100u);
  // At most fifteen single ones until a wait looks; then eight a call, and a last one that finds nothing.
  EXPECT_LE(p.batch.counters().receive_calls - before, 15u + 100u / 8 + 2u);
}

TEST(UdpBatch, AWaitSendsWhatIsKeptFirst) {
  Pair p;
  p.say({1});
  ASSERT_TRUE(p.take());
  p.batch.send(Bytes{2}, p.received.from);
  EXPECT_FALSE(p.batch.wait(1'000'000));
  EXPECT_TRUE(p.peer.wait_readable(0));
}

TEST(UdpBatch, AllocatesNothingAfterConstruction) {
  Pair p(4);
  const support::AllocGuard guard;
  for (int round = 0; round < 100; ++round) {
    for (std::uint8_t i = 0; i < 6; ++i) p.peer.send({p.buffer.data(), 100}, p.socket.local());
    while (p.take()) p.batch.send({p.buffer.data(), 100}, p.received.from);
    while (p.peer.receive(p.buffer, p.received)) {
    }
  }
  EXPECT_EQ(guard.allocations(), 0u);
  EXPECT_EQ(p.batch.counters().received, 600u);
  if (!support::AllocGuard::active()) GTEST_SKIP() << "a sanitizer counts for itself";
}

}  // namespace
}  // namespace telenano::net

#include "common/net/udp.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "common/base/error.h"

namespace telenano::net {
namespace {

std::string error_of(const std::string& text) {
  try {
    parse_address(text, "--server");
  } catch (const UserError& e) {
    return e.what();
  }
  return "";
}

TEST(Address, IsParsedAndPrinted) {
  EXPECT_EQ(to_string(parse_address("127.0.0.1:5100", "x")), "127.0.0.1:5100");
  EXPECT_EQ(to_string(parse_address("[::1]:65535", "x")), "[::1]:65535");
  EXPECT_EQ(to_string(parse_address("[2001:db8::7]:1", "x")), "[2001:db8::7]:1");
  EXPECT_EQ(to_string(parse_address(":0", "x")), "0.0.0.0:0");
  EXPECT_EQ(to_string(parse_address("[::ffff:10.0.0.1]:9", "x")), "10.0.0.1:9")
      << "the same peer, however written";
  EXPECT_TRUE(is_loopback(parse_address("127.3.2.1:1", "x")));
  EXPECT_TRUE(is_loopback(parse_address("[::1]:1", "x")));
  EXPECT_FALSE(is_loopback(parse_address("10.0.0.1:1", "x")));
  EXPECT_FALSE(is_loopback(parse_address(":1", "x")));
}

TEST(Address, MistakesAreNamed) {
  for (const char* text : {"", "localhost", "127.0.0.1", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:65536",
                           "127.0.0.1:-1", "127.0.0.1:5100 ", "::1:5100", "[]:5100", "no such host:5100"}) {
    const std::string error = error_of(text);
    EXPECT_NE(error.find("--server"), std::string::npos) << text;
    EXPECT_NE(error.find("expected HOST:PORT"), std::string::npos) << text;
    EXPECT_EQ(error.find('\n'), std::string::npos) << text;
  }
}

class Loopback : public testing::TestWithParam<const char*> {};

TEST_P(Loopback, CarriesDatagramsBothWays) {
  std::unique_ptr<Udp> server;
  try {
    server = std::make_unique<Udp>(Udp::listen(parse_address(GetParam(), "x")));
  } catch (const UserError& e) {
    GTEST_SKIP() << "not on this machine: " << e.what();
  }
  const Address at = server->local();
  EXPECT_NE(at.port, 0);
  Udp client = Udp::open_for(at);
  std::array<std::uint8_t, 16> buffer{};
  Received received;
  EXPECT_FALSE(server->receive(buffer, received)) << "never waits";
  EXPECT_FALSE(server->wait_readable(0));

  const std::array<std::uint8_t, 5> hello = {1, 2, 3, 4, 5};
  ASSERT_EQ(client.send(hello, at), SendStatus::kSent);
  ASSERT_TRUE(server->wait_readable(10'000'000'000));
  ASSERT_TRUE(server->receive(buffer, received));
  EXPECT_EQ(received.size, 5u);
  EXPECT_EQ(buffer[4], 5);
  EXPECT_EQ(received.from.port, client.local().port);
  EXPECT_TRUE(is_loopback(received.from));

  ASSERT_EQ(server->send({hello.data(), 2}, received.from), SendStatus::kSent);
  ASSERT_TRUE(client.wait_readable(10'000'000'000));
  ASSERT_TRUE(client.receive(buffer, received));
  EXPECT_EQ(received.size, 2u);
  EXPECT_EQ(received.from, at);

  const std::vector<std::uint8_t> big(1000, 9);  // cut to the buffer, with its true size
  client.send(big, at);
  ASSERT_TRUE(server->wait_readable(10'000'000'000));
  ASSERT_TRUE(server->receive(buffer, received));
  EXPECT_EQ(received.size, 1000u);
}

INSTANTIATE_TEST_SUITE_P(Families, Loopback, testing::Values("127.0.0.1:0", "[::1]:0"),
                         [](const auto& instance) { return instance.index == 0 ? "IPv4" : "IPv6"; });

TEST(Udp, APortInUseIsAMistakeThatCanBeMended) {
  const Udp first = Udp::listen(parse_address("127.0.0.1:0", "x"));
  try {
    Udp::listen(first.local());
    FAIL() << "bound twice";
  } catch (const UserError& e) {
    const std::string text = e.what();
    EXPECT_NE(text.find(std::to_string(first.local().port)), std::string::npos) << text;
    EXPECT_NE(text.find("in use"), std::string::npos) << text;
    EXPECT_NE(text.find("choose another port"), std::string::npos) << text;
  }
  EXPECT_THROW(Udp::listen(parse_address("192.0.2.1:0", "x")), UserError) << "not an address of this machine";
}

TEST(Udp, AnUnreachablePortIsNotFatal) {
  Address gone;
  {
    const Udp closed = Udp::listen(parse_address("127.0.0.1:0", "x"));
    gone = closed.local();
  }
  Udp client = Udp::open_for(gone);
  const std::array<std::uint8_t, 1> byte = {1};
  std::array<std::uint8_t, 16> buffer{};
  Received received;
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(client.send(byte, gone), SendStatus::kSent);
    EXPECT_FALSE(client.receive(buffer, received));
  }
}

TEST(Udp, NoticesThatNobodyListens) {
  Address gone;
  {
    const Udp closed = Udp::listen(parse_address("127.0.0.1:0", "x"));
    gone = closed.local();
  }
  Udp client = Udp::open_for(gone);
  client.notice_unreachable();
  EXPECT_EQ(client.unreachable(), Unreachable::kNo);
  const std::array<std::uint8_t, 1> byte = {1};
  std::array<std::uint8_t, 16> buffer{};
  Received received;
  for (int i = 0; i < 100 && client.unreachable() == Unreachable::kNo; ++i) {
    client.send(byte, gone);
    client.wait_readable(10'000'000);
    EXPECT_FALSE(client.receive(buffer, received));
  }
  EXPECT_EQ(client.unreachable(), Unreachable::kPort);
  // What the kernel keeps of it has been fetched: a wait waits again.
  EXPECT_FALSE(client.wait_readable(1'000'000));

  Udp server = Udp::listen(gone);
  server.send(byte, client.local());
  ASSERT_TRUE(client.wait_readable(10'000'000'000));
  ASSERT_TRUE(client.receive(buffer, received));
  EXPECT_EQ(client.unreachable(), Unreachable::kNo) << "somebody is there again";
}

TEST(Udp, SaysWhatTheKernelGranted) {
  const Udp socket = Udp::listen(parse_address("127.0.0.1:0", "x"));
  EXPECT_GT(socket.receive_buffer_bytes(), 0u);
  EXPECT_LE(socket.receive_buffer_bytes(), Udp::kBufferBytes);
}

TEST(Udp, SendsToManyPeersInTurn) {
  Udp server = Udp::listen(parse_address("127.0.0.1:0", "x"));
  std::vector<Udp> peers;
  for (int i = 0; i < 3; ++i) peers.push_back(Udp::open_for(server.local()));
  std::array<std::uint8_t, 16> buffer{};
  Received received;
  for (int round = 0; round < 3; ++round) {
    for (std::uint8_t i = 0; i < 3; ++i) {
      const std::array<std::uint8_t, 1> byte = {i};
      peers[i].send(byte, server.local());
      ASSERT_TRUE(server.wait_readable(10'000'000'000));
      ASSERT_TRUE(server.receive(buffer, received));
      EXPECT_EQ(received.from.port, peers[i].local().port);
      server.send({buffer.data(), 1}, received.from);
      ASSERT_TRUE(peers[i].wait_readable(10'000'000'000));
      ASSERT_TRUE(peers[i].receive(buffer, received));
      EXPECT_EQ(buffer[0], i);
    }
  }
}

}  // namespace
}  // namespace telenano::net

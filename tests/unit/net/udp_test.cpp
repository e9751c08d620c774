#include "telenano/common/net/udp.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <memory>
#include <vector>

#include "telenano/common/base/error.h"

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

TEST(Dscp, IsParsedAndMistakesAreNamed) {
  EXPECT_EQ(parse_dscp("ef", "--dscp"), 46);
  EXPECT_EQ(parse_dscp("none", "--dscp"), 0);
  EXPECT_EQ(parse_dscp("0", "--dscp"), 0);
  EXPECT_EQ(parse_dscp("63", "--dscp"), 63);
  for (const char* text : {"", "64", "-1", "EF", "46 ", "4.6", "af"}) {
    try {
      parse_dscp(text, "--dscp");
      ADD_FAILURE() << text;
    } catch (const UserError& e) {
      EXPECT_NE(std::string(e.what()).find("--dscp '" + std::string(text) + "'"), std::string::npos);
      EXPECT_NE(std::string(e.what()).find("ef, none or a number from 0 to 63"), std::string::npos);
    }
  }
}

/// The octet that a datagram arrives with, as the receiver's kernel reports it; -1 if it does not.
int received_octet(int handle, bool v6) {
  std::array<std::uint8_t, 16> bytes{};
  std::array<std::byte, 256> control{};
  iovec part{bytes.data(), bytes.size()};
  msghdr header{};
  header.msg_iov = &part;
  header.msg_iovlen = 1;
  header.msg_control = control.data();
  header.msg_controllen = control.size();
  if (::recvmsg(handle, &header, 0) < 0) return -1;
  for (cmsghdr* m = CMSG_FIRSTHDR(&header); m != nullptr; m = CMSG_NXTHDR(&header, m)) {
    if (!v6 && m->cmsg_level == IPPROTO_IP && m->cmsg_type == IP_TOS) return *CMSG_DATA(m);
    if (v6 && m->cmsg_level == IPPROTO_IPV6 && m->cmsg_type == IPV6_TCLASS) {
      int value = 0;
      std::memcpy(&value, CMSG_DATA(m), sizeof value);
      return value;
    }
  }
  return -1;
}

TEST(Dscp, IsOnTheDatagramsThatArrive) {
  for (const bool v6 : {false, true}) {
    std::unique_ptr<Udp> server;
    try {
      server = std::make_unique<Udp>(Udp::listen(parse_address(v6 ? "[::1]:0" : "127.0.0.1:0", "x")));
    } catch (const UserError&) {
      continue;  // no IPv6 here
    }
    const int on = 1;
    ASSERT_EQ(::setsockopt(server->handle(), v6 ? IPPROTO_IPV6 : IPPROTO_IP,
                           v6 ? IPV6_RECVTCLASS : IP_RECVTOS, &on, sizeof on),
              0);
    Udp client = Udp::open_for(server->local());
    const std::array<std::uint8_t, 3> bytes = {1, 2, 3};
    for (const int dscp : {0, kDscpEf, 63, 0}) {
      ASSERT_TRUE(client.set_dscp(dscp));
      int octet = -1;
      socklen_t length = sizeof octet;
      ASSERT_EQ(::getsockopt(client.handle(), v6 ? IPPROTO_IPV6 : IPPROTO_IP, v6 ? IPV6_TCLASS : IP_TOS,
                             &octet, &length),
                0);
      EXPECT_EQ(octet, dscp << 2);
      ASSERT_EQ(client.send(bytes, server->local()), SendStatus::kSent);
      ASSERT_TRUE(server->wait_readable(1'000'000'000));
      EXPECT_EQ(received_octet(server->handle(), v6), dscp << 2) << (v6 ? "IPv6" : "IPv4");
    }
    EXPECT_EQ(kDscpEf << 2, 0xb8);
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

/// Whoever else has a socket's file in an epoll set is told of each datagram, which the loops would feel.
TEST(Udp, IsOneFileAndNoMore) {
  const auto files = [] {
    const std::filesystem::directory_iterator all("/proc/self/fd");
    return std::distance(begin(all), end(all));
  };
  const auto before = files();
  {
    const Udp one = Udp::listen(parse_address("127.0.0.1:0", "test"));
    EXPECT_EQ(files(), before + 1);
    Udp moved = Udp::open_for(one.local());
    const Udp two = std::move(moved);
    EXPECT_EQ(files(), before + 2);
    EXPECT_NE(two.local().port, one.local().port);
  }
  EXPECT_EQ(files(), before) << "closed";
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

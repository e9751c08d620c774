// A socket that listens on every address of a machine that has several answers from the one that was written
// to: a peer takes an answer from nobody else. The oracle is the peer's kernel, which says where an answer
// came from.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <linux/ipv6.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/net/udp_batch.h"

namespace telenano::net {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr std::int64_t kLongNs = 10'000'000'000;

Address at(const std::string& host, std::uint16_t port) {
  return parse_address(
      (host.find(':') == std::string::npos ? host : "[" + host + "]") + ":" + std::to_string(port), "test");
}

/// Asks `server` at each of `hosts` by way of `ask`, which answers what has come; "" or what was wrong.
template <class Answer>
std::string answers_come_from_where_was_asked(const std::vector<std::string>& hosts, std::uint16_t port,
                                              Answer&& answer) {
  std::vector<Udp> peers;
  for (const std::string& host : hosts) peers.push_back(Udp::open_for(at(host, port)));
  for (int round = 0; round < 3; ++round) {
    // All are waiting before the first is answered: those of one call have sources of their own.
    for (std::size_t i = 0; i < hosts.size(); ++i)
      peers[i].send(Bytes{static_cast<std::uint8_t>(i)}, at(hosts[i], port));
    answer(hosts.size());
    for (std::size_t i = 0; i < hosts.size(); ++i) {
      std::array<std::uint8_t, 16> buffer{};
      Received received;
      if (!peers[i].wait_readable(kLongNs) || !peers[i].receive(buffer, received))
        return "no answer from " + hosts[i];
      if (!(received.from == at(hosts[i], port)))
        return "asked " + hosts[i] + ", answered by " + to_string(received.from);
      if (received.size != 1 || buffer[0] != i) return "another's answer";
    }
  }
  return "";
}

std::string by_batch(const std::string& listen, const std::vector<std::string>& hosts, std::size_t together,
                     bool times = false) {
  UdpOptions options;
  options.arrival_times = times;
  Udp socket = Udp::listen(parse_address(listen, "test"), options);
  UdpBatch batch(socket, together);
  std::string wrong = answers_come_from_where_was_asked(hosts, socket.local().port, [&](std::size_t n) {
    std::array<std::uint8_t, 16> buffer{};
    Received received;
    while (n > 0 && batch.wait(kLongNs)) {
      while (batch.receive(buffer, received)) {
        batch.send({buffer.data(), received.size}, received.from);
        --n;
      }
    }
  });
  return wrong;
}

std::string one_by_one(const std::string& listen, const std::vector<std::string>& hosts) {
  Udp socket = Udp::listen(parse_address(listen, "test"));
  return answers_come_from_where_was_asked(hosts, socket.local().port, [&](std::size_t n) {
    std::array<std::uint8_t, 16> buffer{};
    Received received;
    while (n > 0 && socket.wait_readable(kLongNs)) {
      if (!socket.receive(buffer, received)) continue;
      socket.send({buffer.data(), received.size}, received.from);
      --n;
    }
  });
}

const std::vector<std::string> kV4 = {"127.0.0.1", "127.0.0.2", "127.9.8.7", "127.0.0.1"};

TEST(Here, AnswersComeFromTheAddressThatWasAsked) {
  for (const bool times : {false, true}) EXPECT_EQ(by_batch("0.0.0.0:0", kV4, 32, times), "");
  EXPECT_EQ(by_batch("0.0.0.0:0", kV4, 1), "") << "a call for each";
  EXPECT_EQ(one_by_one("0.0.0.0:0", kV4), "");
}

TEST(Here, AnIpv6SocketDoesSoForIpv4) {
  try {
    Udp::listen(parse_address("[::]:0", "test"));
  } catch (const UserError& e) {
    GTEST_SKIP() << "not on this machine: " << e.what();
  }
  EXPECT_EQ(by_batch("[::]:0", kV4, 32), "");
  EXPECT_EQ(by_batch("[::]:0", kV4, 1), "");
  EXPECT_EQ(one_by_one("[::]:0", kV4), "");
}

TEST(Here, SystemCallsAreAsMany) {
  Udp socket = Udp::listen(parse_address("0.0.0.0:0", "test"), {.arrival_times = false});
  UdpBatch batch(socket);
  const Address server = at("127.0.0.2", socket.local().port);
  Udp peer = Udp::open_for(server);
  std::array<std::uint8_t, 16> buffer{};
  Received received;
  for (int i = 0; i < 100; ++i) {
    peer.send(Bytes{1}, server);
    ASSERT_TRUE(batch.wait(UdpBatch::kShortWaitNs));
    ASSERT_TRUE(batch.receive(buffer, received));
    batch.send({buffer.data(), received.size}, received.from);
    ASSERT_FALSE(batch.receive(buffer, received));
  }
  EXPECT_EQ(batch.counters().receive_calls, 100u);
  EXPECT_EQ(batch.counters().send_calls, 100u);
  EXPECT_EQ(batch.counters().sent, 100u);
}

TEST(Here, OfASocketWithOneAddressNothingIsAsked) {
  Udp socket = Udp::listen(parse_address("127.0.0.1:0", "test"));
  Udp peer = Udp::open_for(socket.local());
  peer.send(Bytes{1}, socket.local());
  std::array<std::uint8_t, 16> buffer{};
  Received received;
  ASSERT_TRUE(socket.wait_readable(kLongNs));
  ASSERT_TRUE(socket.receive(buffer, received));
  EXPECT_EQ(received.from.here, (std::array<std::uint8_t, 16>{}));
}

/// A second address for `name`; false, with errno, if that is not to be had.
bool add_v6(int fd, int interface, const char* text) {
  in6_ifreq request{};
  ::inet_pton(AF_INET6, text, &request.ifr6_addr);
  request.ifr6_prefixlen = 128;
  request.ifr6_ifindex = interface;
  return ::ioctl(fd, SIOCSIFADDR, &request) == 0;
}

/// The kernel takes a moment until it lets a new address be used.
bool usable(const char* text) {
  for (int i = 0; i < 10'000; ++i) {
    try {
      Udp::listen(at(text, 0));
      return true;
    } catch (const UserError&) {
      ::usleep(1000);
    }
  }
  return false;
}

enum Outcome : int { kGood, kWrong, kNoNamespace, kNoAddresses };

/// In a process of its own, in a network of its own with three IPv6 addresses.
int in_own_network() {
  if (::unshare(CLONE_NEWNET) != 0 && ::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) return kNoNamespace;
  const int fd = ::socket(AF_INET6, SOCK_DGRAM, 0);
  ifreq up{};
  std::strcpy(up.ifr_name, "lo");
  up.ifr_flags = IFF_UP | IFF_LOOPBACK;
  const int lo = static_cast<int>(::if_nametoindex("lo"));
  if (fd < 0 || ::ioctl(fd, SIOCSIFFLAGS, &up) != 0 || !add_v6(fd, lo, "fd00::1") ||
      !add_v6(fd, lo, "fd00::2") || !usable("fd00::1") || !usable("fd00::2"))
    return kNoAddresses;
  const std::vector<std::string> hosts = {"::1", "fd00::1", "fd00::2", "127.0.0.2"};
  const std::string wrong =
      by_batch("[::]:0", hosts, 32) + by_batch("[::]:0", hosts, 1) + one_by_one("[::]:0", hosts);
  if (!wrong.empty()) std::fprintf(stderr, "%s\n", wrong.c_str());
  return wrong.empty() ? kGood : kWrong;
}

TEST(Here, Ipv6AnswersComeFromTheAddressThatWasAsked) {
  const pid_t child = ::fork();
  if (child == 0) {
    try {
      ::_exit(in_own_network());
    } catch (const std::exception& e) {
      std::fprintf(stderr, "%s\n", e.what());
      ::_exit(kNoAddresses);
    }
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == kNoNamespace) GTEST_SKIP() << "no network namespace here (unshare)";
  if (WEXITSTATUS(status) == kNoAddresses) GTEST_SKIP() << "no IPv6 in a network namespace here";
  EXPECT_EQ(WEXITSTATUS(status), kGood);
}

}  // namespace
}  // namespace telenano::net

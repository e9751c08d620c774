// A list of servers as one way, and when a station leaves one of them for the next.
#include "telenano/master/connection/server_list.h"

#include <gtest/gtest.h>

#include <array>
#include <span>

#include "telenano/common/base/error.h"
#include "telenano/master/connection/failover.h"

namespace telenano::connection {
namespace {

constexpr std::int64_t kStartNs = 1'000'000'000;

TEST(ServerNames, AreSplitAtCommas) {
  EXPECT_EQ(server_names("a:1"), std::vector<std::string>{"a:1"});
  EXPECT_EQ(server_names("a:1,[::1]:2,c:3"), (std::vector<std::string>{"a:1", "[::1]:2", "c:3"}));
  for (const char* const wrong : {"", ",", "a:1,", ",a:1", "a:1,,b:2"})
    EXPECT_THROW(server_names(wrong), UserError) << wrong;
}

TEST(ServerList, IsTheWayToTheCurrentOneUnderOneAddress) {
  std::array servers = {net::Udp::listen(net::parse_address("127.0.0.1:0", "test")),
                        net::Udp::listen(net::parse_address("127.0.0.1:0", "test"))};
  ServerAccess access;
  access.server = net::to_string(servers[0].local()) + "," + net::to_string(servers[1].local());
  ServerList list(access);
  ASSERT_EQ(list.size(), 2u);
  std::array<std::uint8_t, 64> buffer{};
  net::Received received;
  for (const std::size_t at : {0u, 1u, 0u}) {
    EXPECT_EQ(list.current(), at);
    EXPECT_EQ(list.name(), net::to_string(servers[at].local()));
    const std::array<std::uint8_t, 1> word = {static_cast<std::uint8_t>(at + 1)};
    EXPECT_EQ(list.send(word, list.as()), net::SendStatus::kSent);
    ASSERT_TRUE(servers[at].wait_readable(20'000'000'000));
    ASSERT_TRUE(servers[at].receive(buffer, received));
    EXPECT_EQ(buffer[0], word[0]);
    const net::Address station = received.from;
    servers[at].send(word, station);
    ASSERT_TRUE((list.link().wait_readable(20'000'000'000), list.receive(buffer, received)));
    EXPECT_EQ(received.from, list.as());
    // What comes from another one of the list is nobody's.
    servers[1 - at].send(word, station);
    list.link().wait_readable(20'000'000'000);
    const bool came = list.receive(buffer, received);
    EXPECT_FALSE(came && received.from == list.as());
    list.go_on();
  }
}

TEST(Leaves, AServerThatDoesNotAnswerAfterItsTime) {
  link::ClientSession session({});
  session.start(kStartNs);
  EXPECT_EQ(leaves(session, false, kStartNs + kLeavePatienceNs), LeaveCause::kNone);
  EXPECT_EQ(leaves(session, false, kStartNs + kLeavePatienceNs + 1), LeaveCause::kSilent);
}

TEST(Leaves, AnEmptyPortSoonerButNotForWhatWasSaidOfAnEarlierAttempt) {
  link::ClientSession session({});
  session.start(kStartNs);
  EXPECT_EQ(leaves(session, true, kStartNs + kLeaveLeastNs), LeaveCause::kNone);
  EXPECT_EQ(leaves(session, true, kStartNs + kLeaveLeastNs + 1), LeaveCause::kNobodyListens);
}

TEST(Leaves, NeverOneThatIsClosedOrWasNotBegun) {
  link::ClientSession session({});
  EXPECT_EQ(leaves(session, true, kStartNs * 1000), LeaveCause::kNone);
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer{};
  session.make_bye(link::ByeReason::kDone, buffer);
  EXPECT_EQ(leaves(session, true, kStartNs * 1000), LeaveCause::kNone);
}

}  // namespace
}  // namespace telenano::connection

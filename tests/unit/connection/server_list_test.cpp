// A list of servers as one way, and when a station leaves one of them for the next.
#include "telenano/master/connection/server_list.h"

#include <gtest/gtest.h>

#include <array>
#include <span>

#include "telenano/common/base/error.h"
#include "telenano/common/link/codec.h"
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

/// A whole handshake by hand: the station's session stands, then its server is silent and it begins anew.
void have_had_a_session(link::ClientSession& session) {
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::Codec codec;
  session.start(kStartNs);
  link::Incoming hello;
  ASSERT_EQ(codec.decode(std::span(out).first(session.poll(kStartNs, out)), hello), link::DropCause::kNone);
  link::Welcome welcome;
  welcome.nonce = hello.hello.nonce;
  welcome.session_id = 5;
  welcome.epoch = 3;
  welcome.resume_token = 9;
  welcome.timeout_ms = 500;
  welcome.workspace_min_w_nm = {-1, -1, -1};
  welcome.workspace_max_w_nm = {1, 1, 1};
  welcome.force_max_nn = 10;
  const std::size_t n = codec.encode(welcome, out);
  ASSERT_EQ(session.on_datagram(std::span(out).first(n), kStartNs), link::ClientEvent::kWelcome);
  session.start(kStartNs);
}

TEST(Leaves, OneThatHasNoPlaceSoon) {
  link::ClientSession session({});
  have_had_a_session(session);
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::Codec codec;
  link::Incoming hello;
  ASSERT_EQ(codec.decode(std::span(out).first(session.poll(kStartNs, out)), hello), link::DropCause::kNone);
  const link::Refuse full{hello.hello.nonce, link::RefuseReason::kFull, 1, 1};
  const std::size_t n = codec.encode(full, out);
  ASSERT_EQ(session.on_datagram(std::span(out).first(n), kStartNs), link::ClientEvent::kRefused);
  EXPECT_TRUE(session.turned_away());
  EXPECT_EQ(leaves(session, false, kStartNs + kLeaveLeastNs), LeaveCause::kNone);
  EXPECT_EQ(leaves(session, false, kStartNs + kLeaveLeastNs + 1), LeaveCause::kRefused);
  session.start(kStartNs + 2 * kLeaveLeastNs);
  EXPECT_FALSE(session.turned_away()) << "the next one has not said anything yet";
}

// It has the session, or soon will: who left now would find it nowhere.
TEST(Leaves, OneThatLooksForTheSessionLater) {
  link::ClientSession session({});
  session.start(kStartNs);
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  link::Codec codec;
  link::Incoming hello;
  ASSERT_EQ(codec.decode(std::span(out).first(session.poll(kStartNs, out)), hello), link::DropCause::kNone);
  const std::size_t n = codec.encode(link::Challenge{hello.hello.nonce, 7}, out);
  ASSERT_EQ(session.on_datagram(std::span(out).first(n), kStartNs), link::ClientEvent::kChallenge);
  EXPECT_EQ(leaves(session, false, kStartNs + kSearchPatienceNs), LeaveCause::kNone);
  EXPECT_EQ(leaves(session, false, kStartNs + kSearchPatienceNs + 1), LeaveCause::kSilent);
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

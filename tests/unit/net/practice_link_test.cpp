#include "telenano/common/net/practice_link.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"

namespace telenano::net {
namespace {

std::int64_t g_now_ns = 0;
std::int64_t now() noexcept {
  return g_now_ns;
}
constexpr std::int64_t kMs = 1'000'000;

/// A server that answers at once, with what it got.
class Echo final : public Datagram {
 public:
  SendStatus send(std::span<const std::uint8_t> bytes, const Address& to) noexcept override {
    waiting_.emplace_back(std::vector<std::uint8_t>(bytes.begin(), bytes.end()), to);
    ++sent_;
    return SendStatus::kSent;
  }
  bool receive(std::span<std::uint8_t> buffer, Received& received) noexcept override {
    if (waiting_.empty()) return false;
    std::copy(waiting_.front().first.begin(), waiting_.front().first.end(), buffer.begin());
    received = {};
    received.size = waiting_.front().first.size();
    received.from = waiting_.front().second;
    waiting_.pop_front();
    return true;
  }
  int sent() const { return sent_; }

 private:
  std::deque<std::pair<std::vector<std::uint8_t>, Address>> waiting_;
  int sent_ = 0;
};

Address server() {
  Address address;
  address.ip[15] = 1;
  address.port = 5100;
  return address;
}

/// One datagram a millisecond with its number; when the answer to each came, -1: never.
std::vector<double> answered_ms(PracticeDatagram& link, int count, int ticks) {
  std::vector<double> came(static_cast<std::size_t>(count), -1);
  std::array<std::uint8_t, 64> buffer{};
  for (int tick = 0; tick < ticks; ++tick, g_now_ns += kMs) {
    Received received;
    while (link.receive(buffer, received)) {
      EXPECT_EQ(received.size, 2u);
      EXPECT_EQ(received.from, server());
      came[static_cast<std::size_t>(buffer[0] + 256 * buffer[1])] = tick;
    }
    const std::array<std::uint8_t, 2> bytes = {static_cast<std::uint8_t>(tick % 256),
                                               static_cast<std::uint8_t>(tick / 256)};
    if (tick < count) link.send(bytes, server());
    link.flush();
  }
  return came;
}

TEST(PracticeLink, AddsItsRoundTrip) {
  Echo echo;
  PracticeDatagram link(echo, now, {100, 0, 0});
  const std::vector<double> came = answered_ms(link, 200, 400);
  for (std::size_t i = 0; i < came.size(); ++i) EXPECT_NEAR(came[i] - static_cast<double>(i), 100, 2) << i;
}

TEST(PracticeLink, AddsNothingWhenOff) {
  Echo echo;
  PracticeDatagram link(echo, now, {});
  const std::vector<double> came = answered_ms(link, 100, 110);
  for (std::size_t i = 0; i < came.size(); ++i) EXPECT_LE(came[i] - static_cast<double>(i), 1) << i;
}

// Of 1000 each way with 10 %: 810 expected, standard deviation 12.
TEST(PracticeLink, LosesItsShareOfEachWay) {
  Echo echo;
  PracticeDatagram link(echo, now, {20, 0, 0.1});
  int answered = 0;
  for (const double at : answered_ms(link, 1000, 1200)) answered += at >= 0 ? 1 : 0;
  EXPECT_NEAR(echo.sent(), 900, 45);
  EXPECT_NEAR(answered, 810, 60);
}

// What is on its way comes as it was to; in order, whatever was changed.
TEST(PracticeLink, IsChangedWhileItRuns) {
  Echo echo;
  PracticeDatagram link(echo, now, {200, 0, 0});
  const std::vector<double> before = answered_ms(link, 50, 60);
  link.set({});
  std::array<std::uint8_t, 64> buffer{};
  Received received;
  int came = 0;
  for (int tick = 0; tick < 400; ++tick, g_now_ns += kMs) {
    while (link.receive(buffer, received)) EXPECT_EQ(buffer[0], came++);
  }
  EXPECT_EQ(came, 50);
  EXPECT_EQ(before.front(), -1);
}

TEST(PracticeLink, IsReadFromAFlag) {
  const PracticeLink link = parse_practice_link("rtt=120,jitter=5,loss=2.5", "--practice-link");
  EXPECT_EQ(link.rtt_ms, 120);
  EXPECT_EQ(link.jitter_ms, 5);
  EXPECT_EQ(link.loss, 0.025);
  EXPECT_EQ(practice_text(link), "+120 ms, jitter 5 ms, 2.5 % lost");
  EXPECT_FALSE(parse_practice_link("off", "x").any());
  EXPECT_EQ(practice_text({}), "");
  for (const char* bad :
       {"", "rtt", "rtt=", "rtt=-1", "rtt=nan", "rtt=3000", "loss=60", "delay=5", "rtt=1,", "rtt=1;loss=2"})
    EXPECT_THROW(parse_practice_link(bad, "--practice-link"), UserError) << bad;
}

}  // namespace
}  // namespace telenano::net

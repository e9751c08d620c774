#include "telenano/master/connection/practice_datagram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <utility>
#include <vector>

namespace telenano::connection {
namespace {

using net::Address;
using net::Received;
using net::SendStatus;

std::int64_t g_now_ns = 0;
std::int64_t now() noexcept {
  return g_now_ns;
}
constexpr std::int64_t kMs = 1'000'000;

/// A server that answers at once, with what it got.
class Echo final : public net::Datagram {
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

TEST(PracticeDatagram, AddsItsRoundTrip) {
  Echo echo;
  PracticeDatagram link(echo, now, {100, 0, 0});
  const std::vector<double> came = answered_ms(link, 200, 400);
  for (std::size_t i = 0; i < came.size(); ++i) EXPECT_NEAR(came[i] - static_cast<double>(i), 100, 2) << i;
}

TEST(PracticeDatagram, AddsNothingWhenOff) {
  Echo echo;
  PracticeDatagram link(echo, now, {});
  const std::vector<double> came = answered_ms(link, 100, 110);
  for (std::size_t i = 0; i < came.size(); ++i) EXPECT_LE(came[i] - static_cast<double>(i), 1) << i;
}

// Of 1000 each way with 10 %: 810 expected, standard deviation 12.
TEST(PracticeDatagram, LosesItsShareOfEachWay) {
  Echo echo;
  PracticeDatagram link(echo, now, {20, 0, 0.1});
  int answered = 0;
  for (const double at : answered_ms(link, 1000, 1200)) answered += at >= 0 ? 1 : 0;
  EXPECT_NEAR(echo.sent(), 900, 45);
  EXPECT_NEAR(answered, 810, 60);
}

// What is on its way comes as it was to; in order, whatever was changed.
TEST(PracticeDatagram, IsChangedWhileItRuns) {
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

// Jitter too is taken when the link is changed: half-normal of 20 ms, on both ways, its mean 16 ms each.
TEST(PracticeDatagram, JitterComesWithAChange) {
  Echo echo;
  PracticeDatagram link(echo, now, {});
  link.set({50, 20, 0});
  const std::vector<double> came = answered_ms(link, 500, 900);
  double most = 0;
  for (std::size_t i = 0; i < came.size(); ++i) {
    EXPECT_GE(came[i] - static_cast<double>(i), 49) << i;
    most = std::max(most, came[i] - static_cast<double>(i));
  }
  EXPECT_GT(most, 80);
}

}  // namespace
}  // namespace telenano::connection

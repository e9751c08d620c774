#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "telenano/common/link/link_stats.h"
#include "telenano/common/link/received_energy.h"
#include "telenano/common/link/sequence_window.h"
#include "telenano/common/link/siphash.h"
#include "telenano/common/link/token_bucket.h"

namespace telenano::link {
namespace {

TEST(SipHash, GivesTheNumbersOfItsPaper) {
  // Appendix A of Aumasson & Bernstein 2012, and the first vectors of their reference implementation:
  // key 00 01 … 0f, input 00 01 … of length n.
  const SipKey key{0x0706050403020100, 0x0f0e0d0c0b0a0908};
  std::array<std::uint8_t, 15> input{};
  for (std::size_t i = 0; i < input.size(); ++i) input[i] = static_cast<std::uint8_t>(i);
  EXPECT_EQ(siphash(key, input), 0xa129ca6149be45e5ull);
  EXPECT_EQ(siphash(key, {}), 0x726fdb47dd0e0e31ull);
  EXPECT_EQ(siphash(key, std::span(input).first(1)), 0x74f839c593dc67fdull);
  EXPECT_EQ(siphash(key, std::span(input).first(8)), 0x93f5f5799a932462ull);
  const std::uint64_t word = 0x0706050403020100;
  EXPECT_EQ(siphash_words(key, {&word, 1}), 0x93f5f5799a932462ull);
}

constexpr std::uint64_t kFar = 1000;  // further than any leap of these tests but those that say so

TEST(SequenceWindow, AcceptsOnlyNewerOnesAndCounts) {
  SequenceWindow w;
  EXPECT_EQ(w.accept(0, kFar), DropCause::kOutOfRange);
  EXPECT_EQ(w.accept(1, kFar), DropCause::kNone);
  EXPECT_EQ(w.accept(1, kFar), DropCause::kDuplicate);
  EXPECT_EQ(w.accept(5, kFar), DropCause::kNone);
  EXPECT_EQ(w.lost(), 3u);
  EXPECT_EQ(w.accept(3, kFar), DropCause::kStale);
  EXPECT_EQ(w.accept(3, kFar), DropCause::kDuplicate);
  EXPECT_EQ(w.lost(), 2u);
  EXPECT_EQ(w.accept(1000, kFar), DropCause::kNone);
  EXPECT_EQ(w.accept(936, kFar), DropCause::kDuplicate) << "too old to tell";
  EXPECT_EQ(w.accept(937, kFar), DropCause::kStale);
  EXPECT_EQ(w.reordered(), 2u);
  EXPECT_EQ(w.received(), 5u);
  EXPECT_EQ(w.lost(), 995u);
  EXPECT_EQ(w.accept(1000 + kFar + 1, kFar), DropCause::kOutOfRange);
  EXPECT_EQ(w.accept(1001, kFar), DropCause::kNone) << "a leap out of range locks nobody out";
  EXPECT_EQ(w.accept(UINT64_MAX, kFar), DropCause::kOutOfRange);
}

TEST(SequenceWindow, ALeapIsBoundByRateAndTime) {
  // 1.25 · rate · (t + 1 s) + 64, by hand.
  EXPECT_EQ(SequenceWindow::max_leap(1000, 0), 64u + 1250u);
  EXPECT_EQ(SequenceWindow::max_leap(1000, 3'000'000'000), 64u + 5000u);
  EXPECT_EQ(SequenceWindow::max_leap(8000, 1'000'000'000), 64u + 20000u);
  EXPECT_EQ(SequenceWindow::max_leap(1000, -5), 64u + 1250u) << "a clock that goes back";
  EXPECT_LT(SequenceWindow::max_leap(8000, INT64_MAX), 1ull << 32);
  // Every single flipped bit of a stream's next number: never further than that, and what was honest and far
  // after an outage is taken.
  for (int bit = 0; bit < 64; ++bit) {
    SequenceWindow w;
    const std::uint64_t most = SequenceWindow::max_leap(1000, 1'000'000);
    ASSERT_EQ(w.accept(500, most), DropCause::kNone);
    w.accept(501 ^ (1ull << bit), most);
    EXPECT_LE(w.newest(), 500 + most) << bit;
    EXPECT_EQ(w.accept(500 + 60'000, SequenceWindow::max_leap(1000, 60'000'000'000)), DropCause::kNone)
        << bit;
  }
}

TEST(SequenceWindow, RemembersAcrossLeapsOfEveryLength) {
  for (std::uint64_t leap = 1; leap <= 130; ++leap) {
    SequenceWindow w;
    EXPECT_EQ(w.accept(10, kFar), DropCause::kNone);
    EXPECT_EQ(w.accept(10 + leap, kFar), DropCause::kNone);
    EXPECT_EQ(w.accept(10, kFar), DropCause::kDuplicate) << leap;
    if (leap > 1 && leap <= 64) {
      EXPECT_EQ(w.accept(11, kFar), DropCause::kStale) << leap;
    }
  }
}

Reply reply_at(std::int64_t t1, std::int64_t t2, std::int64_t t3) {
  Reply r;
  r.command_send_time_ns = static_cast<std::uint64_t>(t1);
  r.server_time_ns = static_cast<std::uint64_t>(t3);
  r.hold_time_ns = static_cast<std::uint64_t>(t3 - t2);
  return r;
}

TEST(LinkStats, TakesTheHoldTimeOutAndFindsTheOffset) {
  // Server clock 1 s ahead, 3 ms up, 5 ms down, held 2 ms.
  LinkStats s;
  for (std::int64_t k = 0; k < 100; ++k) {
    const std::int64_t t1 = k * 1'000'000;
    const std::int64_t t2 = t1 + 3'000'000 + 1'000'000'000;
    ASSERT_TRUE(s.on_reply(reply_at(t1, t2, t2 + 2'000'000), t1 + 10'000'000));
  }
  EXPECT_EQ(s.rtt_min_ns(), 8'000'000);
  EXPECT_DOUBLE_EQ(s.rtt_ns(), 8e6);
  EXPECT_EQ(s.jitter_ns(), 0);
  // The asymmetry of 2 ms is seen as 1 ms of offset, within the stated error of half the round trip.
  EXPECT_DOUBLE_EQ(s.offset_ns(), 1e9 - 1e6);
  EXPECT_DOUBLE_EQ(s.offset_error_ns(), 4e6);
  EXPECT_LE(std::abs(s.offset_ns() - 1e9), s.offset_error_ns());
}

TEST(LinkStats, FollowsRfc6298AndRfc3550) {
  LinkStats s;
  // Round trips 100, 140, 100 us; all of the change on the way back.
  s.on_reply(reply_at(0, 50'000, 50'000), 100'000);
  EXPECT_DOUBLE_EQ(s.rtt_ns(), 100'000);
  EXPECT_DOUBLE_EQ(s.rtt_var_ns(), 50'000);
  s.on_reply(reply_at(1'000'000, 1'050'000, 1'050'000), 1'140'000);
  // RTTVAR = 3/4·50 + 1/4·|100 − 140| = 47.5; SRTT = 7/8·100 + 1/8·140 = 105; J = 40/16.
  EXPECT_DOUBLE_EQ(s.rtt_var_ns(), 47'500);
  EXPECT_DOUBLE_EQ(s.rtt_ns(), 105'000);
  EXPECT_DOUBLE_EQ(s.jitter_ns(), 2'500);
  s.on_reply(reply_at(2'000'000, 2'050'000, 2'050'000), 2'100'000);
  EXPECT_DOUBLE_EQ(s.jitter_ns(), 2'500 + (40'000 - 2'500) / 16.0);
  EXPECT_EQ(s.rtt_min_ns(), 100'000);
}

// Over a link of constant delay each spread halves until nothing is left of it. A number below the normal ones would stay for ever, and
// each sum with it would take a hundred cycles.
TEST(LinkStats, SpreadsOfAnEvenLinkEndAtZero) {
  for (const bool one_late : {false, true}) {
    LinkStats s;
    for (std::int64_t k = 0; k < 20'000; ++k) {
      const std::int64_t t1 = k * 1'000'000, back = one_late && k == 1 ? 9'000'000 : 8'000'000;
      ASSERT_TRUE(s.on_reply(reply_at(t1, t1 + 3'000'000, t1 + 3'000'000), t1 + back));
      for (const double spread_ns : {s.jitter_ns(), s.rtt_var_ns()})
        ASSERT_TRUE(spread_ns == 0 || std::isnormal(spread_ns)) << k << " " << spread_ns;
      if (k == 1'000) {
        EXPECT_EQ(s.jitter_ns() > 0, one_late);
        EXPECT_GT(s.rtt_var_ns(), 0);
      }
    }
    EXPECT_EQ(s.jitter_ns(), 0);
    EXPECT_LT(s.rtt_var_ns(), one_late ? 1e-6 : 1e-300);  // what is left is the rounding of the round trip
  }
}

TEST(LinkStats, TakesTheOffsetFromTheQuickestRoundTripOfTheLastSeconds) {
  LinkStats s;
  // Quick once (exact), then slow and lopsided; after 20 s the old one is forgotten.
  s.on_reply(reply_at(0, 10'000, 10'000), 20'000);
  EXPECT_EQ(s.offset_ns(), 0);
  const auto lopsided = [&](std::int64_t t1) {
    s.on_reply(reply_at(t1, t1 + 10'000, t1 + 10'000), t1 + 500'000);
  };
  for (std::int64_t k = 1; k < 1000; ++k) lopsided(k * 10'000'000);
  EXPECT_EQ(s.offset_ns(), 0);
  for (std::int64_t k = 1000; k < 2100; ++k) lopsided(k * 10'000'000);
  EXPECT_DOUBLE_EQ(s.offset_ns(), 0.5 * (10'000 - 490'000));
}

TEST(LinkStats, IgnoresImpossibleTimes) {
  LinkStats s;
  Reply r = reply_at(0, 10, 10);
  r.hold_time_ns = UINT64_MAX;
  EXPECT_FALSE(s.on_reply(r, 1000));
  r = reply_at(5000, 6000, 6000);  // answered before it was asked
  EXPECT_FALSE(s.on_reply(r, 1000));
  EXPECT_EQ(s.samples(), 0u);
  EXPECT_EQ(s.rejected(), 2u);
  r = reply_at(0, 10, 10);
  r.server_time_ns = UINT64_MAX;  // a clock near its end: only differences count
  EXPECT_TRUE(s.on_reply(r, 1000));
  EXPECT_EQ(s.rtt_last_ns(), 1000);
}

TEST(ReceivedEnergy, KeepsTheHighestUntilTheEpochEnds) {
  ReceivedEnergy e;
  e.update(3, 1);
  e.update(2, 2);
  EXPECT_EQ(e.in(), 3);
  EXPECT_EQ(e.out(), 2);
  e.reset();
  e.update(0.5, 0);
  EXPECT_EQ(e.in(), 0.5);
}

TEST(TokenBucket, AllowsABurstAndThenTheRate) {
  TokenBucket bucket(100, 10);
  int taken = 0;
  for (int i = 0; i < 100; ++i) taken += bucket.take(0) ? 1 : 0;
  EXPECT_EQ(taken, 10);
  for (std::int64_t ms = 1; ms <= 1000; ++ms) taken += bucket.take(ms * 1'000'000) ? 1 : 0;
  EXPECT_NEAR(taken, 110, 1);
}

}  // namespace
}  // namespace telenano::link

#include "telenano/common/net/impairment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>
#include <vector>

#include "telenano/common/net/delay_line.h"

namespace telenano::net {
namespace {

constexpr std::size_t kRoom = 1000;
constexpr std::int64_t kMs = 1'000'000;

/// What became of n datagrams of `size` bytes, one every `period_ns`.
std::vector<Fate> fates(const ImpairmentConfig& config, std::size_t n, std::int64_t period_ns,
                        std::uint64_t seed = 3, std::size_t size = 100) {
  Impairment impairment(config, seed);
  std::vector<Fate> all;
  for (std::size_t i = 0; i < n; ++i)
    all.push_back(impairment.send(size, static_cast<std::int64_t>(i) * period_ns, kRoom));
  return all;
}

TEST(Impairment, DelaysHaveTheQuantilesOfTheirDistributions) {
  // Quantiles in closed form: u; sqrt(2) erfinv(q), by tables; -ln(1 - q). The fraction of n draws below the
  // true quantile q has the standard deviation sqrt(q (1 - q) / n): five of them.
  struct Case {
    ImpairmentConfig::Jitter kind;
    double q[3];
  };
  const double at[3] = {0.5, 0.9, 0.99};
  const Case cases[] = {
      {ImpairmentConfig::Jitter::kUniform, {0.5, 0.9, 0.99}},
      {ImpairmentConfig::Jitter::kHalfNormal, {0.6744897502, 1.6448536270, 2.5758293035}},
      {ImpairmentConfig::Jitter::kExponential, {std::log(2.0), std::log(10.0), std::log(100.0)}}};
  constexpr std::size_t kN = 100'000;
  for (const Case& c : cases) {
    ImpairmentConfig config;
    config.delay_ns = 7 * kMs;
    config.jitter_ns = 2 * kMs;
    config.jitter = c.kind;
    config.in_order = false;
    const auto all = fates(config, kN, kMs);
    for (int k = 0; k < 3; ++k) {
      std::size_t below = 0;
      for (std::size_t i = 0; i < kN; ++i) {
        const std::int64_t delay_ns = all[i].copies[0].arrival_ns - static_cast<std::int64_t>(i) * kMs;
        ASSERT_GE(delay_ns, 7 * kMs);
        below += static_cast<double>(delay_ns - 7 * kMs) < c.q[k] * 2e6 ? 1 : 0;
      }
      EXPECT_NEAR(static_cast<double>(below) / kN, at[k], 5 * std::sqrt(at[k] * (1 - at[k]) / kN));
    }
  }
}

TEST(Impairment, BurstsInTimeLastAsLongWhateverIsSent) {
  // A two-state chain in continuous time, looked at every dt: the share lost is p; a run that is seen goes on
  // from one look to the next with probability stay = p + (1 - p) exp(-dt / (b (1 - p))), so that its mean
  // length is 1 / (1 - stay) looks. That tends to b / dt for short dt, and to 1 / (1 - p) for long ones.
  constexpr double kLoss = 0.1;
  constexpr double kBurst_ms = 30;
  for (const double dt_ms : {0.25, 1.0, 30.0, 1000.0}) {
    ImpairmentConfig config;
    config.loss = kLoss;
    config.burst_ns = static_cast<std::int64_t>(kBurst_ms * 1e6);
    constexpr std::size_t kN = 2'000'000;
    const auto dt_ns = static_cast<std::int64_t>(dt_ms * 1e6);
    Impairment impairment(config, 5);
    std::size_t lost = 0, runs = 0;
    bool before = false;
    for (std::size_t i = 0; i < kN; ++i) {
      const bool gone = impairment.send(100, static_cast<std::int64_t>(i) * dt_ns, kRoom).n == 0;
      lost += gone ? 1 : 0;
      runs += gone && !before ? 1 : 0;
      before = gone;
    }
    const double stay = kLoss + (1 - kLoss) * std::exp(-dt_ms / (kBurst_ms * (1 - kLoss)));
    const double mean_looks = 1 / (1 - stay);
    // Runs are geometric: the relative deviation of their mean over `runs` is below 1 / sqrt(runs), that of
    // the share lost below sqrt(2 / runs). Five of them; the fewest runs, about 1700, allow 12 % and 17 %.
    const double runs_f = static_cast<double>(runs);
    ASSERT_GT(runs, 1000u);
    EXPECT_NEAR(static_cast<double>(lost) / runs_f / mean_looks, 1, 5 / std::sqrt(runs_f)) << dt_ms;
    EXPECT_NEAR(static_cast<double>(lost) / kN / kLoss, 1, 5 * std::sqrt(2 / runs_f)) << dt_ms;
    EXPECT_EQ(impairment.counts.lost_chance, lost);
  }
}

TEST(Impairment, TheQueueBeforeASlowLinkByHand) {
  // 72 + 28 bytes at 800 kbit/s take 1 ms. Room for 350 bytes holds three of them and a half.
  ImpairmentConfig config;
  config.rate_bit_s = 800e3;
  config.queue_bytes = 350;
  config.delay_ns = 10 * kMs;
  Impairment link(config, 1);
  const auto arrival_ms = [&](double at_ms) {
    const Fate fate = link.send(72, static_cast<std::int64_t>(at_ms * 1e6), kRoom);
    return fate.n == 0 ? -1.0 : static_cast<double>(fate.copies[0].arrival_ns) / 1e6;
  };
  EXPECT_EQ(arrival_ms(0), 11);     // at once
  EXPECT_EQ(arrival_ms(0), 12);     // behind it
  EXPECT_EQ(arrival_ms(0), 13);     // 300 bytes wait
  EXPECT_EQ(arrival_ms(0), -1);     // 400 would
  EXPECT_EQ(arrival_ms(0.25), -1);  // 275 wait: 375 would
  EXPECT_EQ(arrival_ms(0.5), 14);   // 250 wait: 350 just fit
  EXPECT_EQ(arrival_ms(3.5), 15);   // 50 wait
  EXPECT_EQ(arrival_ms(20), 31);    // idle since 5 ms
  EXPECT_EQ(link.counts.lost_rate, 2u);
  EXPECT_EQ(link.counts.lost, 2u);

  // In the long run what leaves is the rate: 3 times too much is sent, a third of it arrives.
  config.delay_ns = 0;
  Impairment busy(config, 1);
  std::size_t arrived = 0;
  for (std::int64_t i = 0; i < 30'000; ++i) arrived += busy.send(72, i * kMs / 3, kRoom).n;
  EXPECT_NEAR(static_cast<double>(arrived), 10'000, 4);  // the queue's filling at the end
}

TEST(Impairment, OutagesAreWhereTheyWerePut) {
  ImpairmentConfig config;
  config.outages = {{5 * kMs, 2 * kMs}, {20 * kMs, 1}};
  const auto all = fates(config, 30, kMs);
  for (std::size_t i = 0; i < 30; ++i) EXPECT_EQ(all[i].n, i == 5 || i == 6 || i == 20 ? 0u : 1u) << i;
}

TEST(Impairment, RandomOutagesTakeTheirShareAndDoNotDependOnTheTraffic) {
  ImpairmentConfig config;
  config.outage_gap_ns = 900 * kMs;
  config.outage_length_ns = 100 * kMs;
  const auto dense = fates(config, 2'000'000, kMs);
  std::size_t lost = 0, runs = 0;
  for (std::size_t i = 0; i < dense.size(); ++i) {
    lost += dense[i].n == 0 ? 1 : 0;
    runs += dense[i].n == 0 && (i == 0 || dense[i - 1].n > 0) ? 1 : 0;
  }
  // 100 of 1000 ms; about 2000 outages, each of exponential length: 5 sqrt(2 / 2000) = 16 %. One in 100 is
  // shorter than the period and may not be seen.
  EXPECT_NEAR(static_cast<double>(lost) / 2e6, 0.1, 0.016);
  EXPECT_NEAR(static_cast<double>(runs), 2000, 5 * std::sqrt(2000.0) + 20);
  config.loss = 0.5;  // draws more numbers: the outages stay
  const auto sparse = fates(config, 200'000, 10 * kMs);
  for (std::size_t i = 0; i < sparse.size(); ++i) {
    if (dense[10 * i].n == 0) {
      EXPECT_EQ(sparse[i].n, 0u) << i;
    }
  }
}

TEST(Impairment, ATraceIsReplayedAndBeginsAgain) {
  ImpairmentConfig config;
  config.delay_ns = kMs;
  config.trace = {
      {0, 5 * kMs, false}, {10 * kMs, 20 * kMs, false}, {20 * kMs, 0, true}, {25 * kMs, 7 * kMs, false}};
  config.in_order = false;
  Impairment impairment(config, 1);
  const std::pair<std::int64_t, std::int64_t> expected[] = {
      {0, 6},  {9, 6},   {10, 21}, {19, 21}, {20, -1}, {24, -1},
      {25, 8}, {29, 8},  // the last row holds as long as the one before it, 5 ms
      {30, 6}, {40, 21}, {50, -1}, {55, 8},  {60, 6},  {3'000'000'000, 6}};
  for (const auto& [at_ms, delay_ms] : expected) {
    const Fate fate = impairment.send(10, at_ms * kMs, kRoom);
    EXPECT_EQ(fate.n == 0 ? -1 : fate.copies[0].arrival_ns / kMs - at_ms, delay_ms) << at_ms;
  }
  EXPECT_EQ(impairment.counts.lost_trace, 3u);
}

TEST(Impairment, CutsAndCorruptsAsOftenAndAsMuchAsAsked) {
  ImpairmentConfig config;
  config.corrupt = 0.3;
  config.truncate = 0.2;
  constexpr double kN = 100'000;
  double bytes_left = 0, cut = 0, corrupted = 0;
  std::vector<double> bits(800);
  for (const Fate& fate : fates(config, static_cast<std::size_t>(kN), kMs)) {
    const Fate::Copy& copy = fate.copies[0];
    ASSERT_LE(copy.size, 100u);
    if (copy.size < 100) {
      ++cut;
      bytes_left += static_cast<double>(copy.size);
    }
    if (!copy.corrupted) continue;
    ++corrupted;
    ASSERT_LT(copy.byte, copy.size);
    ASSERT_EQ(std::popcount(copy.mask), 1);
    if (copy.size == 100) bits[copy.byte * 8 + static_cast<std::size_t>(std::countr_zero(copy.mask))] += 1;
  }
  EXPECT_NEAR(cut, 0.2 * kN, 5 * std::sqrt(kN * 0.16));
  // Uniform on 0 … 99: mean 49.5, deviation 100 / sqrt(12). Nothing to corrupt in one of a hundred cut ones.
  EXPECT_NEAR(bytes_left / cut, 49.5, 5 * 28.9 / std::sqrt(cut));
  EXPECT_NEAR(corrupted, 0.3 * kN * (1 - 0.2 / 100), 5 * std::sqrt(kN * 0.21));
  // Every bit of a whole datagram equally often: 0.8 * 0.3 * n / 800 = 30 each, chi² with 799 degrees of
  // freedom within five of its deviations sqrt(2 * 799).
  double chi2 = 0;
  for (const double n : bits) chi2 += (n - 30) * (n - 30) / 30;
  EXPECT_NEAR(chi2, 799, 5 * std::sqrt(2 * 799.0));
}

TEST(Impairment, ADriftingClockStretchesTheDelay) {
  ImpairmentConfig config;
  config.delay_ns = kMs;
  config.drift_ppm = 50;
  Impairment slow(config, 1);
  EXPECT_EQ(slow.send(1, 0, kRoom).copies[0].arrival_ns, kMs);
  EXPECT_EQ(slow.send(1, 1'000'000'000, kRoom).copies[0].arrival_ns, 1'000'000'000 + kMs + 50'000);
  config.drift_ppm = -50;
  Impairment fast(config, 1);
  EXPECT_EQ(fast.send(1, 10'000'000'000, kRoom).copies[0].arrival_ns, 10'000'000'000 + kMs - 500'000);
  EXPECT_EQ(fast.send(1, 100'000'000'000, kRoom).copies[0].arrival_ns,
            100'000'000'000);  // not before it is sent
}

TEST(Impairment, SameSeedSameFates) {
  ImpairmentConfig config;
  config.jitter_ns = kMs;
  config.loss = 0.2;
  config.burst_ns = 3 * kMs;
  config.duplicate = config.reorder = config.corrupt = config.truncate = 0.2;
  config.rate_bit_s = 1e6;
  config.queue_bytes = 1000;
  config.outage_gap_ns = 50 * kMs;
  config.outage_length_ns = 5 * kMs;
  const auto flat = [&](std::uint64_t seed) {
    std::vector<std::int64_t> numbers;
    for (const Fate& fate : fates(config, 5000, kMs, seed)) {
      numbers.push_back(static_cast<std::int64_t>(fate.n));
      for (std::size_t i = 0; i < fate.n; ++i) {
        const Fate::Copy& c = fate.copies[i];
        numbers.insert(numbers.end(), {c.arrival_ns, static_cast<std::int64_t>(c.size),
                                       static_cast<std::int64_t>(c.byte), c.mask});
      }
    }
    return numbers;
  };
  EXPECT_EQ(flat(8), flat(8));
  EXPECT_NE(flat(8), flat(9));
}

TEST(Impairment, CountsAddUp) {
  ImpairmentConfig config;
  config.loss = 0.2;
  config.duplicate = 0.3;
  config.rate_bit_s = 1e6;
  config.queue_bytes = 1000;
  config.outages = {{100 * kMs, 50 * kMs}};
  Impairment impairment(config, 2);
  std::uint64_t copies = 0;
  for (std::int64_t i = 0; i < 10'000; ++i)
    copies += impairment.send(100, i * kMs, i % 100 == 0 ? 0 : kRoom).n;
  const ImpairmentCounts& c = impairment.counts;
  EXPECT_EQ(c.sent, 10'000u);
  EXPECT_EQ(c.lost, c.lost_chance + c.lost_outage + c.lost_trace + c.lost_rate + c.lost_room);
  EXPECT_EQ(c.lost_outage, 50u);
  EXPECT_GT(c.lost_room, 0u);
  EXPECT_GT(c.lost_rate, 0u);
  EXPECT_EQ(copies, c.sent + c.duplicated - c.lost);
}

TEST(DelayLine, GivesOutByTimeThenByOrderAndKeepsWhatItWasTold) {
  DelayLine line(3, 4);
  const std::vector<std::uint8_t> bytes = {1, 2, 3, 4, 5, 6};
  line.put(bytes, {.arrival_ns = 20, .size = 6}, 7);
  line.put(bytes, {.arrival_ns = 10, .size = 3, .corrupted = true, .byte = 2, .mask = 0x80}, 8);
  line.put(bytes, {.arrival_ns = 20, .size = 0}, 9);
  EXPECT_EQ(line.room(), 0u);
  EXPECT_EQ(line.next_arrival_ns(), 10);
  EXPECT_EQ(line.front().tag, 8u);
  EXPECT_EQ(std::vector<std::uint8_t>(line.front().bytes.begin(), line.front().bytes.end()),
            (std::vector<std::uint8_t>{1, 2, 0x83}));
  line.pop();
  EXPECT_EQ(line.front().tag, 7u);
  EXPECT_EQ(line.front().size, 6u);
  EXPECT_EQ(line.front().bytes.size(), 4u);
  line.pop();
  EXPECT_EQ(line.front().tag, 9u);
  EXPECT_EQ(line.front().size, 0u);
  line.pop();
  EXPECT_TRUE(line.empty());
  EXPECT_EQ(line.next_arrival_ns(), INT64_MAX);
  EXPECT_EQ(line.room(), 3u);
}

// Whatever overtakes whatever, with puts and pops mixed: as a stable sort of what is on the way would.
TEST(DelayLine, AgreesWithAStableSort) {
  for (const std::int64_t spread : {1, 20, 1000}) {
    constexpr std::size_t kCapacity = 50;
    DelayLine line(kCapacity, 8);
    std::vector<std::pair<std::int64_t, std::uint64_t>> waiting;  // arrival, tag, in the order of sending
    Random random(9);
    std::uint64_t tag = 0;
    for (int k = 0; k < 20'000; ++k) {
      if (waiting.size() < kCapacity && random.chance(0.51)) {
        const std::int64_t arrival_ns = k / 4 + static_cast<std::int64_t>(random.below(spread));
        line.put({}, {.arrival_ns = arrival_ns, .size = 0}, ++tag);
        waiting.emplace_back(arrival_ns, tag);
      } else if (!waiting.empty()) {
        const auto first = std::min_element(waiting.begin(), waiting.end(),
                                            [](const auto& a, const auto& b) { return a.first < b.first; });
        ASSERT_EQ(line.next_arrival_ns(), first->first) << spread << ' ' << k;
        ASSERT_EQ(line.front().tag, first->second) << spread << ' ' << k;
        line.pop();
        waiting.erase(first);
      }
      ASSERT_EQ(line.room(), kCapacity - waiting.size());
      ASSERT_EQ(line.empty(), waiting.empty());
    }
    EXPECT_GT(tag, 9'000u);
  }
}

}  // namespace
}  // namespace telenano::net

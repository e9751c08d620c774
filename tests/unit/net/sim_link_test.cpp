#include "telenano/common/net/sim_link.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <vector>

namespace telenano::net {
namespace {

struct Arrival {
  std::uint32_t number;
  std::int64_t at_ns;
};

/// Sends n numbered datagrams, one a millisecond, and notes what arrives when.
std::vector<Arrival> run(SimLink& link, std::uint32_t n) {
  std::vector<Arrival> arrivals;
  std::array<std::uint8_t, 512> buffer{};
  Received received;
  const auto drain = [&](std::int64_t to_ns) {
    while (link.next_arrival_ns() <= to_ns) {
      link.advance_to(link.next_arrival_ns());
      while (link.b().receive(buffer, received)) {
        EXPECT_EQ(received.size, 4u);
        EXPECT_EQ(received.from, link.address_a());
        std::uint32_t number = 0;
        std::memcpy(&number, buffer.data(), 4);
        arrivals.push_back({number, link.now_ns()});
      }
    }
    link.advance_to(to_ns);
  };
  for (std::uint32_t i = 0; i < n; ++i) {
    drain(i * std::int64_t{1'000'000});
    std::array<std::uint8_t, 4> bytes{};
    std::memcpy(bytes.data(), &i, 4);
    link.a().send(bytes, link.address_b());
  }
  drain(INT64_MAX - 1);
  return arrivals;
}

TEST(SimLink, DelaysExactlyAndInOrder) {
  SimPath path;
  path.delay_ns = 12'345'678;
  SimLink link(path, {}, 1);
  const auto arrivals = run(link, 1000);
  ASSERT_EQ(arrivals.size(), 1000u);
  for (std::uint32_t i = 0; i < 1000; ++i) {
    EXPECT_EQ(arrivals[i].number, i);
    EXPECT_EQ(arrivals[i].at_ns, i * std::int64_t{1'000'000} + path.delay_ns);
  }
}

TEST(SimLink, NothingArrivesEarlyAndDirectionsAreApart) {
  SimPath slow;
  slow.delay_ns = 10;
  SimLink link(slow, {}, 1);
  const std::array<std::uint8_t, 3> bytes = {1, 2, 3};
  std::array<std::uint8_t, 512> buffer{};
  Received received;
  link.a().send(bytes, {});
  link.b().send(bytes, {});
  EXPECT_TRUE(link.a().receive(buffer, received));
  EXPECT_EQ(received.from, link.address_b());
  link.advance_to(9);
  EXPECT_FALSE(link.b().receive(buffer, received));
  link.advance_to(10);
  EXPECT_TRUE(link.b().receive(buffer, received));
  EXPECT_FALSE(link.b().receive(buffer, received));
}

TEST(SimLink, LosesAndDuplicatesAsOftenAsAsked) {
  SimPath path;
  path.loss = 0.2;
  path.duplicate = 0.1;
  SimLink link(path, {}, 7);
  constexpr double kN = 100'000;
  const auto arrivals = run(link, static_cast<std::uint32_t>(kN));
  const SimCounts& c = link.counts_a_to_b();
  // Five standard deviations of the binomial counts.
  EXPECT_NEAR(static_cast<double>(c.lost), 0.2 * kN, 5 * std::sqrt(kN * 0.16));
  EXPECT_NEAR(static_cast<double>(c.duplicated), 0.08 * kN, 5 * std::sqrt(kN * 0.08));
  EXPECT_EQ(arrivals.size(), c.delivered);
  EXPECT_EQ(c.delivered, c.sent - c.lost + c.duplicated);
}

TEST(SimLink, LosesInBurstsOfTheMeanLength) {
  SimPath path;
  path.loss = 0.1;
  path.burst_datagrams = 20;
  SimLink link(path, {}, 7);
  const auto arrivals = run(link, 400'000);
  std::uint64_t bursts = 0;
  std::uint64_t lost = 0;
  for (std::size_t i = 1; i < arrivals.size(); ++i) {
    const std::uint32_t gap = arrivals[i].number - arrivals[i - 1].number - 1;
    bursts += gap > 0 ? 1 : 0;
    lost += gap;
  }
  // About 2000 bursts with exponential-like lengths: a relative error of 1/sqrt(2000) = 2.2 %, five of them.
  EXPECT_NEAR(static_cast<double>(lost) / static_cast<double>(bursts), 20, 20 * 0.11);
  EXPECT_NEAR(static_cast<double>(lost), 40'000, 40'000 * 0.17);
}

TEST(SimLink, ReordersOnlyWhenAsked) {
  const auto inversions = [](const std::vector<Arrival>& arrivals) {
    int n = 0;
    for (std::size_t i = 1; i < arrivals.size(); ++i)
      n += arrivals[i].number < arrivals[i - 1].number ? 1 : 0;
    return n;
  };
  SimPath path;
  path.delay_ns = 5'000'000;
  path.jitter_ns = 5'000'000;
  for (const auto jitter :
       {SimPath::Jitter::kUniform, SimPath::Jitter::kHalfNormal, SimPath::Jitter::kExponential}) {
    path.jitter = jitter;
    path.in_order = true;
    SimLink queue(path, {}, 5);
    EXPECT_EQ(inversions(run(queue, 10'000)), 0);
    path.in_order = false;
    SimLink mixed(path, {}, 5);
    EXPECT_GT(inversions(run(mixed, 10'000)), 1000);
  }
  SimPath held;
  held.reorder = 0.1;
  held.reorder_ns = 2'500'000;
  SimLink some(held, {}, 5);
  EXPECT_NEAR(inversions(run(some, 10'000)), 1000, 5 * std::sqrt(10'000 * 0.09));
}

TEST(SimLink, JitterHasItsMean) {
  SimPath path;
  path.in_order = false;
  path.jitter_ns = 1'000'000;
  // Means 1/2, sqrt(2/pi), 1 of the scale; 20 000 draws give 5 sigma below 4 % of it.
  const std::pair<SimPath::Jitter, double> cases[] = {
      {SimPath::Jitter::kUniform, 0.5},
      {SimPath::Jitter::kHalfNormal, std::sqrt(2 / 3.14159265358979)},
      {SimPath::Jitter::kExponential, 1.0}};
  for (const auto& [kind, mean] : cases) {
    path.jitter = kind;
    SimLink link(path, {}, 11);
    double sum = 0;
    for (const Arrival& a : run(link, 20'000)) sum += static_cast<double>(a.at_ns) - a.number * 1e6;
    EXPECT_NEAR(sum / 20'000 / 1e6, mean, 0.04);
  }
}

TEST(SimLink, IsDownWhenDownAndCountsAFullQueueAsLoss) {
  SimPath path;
  path.down = true;
  SimLink link(path, {}, 1);
  EXPECT_TRUE(run(link, 100).empty());
  SimPath slow;
  slow.delay_ns = 1'000'000'000'000;
  SimLink small(slow, {}, 1, 10);
  EXPECT_EQ(run(small, 100).size(), 10u);
  EXPECT_EQ(small.counts_a_to_b().lost, 90u);
}

TEST(SimLink, SameSeedSameArrivals) {
  SimPath bad;
  bad.delay_ns = 3'000'000;
  bad.jitter_ns = 4'000'000;
  bad.in_order = false;
  bad.loss = 0.1;
  bad.duplicate = 0.1;
  bad.reorder = 0.1;
  SimLink a(bad, {}, 9);
  SimLink b(bad, {}, 9);
  SimLink c(bad, {}, 10);
  const auto x = run(a, 2000);
  const auto y = run(b, 2000);
  const auto z = run(c, 2000);
  ASSERT_EQ(x.size(), y.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    EXPECT_EQ(x[i].number, y[i].number);
    EXPECT_EQ(x[i].at_ns, y[i].at_ns);
  }
  EXPECT_NE(x.size() == z.size() &&
                std::equal(x.begin(), x.end(), z.begin(),
                           [](const Arrival& p, const Arrival& q) { return p.at_ns == q.at_ns; }),
            true);
}

TEST(SimLink, TellsTheSizeOfWhatWasCut) {
  SimLink link({}, {}, 1);
  const std::vector<std::uint8_t> big(2000, 7);
  link.a().send(big, {});
  std::array<std::uint8_t, 513> buffer{};
  Received received;
  ASSERT_TRUE(link.b().receive(buffer, received));
  EXPECT_EQ(received.size, 2000u);
}

}  // namespace
}  // namespace telenano::net

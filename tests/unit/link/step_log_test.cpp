// The log of steps: what is written is read, whatever comes is survived, and over any link every step is
// executed once and in order. The oracle is the list of steps that were made.
#include "telenano/common/link/step_log.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <random>
#include <vector>

namespace telenano::link {
namespace {

LoggedStep random_step(std::mt19937_64& random, const LoggedStep& last) {
  LoggedStep step = last;
  if (random() % 4 == 0) return step;  // at rest
  for (std::int64_t& t : step.target)
    t = std::clamp(t + static_cast<std::int64_t>(random() % 4001) - 2000, -kStepTargetMost, kStepTargetMost);
  if (random() % 50 == 0) step.target[0] = kStepTargetMost;
  if (random() % 5 == 0) step.dt_ns = 1'000'000 + static_cast<std::uint32_t>(random() % 100'000);
  step.flags = random() % 10 == 0 ? static_cast<std::uint32_t>(random() % 8) : step.flags;
  return step;
}

TEST(StepLog, WhatIsWrittenIsRead) {
  std::mt19937_64 random(1);
  LoggedStep last{{0, 0, 0}, 1'000'000, 3};
  for (int trial = 0; trial < 2000; ++trial) {
    std::array<std::uint8_t, kStepsBytesMost> bytes;
    const std::uint64_t first = 1 + random() % 1000000;
    StepWriter writer(bytes, first);
    std::vector<LoggedStep> in;
    for (;;) {
      last = random_step(random, last);
      if (!writer.add(last)) break;
      in.push_back(last);
    }
    ASSERT_EQ(writer.count(), in.size());
    StepBatch batch;
    ASSERT_TRUE(read_steps(std::span(bytes).first(writer.size()), batch)) << trial;
    ASSERT_EQ(batch.first, first);
    ASSERT_EQ(batch.count, in.size());
    for (std::size_t i = 0; i < in.size(); ++i) ASSERT_EQ(batch.step[i], in[i]) << i;
  }
}

TEST(StepLog, RestCostsNextToNothing) {
  std::array<std::uint8_t, kStepsBytesMost> bytes;
  StepWriter writer(bytes, 1);
  const LoggedStep rest{{163840, -5, 7}, 1'000'000, 3};
  for (int i = 0; i < 64; ++i) ASSERT_TRUE(writer.add(rest));
  EXPECT_LE(writer.size(), kStepsHeaderBytes + 3 * 4 + 8 + 8);
}

TEST(StepLog, AnyBytesAreSurvived) {
  std::mt19937_64 random(2);
  std::array<std::uint8_t, kStepsBytesMost + 8> bytes{};
  StepBatch batch;
  int good = 0;
  for (int trial = 0; trial < 200000; ++trial) {
    const std::size_t size = random() % bytes.size();
    for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(random());
    for (int i = 1; i < 8; ++i) bytes[static_cast<std::size_t>(i)] = 0;
    if (size > 8) bytes[8] = static_cast<std::uint8_t>(random() % 6);
    if (!read_steps(std::span<const std::uint8_t>(bytes).first(size), batch)) {
      ASSERT_EQ(batch.count, 0u);
      continue;
    }
    ++good;
    for (std::size_t i = 0; i < batch.count; ++i) {
      ASSERT_GE(batch.step[i].dt_ns, kStepShortestNs);
      ASSERT_LE(batch.step[i].dt_ns, kStepLongestNs);
      for (const std::int64_t t : batch.step[i].target) ASSERT_LE(std::abs(t), kStepTargetMost);
    }
  }
  std::printf("%d of 200000 random strings were steps\n", good);
}

TEST(StepLog, EveryStepOnceAndInOrderOverABadLink) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    std::mt19937_64 random(seed);
    StepSender sender(4000);
    StepReceiver receiver(4000);
    sender.begin(0, false);
    struct Up {
      std::int64_t at_ns;
      std::vector<std::uint8_t> bytes;
      std::uint32_t hold;
    };
    struct Down {
      std::int64_t at_ns;
      StepReport report;
    };
    std::vector<Up> up;
    std::vector<Down> down;
    std::vector<LoggedStep> made, executed;
    LoggedStep last{{0, 0, 0}, 1'000'000, 3};
    std::array<std::uint8_t, kStepsBytesMost> bytes;
    const std::int64_t delay_ns = 60'000'000;
    const double loss = 0.15;
    const auto lost = [&] { return std::uniform_real_distribution<>(0, 1)(random) < loss; };
    for (int tick = 1; tick <= 20000; ++tick) {
      const std::int64_t now_ns = tick * std::int64_t{1'000'000};
      if (tick <= 19000) {
        last = random_step(random, last);
        last.dt_ns = 1'000'000;
        // A shared tip comes and goes: steps of one datagram are all of one holding.
        if (random() % (seed <= 2 ? 700 : 150) == 0) last.hold = static_cast<std::uint32_t>(random() % 9);
        sender.add(last);
        made.push_back(last);
      }
      if (tick % 10 == 0 || sender.urgent(now_ns, 200'000'000)) {
        const std::size_t n = sender.write(bytes, now_ns, 200'000'000);
        for (int copy = 0; copy < (random() % 20 == 0 ? 2 : 1); ++copy) {
          if (n > 0 && !lost())
            up.push_back({now_ns + delay_ns + static_cast<std::int64_t>(random() % 20'000'000),
                          {bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n)},
                          sender.written_hold()});
        }
      }
      for (std::size_t i = 0; i < up.size();) {  // out of order
        if (up[i].at_ns > now_ns) {
          ++i;
          continue;
        }
        StepBatch batch;
        ASSERT_TRUE(read_steps(up[i].bytes, batch));
        receiver.take(batch, now_ns, up[i].hold);
        up.erase(up.begin() + static_cast<std::ptrdiff_t>(i));
        LoggedStep step;
        while (receiver.pop(now_ns, step)) executed.push_back(step);
        if (!lost()) down.push_back({now_ns + delay_ns, receiver.report()});
      }
      for (std::size_t i = 0; i < down.size();) {
        if (down[i].at_ns > now_ns) {
          ++i;
          continue;
        }
        sender.on_report(down[i].report, now_ns, 2 * delay_ns + 10'000'000);
        down.erase(down.begin() + static_cast<std::ptrdiff_t>(i));
      }
    }
    ASSERT_EQ(executed.size(), made.size()) << "seed " << seed;
    EXPECT_TRUE(executed == made) << "seed " << seed;
    EXPECT_EQ(sender.open(), 0u);
    EXPECT_EQ(receiver.report().breaks, 0u);
  }
}

TEST(StepLog, TheSumOfStepsIsBoundedByTheWallAndNothingIsLeftOut) {
  StepReceiver receiver(64);
  std::uint64_t next = 1;
  std::uint64_t executed = 0;
  LoggedStep step;
  // Steps of 100 ms as fast as they go: ten times the wall's time.
  for (int tick = 0; tick < 10000; ++tick) {
    const std::int64_t now_ns = tick * std::int64_t{10'000'000};
    StepBatch batch;
    batch.first = next;
    batch.count = 1;
    batch.step[0] = {{static_cast<std::int64_t>(next), 0, 0}, kStepLongestNs, 3};
    receiver.take(batch, now_ns);
    while (receiver.pop(now_ns, step)) {
      ++executed;
      ASSERT_EQ(step.target[0], static_cast<std::int64_t>(executed)) << "postponed, never left out";
    }
    if (next < receiver.executed() + 60) ++next;
  }
  // 100 s of wall, filled 1.001 times as fast, and the bucket of 5 s.
  EXPECT_TRUE(receiver.ahead());
  EXPECT_LE(static_cast<double>(executed) * 0.1, 100 * 1.001 + 5.001);
  EXPECT_GE(static_cast<double>(executed) * 0.1, 100);
}

TEST(StepLog, ASkipGoesToTheNewestAndIsDeclared) {
  StepReceiver receiver(64);
  StepBatch batch;
  batch.first = 5;
  batch.count = 3;
  for (std::size_t i = 0; i < 3; ++i)
    batch.step[i] = {{static_cast<std::int64_t>(5 + i), 0, 0}, 1'000'000, 0};
  receiver.take(batch, 1);
  LoggedStep step;
  EXPECT_FALSE(receiver.pop(1, step));
  EXPECT_TRUE(receiver.gap());
  receiver.skip_to_newest(kBreakGap);
  ASSERT_TRUE(receiver.pop(2, step));
  EXPECT_EQ(step.target[0], 7);
  EXPECT_FALSE(receiver.pop(3, step));
  EXPECT_EQ(receiver.report(), (StepReport{7, 0, 7, 1, kBreakGap, 7}));
}

TEST(StepLog, EndlessGapsTakeNoMoreThanTheRing) {
  StepReceiver receiver(64);
  std::mt19937_64 random(3);
  LoggedStep step;
  for (int i = 0; i < 100000; ++i) {
    StepBatch batch;
    batch.first = 2 + random() % (UINT64_MAX / 4);
    batch.count = 1 + random() % kMaxBatch;
    for (LoggedStep& s : batch.step) s.dt_ns = 1'000'000;
    receiver.take(batch, i);
    receiver.pop(i, step);
    ASSERT_LE(receiver.newest(), receiver.executed() + 64);
  }
}

/// A station that has sent 300 steps, of which 11 to 20 did not come, and what it sends until `until_ns`: the first step of each
/// datagram that begins below 200. Each 5 ms a report says the same.
std::vector<std::uint64_t> sent_again(StepSender& sender, std::int64_t until_ns, std::int64_t rtt_ns) {
  sender.begin(0, false);
  std::array<std::uint8_t, kStepsBytesMost> bytes;
  for (int i = 0; i < 300; ++i) sender.add({{i, 2 * i, 3 * i}, 1'000'000, 3, 0});
  while (sender.urgent(1, 1'000'000'000)) sender.write(bytes, 1, 1'000'000'000);
  std::vector<std::uint64_t> firsts;
  for (std::int64_t now_ns = rtt_ns + 1'000'000; now_ns < until_ns; now_ns += 1'000'000) {
    if (now_ns % 5'000'000 == 0) sender.on_report({10, 0, 300, 0, 0, 0}, now_ns, rtt_ns);
    if (!sender.urgent(now_ns, 1'000'000'000)) continue;
    StepBatch batch;
    const std::size_t n = sender.write(bytes, now_ns, 1'000'000'000);
    if (n > 0 && read_steps(std::span(bytes).first(n), batch)) firsts.push_back(batch.first);
  }
  return firsts;
}

TEST(StepLog, TheBeginningOfAGapIsSentFourTimesARoundTripAndAllOfItOnce) {
  StepSender sender(4000);
  const std::vector<std::uint64_t> firsts = sent_again(sender, 395'000'000, 200'000'000);
  EXPECT_EQ(std::count(firsts.begin(), firsts.end(), 11u), 4);
  std::size_t whole = 0;  // datagrams of the pass that goes on behind the gap's beginning
  for (const std::uint64_t first : firsts) whole += first > 11 && first < 300;
  EXPECT_GE(whole, 4u);
  EXPECT_LE(whole, 10u) << "290 steps, once";
}

TEST(StepLog, WhatIsRepeatedGrowsWithAGapAndIsForgottenInQuiet) {
  StepSender sender(4000);
  sender.begin(0, false);
  std::array<std::uint8_t, kStepsBytesMost> bytes;
  std::uint64_t number = 0;
  std::int64_t now_ns = 0;
  // Steps a datagram repeats, when each brings one new one and the one before was new as well.
  const auto repeated = [&] {
    StepBatch batch;
    for (int k = 0; k < 80; ++k) {
      now_ns += 1'000'000;
      sender.add({{0, 0, 0}, 1'000'000, 3, 0});
      ++number;
      const std::size_t n = sender.write(bytes, now_ns, 1'000'000'000'000);
      EXPECT_TRUE(read_steps(std::span(bytes).first(n), batch));
    }
    EXPECT_EQ(batch.first + batch.count - 1, number) << "the newest is in it";
    return batch.count - 1;
  };
  const auto gap = [&] {
    now_ns += 200'000'000;
    sender.on_report({number - 60, 0, number, 0, 0, 0}, now_ns, 100'000'000);
    for (int k = 0; k < 3; ++k) sender.write(bytes, now_ns, 1'000'000'000'000);
    sender.on_report({number, 0, number, 0, 0, 0}, now_ns, 100'000'000);
  };
  EXPECT_EQ(repeated(), StepSender::kRepeated);
  for (int k = 0; k < 2; ++k) {
    gap();
    EXPECT_EQ(repeated(), StepSender::kRepeatedMost);
  }
  now_ns += StepSender::kQuietNs;
  sender.on_report({number, 0, number, 0, 0, 0}, now_ns, 100'000'000);
  EXPECT_EQ(repeated(), StepSender::kRepeated);
}

// Of steps that need 26 bytes each a datagram holds eleven: repeating as many must not keep new ones out.
TEST(StepLog, WhatIsRepeatedDoesNotKeepOutWhatIsNew) {
  StepSender sender(4000);
  sender.begin(0, false);
  std::array<std::uint8_t, kStepsBytesMost> bytes;
  for (int i = 0; i < 400; ++i) {
    const std::int64_t far = (i % 2 == 0 ? 1 : -1) * (kStepTargetMost - i);
    sender.add({{far, -far, far}, i % 2 == 0 ? kStepShortestNs : kStepLongestNs, 3, 0});
    const std::size_t n = sender.write(bytes, 1'000'000 * (i + 1), 1'000'000'000'000);
    StepBatch batch;
    ASSERT_TRUE(read_steps(std::span(bytes).first(n), batch));
    ASSERT_EQ(batch.first + batch.count - 1, static_cast<std::uint64_t>(i + 1)) << "the newest is in it";
  }
}

// A stop's datagram holds steps of the newest holding, whatever of earlier ones is still to be sent again.
TEST(StepLog, AStopDoesNotWaitForStepsOfAnEarlierHolding) {
  StepSender sender(4000);
  sender.begin(0, false);
  LoggedStep step{{1, 2, 3}, 1'000'000, 3, 4};
  for (int i = 0; i < 300; ++i) sender.add(step);
  std::array<std::uint8_t, kStepsBytesMost> bytes;
  while (sender.urgent(1'000'000, 200'000'000)) ASSERT_GT(sender.write(bytes, 1'000'000, 200'000'000), 0u);
  step.hold = 9;
  step.flags = kFlagStop;
  sender.add(step);
  sender.on_report({10, 0, 250, 0, 0, 0}, 2'000'000, 0);  // 11 is missing: it all goes again
  const auto written = [&](bool newest) {
    StepBatch batch;
    const std::size_t n = sender.write(bytes, 3'000'000, 200'000'000, newest);
    EXPECT_TRUE(read_steps(std::span(bytes).first(n), batch));
    return batch;
  };
  EXPECT_EQ(written(false).first, 11u);
  EXPECT_EQ(sender.written_hold(), 4u);
  const StepBatch stop = written(true);
  EXPECT_EQ(sender.written_hold(), 9u);
  EXPECT_EQ(stop.first, 301u);
  EXPECT_EQ(stop.count, 1u);
  EXPECT_EQ(stop.step[0].flags, std::uint32_t{kFlagStop});
}

}  // namespace
}  // namespace telenano::link

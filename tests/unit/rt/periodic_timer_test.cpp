#include "telenano/common/rt/periodic_timer.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "telenano/common/rt/steady_clock.h"
#include "tests/support/alloc_guard.h"

namespace telenano::rt {
namespace {

TEST(TickSchedule, DeadlinesAreAbsoluteSoTheyDoNotDrift) {
  TickSchedule schedule(1000, 100);
  for (std::int64_t i = 0; i < 50; ++i) {
    ASSERT_EQ(schedule.due_ns(), 1000 + 100 * i);
    const Tick tick = schedule.take(schedule.due_ns() + 37);  // always 37 ns late
    EXPECT_EQ(tick.index, i);
    EXPECT_EQ(tick.lateness_ns, 37);
    EXPECT_EQ(tick.missed, 0);
  }
}

TEST(TickSchedule, SkipsWhatWasMissedAndHidesNoDelay) {
  TickSchedule schedule(0, 100);
  EXPECT_EQ(schedule.take(0).index, 0);
  // Tick 1 was due at 100 and starts at 420: ticks 1, 2 and 3 are missed and tick 4 runs.
  const Tick late = schedule.take(420);
  EXPECT_EQ(late.index, 4);
  EXPECT_EQ(late.deadline_ns, 400);
  EXPECT_EQ(late.missed, 3);
  EXPECT_EQ(late.lateness_ns, 320);
  EXPECT_EQ(schedule.due_ns(), 500) << "no burst: the next tick is a whole deadline later";
  // One period late to the nanosecond: the next deadline has come, so this one is missed.
  EXPECT_EQ(schedule.take(600).missed, 1);
  EXPECT_EQ(schedule.take(799).missed, 0);
}

TEST(PeriodicTimer, NeverWakesEarlyAndKeepsCount) {
  for (const std::int64_t spin_ns : {0, 60'000}) {
    PeriodicTimer timer({.period_ns = 1'000'000, .spin_ns = spin_ns});
    const std::int64_t start_ns = SteadyClock{}.now_ns();
    std::int64_t missed = 0;
    Tick tick;
    const support::AllocGuard guard;
    for (int i = 0; i < 100; ++i) {
      tick = timer.wait();
      missed += tick.missed;
      ASSERT_GE(tick.woke_ns, tick.deadline_ns);
      ASSERT_LT(tick.woke_ns, tick.deadline_ns + 1'000'000);
    }
    EXPECT_EQ(guard.allocations(), 0u);
    EXPECT_EQ(tick.index, 99 + missed);
    EXPECT_GE(SteadyClock{}.now_ns() - start_ns, 100'000'000 - 1'000'000);
    EXPECT_EQ(timer.stats().ticks, 100u);
    EXPECT_EQ(timer.stats().missed, static_cast<std::uint64_t>(missed));
    EXPECT_EQ(timer.stats().lateness.count(), 100u);
  }
}

TEST(PeriodicTimer, CountsAnOverrunOnceAndTheTicksItCost) {
  PeriodicTimer timer({.period_ns = 2'000'000});
  timer.wait();
  const PeriodicTimerStats before = timer.stats();
  std::this_thread::sleep_for(std::chrono::milliseconds(11));  // five deadlines pass
  const Tick tick = timer.wait();
  EXPECT_GE(tick.missed, 4);
  EXPECT_GE(tick.lateness_ns, 8'000'000);
  EXPECT_EQ(timer.stats().overruns - before.overruns, 1u);
  EXPECT_EQ(timer.stats().missed - before.missed, static_cast<std::uint64_t>(tick.missed));
}

TEST(PeriodicTimer, RestartForgivesAPause) {
  PeriodicTimer timer({.period_ns = 1'000'000});
  timer.wait();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  timer.restart();
  const PeriodicTimerStats before = timer.stats();
  const Tick tick = timer.wait();
  const PeriodicTimerStats after = timer.stats();
  EXPECT_EQ(tick.index, static_cast<std::int64_t>(after.missed - before.missed)) << "counted from 0 again";
  // On a machine that is busy this very tick may be late; the pause of 20 periods must not be counted either
  // way.
  EXPECT_LT(after.missed - before.missed, 20u);
  if (tick.missed == 0) {
    EXPECT_EQ(after.overruns, before.overruns);
  }
}

}  // namespace
}  // namespace telenano::rt

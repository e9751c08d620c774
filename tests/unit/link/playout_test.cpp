#include "telenano/common/link/playout.h"

#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "telenano/common/base/random.h"

namespace telenano::link {
namespace {

constexpr std::int64_t kTickNs = 1'000'000;

Reply reply_to(std::uint64_t sequence, std::int64_t sent_ns) {
  Reply r;
  r.sequence = r.command_sequence = sequence;
  r.command_send_time_ns = static_cast<std::uint64_t>(sent_ns);
  r.energy_in_aj = static_cast<double>(sequence);
  return r;
}

PlayoutConfig constant(std::int64_t delay_ns) {
  PlayoutConfig config;
  config.mode = PlayoutConfig::Mode::kConstant;
  config.delay_ns = delay_ns;
  return config;
}

/// A command in every tick, answered after a random time; what a controller then sees.
struct Exchange {
  struct Shown {
    std::uint64_t sequence;
    std::int64_t delay_ns;
    double energy;
  };
  std::vector<Shown> shown;
  std::uint64_t expected_late = 0;
  std::uint64_t arrived = 0;

  Exchange(Playout& playout, int ticks, std::int64_t least_ns, std::int64_t width_ns, double loss,
           std::int64_t tick_ns = kTickNs, std::int64_t phase_ns = 0) {
    Random random(42);
    std::multimap<std::int64_t, Reply> on_the_way;
    std::vector<std::int64_t> sent;
    for (int k = 0; k < ticks; ++k) {
      const std::int64_t now_ns = k * tick_ns + phase_ns;
      while (!on_the_way.empty() && on_the_way.begin()->first <= now_ns) {
        const auto& [came_ns, reply] = *on_the_way.begin();
        ++arrived;
        // The first tick at least D after the command is the one that shows it; by then it must be here.
        const std::int64_t due_ns =
            static_cast<std::int64_t>(reply.command_send_time_ns) + playout.delay_ns();
        const std::int64_t tick_of_due = (due_ns - phase_ns + tick_ns - 1) / tick_ns;
        if (k > tick_of_due) ++expected_late;
        playout.push(reply);
        on_the_way.erase(on_the_way.begin());
      }
      if (const Reply* const due = playout.due(now_ns)) {
        shown.push_back({due->sequence, now_ns - static_cast<std::int64_t>(due->command_send_time_ns),
                         due->energy_in_aj});
      }
      if (!random.chance(loss)) {
        const auto delay_ns =
            least_ns + static_cast<std::int64_t>(random.uniform() * static_cast<double>(width_ns));
        on_the_way.emplace(now_ns + delay_ns, reply_to(static_cast<std::uint64_t>(k + 1), now_ns));
      }
    }
  }
};

TEST(Playout, DelayIsConstantToATickForAllThatComeInTime) {
  Playout playout(constant(20'400'000));
  // 2 to 20 ms: replies overtake one another all the time, a fifth is lost.
  const Exchange run(playout, 20'000, 2'000'000, 18'000'000, 0.2);
  ASSERT_GT(run.shown.size(), 15'000u);
  EXPECT_EQ(run.expected_late, 0u);
  EXPECT_EQ(playout.counts().late, 0u);
  EXPECT_EQ(run.shown.size() + playout.waiting(), run.arrived) << "every one that came is shown, once";
  std::uint64_t last = 0;
  for (const auto& s : run.shown) {
    ASSERT_GT(s.sequence, last);
    ASSERT_GE(s.delay_ns, 20'400'000);
    ASSERT_LT(s.delay_ns, 20'400'000 + kTickNs);
    ASSERT_EQ(s.energy, static_cast<double>(s.sequence));
    last = s.sequence;
  }
}

TEST(Playout, LateOnesAreDroppedAndCounted) {
  Playout playout(constant(10'000'000));
  const Exchange run(playout, 20'000, 2'000'000, 18'000'000, 0.0);
  EXPECT_GT(run.expected_late, 10'000u);
  EXPECT_EQ(playout.counts().late, run.expected_late);
  for (const auto& s : run.shown) {
    ASSERT_GE(s.delay_ns, 10'000'000);
    ASSERT_LT(s.delay_ns, 10'000'000 + kTickNs);
  }
  EXPECT_EQ(run.shown.size() + playout.counts().late + playout.waiting(), run.arrived);
}

TEST(Playout, HoldsAtEveryRate) {
  for (const std::int64_t tick_ns : {10'000'000, 2'000'000, 250'000, 125'000}) {
    PlayoutConfig config = constant(30'000'000);
    config.rate_hz = 1e9 / static_cast<double>(tick_ns);
    Playout playout(config);
    const Exchange run(playout, 5'000, 5'000'000, 24'000'000, 0.1, tick_ns);
    for (const auto& s : run.shown) {
      ASSERT_GE(s.delay_ns, 30'000'000);
      ASSERT_LT(s.delay_ns, 30'000'000 + tick_ns);
    }
    EXPECT_EQ(playout.counts().overrun, 0u) << tick_ns;
    EXPECT_EQ(run.shown.size() + playout.waiting(), run.arrived);
  }
}

TEST(Playout, SafetyDoesNotWait) {
  for (const std::uint32_t fault : {std::uint32_t{kFaultNonFinite}, std::uint32_t{kFaultRetracted}}) {
    Playout playout(constant(50'000'000));
    for (std::uint64_t k = 1; k <= 5; ++k) playout.push(reply_to(k, static_cast<std::int64_t>(k) * kTickNs));
    EXPECT_EQ(playout.due(6 * kTickNs), nullptr);
    Reply urgent = reply_to(6, 6 * kTickNs);
    urgent.fault_bits = fault;
    playout.push(urgent);
    playout.push(reply_to(5, 5 * kTickNs));  // overtaken by it: must not come after
    const Reply* const shown = playout.due(7 * kTickNs);
    ASSERT_NE(shown, nullptr);
    EXPECT_EQ(shown->sequence, 6u);
    EXPECT_EQ(shown->fault_bits, fault);
    EXPECT_EQ(playout.waiting(), 0u) << "what was before it is gone";
    EXPECT_EQ(playout.counts().urgent, 1u);
    // Afterwards the delay is the same as before.
    playout.push(reply_to(7, 7 * kTickNs));
    EXPECT_EQ(playout.due(56 * kTickNs), nullptr);
    ASSERT_NE(playout.due(57 * kTickNs), nullptr);
  }
}

TEST(Playout, OtherFaultBitsOfTheNewestAreShownAtOnce) {
  Playout playout(constant(10'000'000));
  playout.push(reply_to(1, 0));
  Reply newest = reply_to(2, kTickNs);
  newest.fault_bits = kFaultForceLimit;
  playout.push(newest);
  const Reply* const shown = playout.due(10 * kTickNs);
  ASSERT_NE(shown, nullptr);
  EXPECT_EQ(shown->sequence, 1u);
  EXPECT_EQ(shown->fault_bits, std::uint32_t{kFaultForceLimit});
}

TEST(Playout, AFloodIsBoundedAndAnotherSessionBeginsAnew) {
  Playout playout(constant(10'000'000));  // room for 74
  for (std::uint64_t k = 1; k <= 200; ++k) playout.push(reply_to(k, 0));
  EXPECT_EQ(playout.waiting(), 74u);
  EXPECT_EQ(playout.counts().overrun, 126u);
  playout.clear();
  EXPECT_EQ(playout.due(kTickNs * 100), nullptr);
  playout.push(reply_to(1, 100 * kTickNs));
  ASSERT_NE(playout.due(110 * kTickNs), nullptr) << "its sequence counts from 1 again";
}

TEST(Playout, AdaptiveDelayFollowsTheLinkByBoundedSteps) {
  PlayoutConfig config = constant(5'000'000);
  config.mode = PlayoutConfig::Mode::kAdaptive;
  Playout playout(config);
  std::int64_t last_ns = playout.delay_ns();
  const auto look = [&](int from, int to, double srtt_ns, double rttvar_ns) {
    for (int k = from; k < to; ++k) {
      playout.set_link(srtt_ns, rttvar_ns);
      playout.due(k * kTickNs);
      const std::int64_t step_ns = playout.delay_ns() - last_ns;
      // No faster than 20 % of the time up and 1 % down: a controller sees a delay that hardly moves.
      ASSERT_LE(step_ns, kTickNs / 5 + 1);
      ASSERT_GE(step_ns, -kTickNs / 100 - 1);
      last_ns = playout.delay_ns();
    }
  };
  look(0, 1000, 40e6, 3e6);
  EXPECT_EQ(playout.delay_ns(), 40'000'000 + 4 * 3'000'000 + kTickNs);
  look(1000, 20'000, 10e6, 1e6);
  EXPECT_EQ(playout.delay_ns(), 15'000'000);
  look(20'000, 40'000, 1e12, 1e12);
  EXPECT_EQ(playout.delay_ns(), config.delay_max_ns);
}

}  // namespace
}  // namespace telenano::link

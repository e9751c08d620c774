#include "telenano/common/link/recent_commands.h"

#include <gtest/gtest.h>

namespace telenano::link {
namespace {

Command command_at(std::uint64_t sequence, std::uint64_t time_ns) {
  Command c;
  c.sequence = sequence;
  c.send_time_ns = time_ns;
  c.flags = kFlagClutch | kFlagDeadman;
  c.tip_pos_w_nm = {static_cast<double>(sequence), 0, 0};
  return c;
}

TEST(SentCommands, GivesTheNewestFirst) {
  SentCommands sent;
  RecentCommands out;
  sent.before(command_at(1, 100), 4, out);
  EXPECT_EQ(out.count, 0u);
  for (std::uint64_t k = 1; k <= 6; ++k) sent.add(command_at(k, 100 * k));
  sent.before(command_at(7, 700), 3, out);
  ASSERT_EQ(out.count, 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(out.record[i].age_ns, 100 * (i + 1));
    EXPECT_EQ(out.record[i].tip_pos_w_nm.x(), 6.0 - static_cast<double>(i));
  }
  sent.before(command_at(7, 700), 9, out);
  EXPECT_EQ(out.count, kMaxRecent);
}

TEST(SentCommands, LeavesOutWhatAnAgeCannotSayAndWhatAnotherMethodMeant) {
  SentCommands sent;
  RecentCommands out;
  sent.add(command_at(1, 0));
  sent.add(command_at(2, 5'000'000'000));
  sent.before(command_at(3, 5'001'000'000), 4, out);
  EXPECT_EQ(out.count, 1u) << "5 s do not fit 32 bits of ns";
  Command tank = command_at(3, 5'001'000'000);
  tank.control.method = kMethodTank;
  tank.control.energy_sent_j = 0.5;
  sent.before(tank, 4, out);
  EXPECT_EQ(out.count, 0u);
  sent.add(tank);
  Command next = tank;
  next.send_time_ns += 1000;
  sent.before(next, 4, out);
  ASSERT_EQ(out.count, 1u);
  EXPECT_EQ(out.record[0].energy, 0.5);
}

TEST(PlanSteps, PlaysTheMissedOldestFirstAndSharesTheTime) {
  RecentCommands recent;
  recent.count = 4;
  for (std::size_t i = 0; i < 4; ++i) {
    recent.record[i].age_ns = static_cast<std::uint32_t>(1'000'000 * (i + 1));
    recent.record[i].tip_pos_w_nm.x() = -static_cast<double>(i + 1);
  }
  MissedSteps plan;
  plan_steps(recent, 0, 1e-3, 1e-3, plan);
  EXPECT_EQ(plan.count, 0u);
  EXPECT_EQ(plan.last_spacing_s, 1e-3);
  // Two missed: 3 ms since the newest accepted.
  plan_steps(recent, 2, 3e-3, 1e-3, plan);
  ASSERT_EQ(plan.count, 2u);
  EXPECT_EQ(plan.step[0].command.tip_pos_w_nm.x(), -2);
  EXPECT_EQ(plan.step[1].command.tip_pos_w_nm.x(), -1);
  EXPECT_NEAR(plan.step[0].spacing_s, 1e-3, 1e-15);
  EXPECT_NEAR(plan.step[1].spacing_s, 1e-3, 1e-15);
  EXPECT_NEAR(plan.last_spacing_s, 1e-3, 1e-15);
  // Nine missed, four known: the oldest of them bridges the rest, and the sum is the time that passed.
  plan_steps(recent, 9, 10e-3, 1e-3, plan);
  ASSERT_EQ(plan.count, 4u);
  EXPECT_NEAR(plan.step[0].spacing_s, 6e-3, 1e-15);
  double sum_s = plan.last_spacing_s;
  for (std::size_t i = 0; i < plan.count; ++i) sum_s += plan.step[i].spacing_s;
  EXPECT_NEAR(sum_s, 10e-3, 1e-15);
  // Ages that do not fit between the two commands: a tick each, never nothing, never backwards.
  plan_steps(recent, 4, 1e-4, 2e-3, plan);
  EXPECT_EQ(plan.step[0].spacing_s, 2e-3);
  for (std::size_t i = 0; i < plan.count; ++i) EXPECT_GT(plan.step[i].spacing_s, 0);
}

}  // namespace
}  // namespace telenano::link

// The share of the server that a session has: what it asks for beyond is left to later commands, and nothing
// of the motion, the time or a stop is lost.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/step_log.h"
#include "telenano/nve_server/server/drain_order.h"
#include "virtual_session.h"

namespace telenano::server {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint64_t kNoLog = link::kKnownFeatures & ~std::uint64_t{link::kFeatureStepLog};

/// A unit of work a nanometre of way, one at least; as far as it may. Its state is a function of its steps.
class CostlySlave final : public slave::Slave {
 public:
  CostlySlave() {
    limits_.workspace_min_w_nm = {-1e4, -1e4, -1e4};
    limits_.workspace_max_w_nm = {1e4, 1e4, 1e4};
    limits_.coupling_stiffness_n_m = 1;
  }
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    ++steps;
    time_s += dt_s;
    output = {};
    double way_nm = 0;
    if (input.retract) {
      ++retracts;
      output.fault_bits |= link::kFaultRetracted;
    } else if (input.follow) {
      const Vec3 move = input.tip_target_pos_w_nm - at_w_nm;
      way_nm = move.norm();
      if (way_nm > input.work_most) {
        at_w_nm += move * (input.work_most / way_nm);
        way_nm = input.work_most;
        output.fault_bits |= link::kFaultShare;
      } else {
        at_w_nm = input.tip_target_pos_w_nm;
      }
    }
    output.commanded_pos_w_nm = output.tip_pos_w_nm = at_w_nm;
    output.work = static_cast<std::uint32_t>(std::max(1.0, way_nm));
    work += output.work;
    most_in_a_step = std::max<double>(most_in_a_step, output.work);
  }
  const slave::SlaveLimits& limits() const noexcept override { return limits_; }
  std::uint64_t state_hash() const noexcept override { return 1 + steps; }
  std::size_t snapshot_bytes_max() const noexcept override { return 16; }

  Vec3 at_w_nm = Vec3::Zero();
  double time_s = 0;
  double work = 0;
  double most_in_a_step = 0;
  std::uint64_t steps = 0;
  std::uint64_t retracts = 0;

 private:
  slave::SlaveLimits limits_;
};

/// Sessions of one server, each with a slave of its own, by hand-made datagrams.
struct Rig {
  explicit Rig(bool enforced = true) {
    ServerConfig config = test_config();
    config.work.enforced = enforced;
    bounds = config.work;
    ServedScene scene;
    scene.name = scene_name("costly");
    scene.make_slave = [this]() -> std::unique_ptr<slave::Slave> {
      auto slave = std::make_unique<CostlySlave>();
      made.push_back(slave.get());
      return slave;
    };
    server = std::make_unique<Server>(config, std::move(scene));
  }

  struct Session {
    net::Address from;
    net::Standing standing;
    link::Welcome welcome;
    link::Command command;
    CostlySlave* slave = nullptr;
    link::Reply reply;
    std::uint64_t answered = 0;
  };
  Session open(std::uint64_t key, std::uint32_t rate_hz = 1000, std::uint64_t features = kNoLog) {
    Session s;
    s.from.port = static_cast<std::uint16_t>(++ports);
    s.standing.identity = key;
    s.standing.address_proven = true;
    s.standing.rights = net::Rights::kOperate;
    link::Hello h;
    h.version_min = h.version_max = link::kProtocolVersion;
    h.nonce = 1000 + ports;
    h.rate_hz = rate_hz;
    h.feature_bits = features;
    const std::size_t n = codec.encode(h, in);
    const std::size_t m = server->on_datagram({in.data(), n}, s.from, now_ns, out, nullptr, s.standing);
    EXPECT_EQ(codec.decode({out.data(), m}, incoming), link::DropCause::kNone);
    EXPECT_EQ(incoming.type, link::MessageType::kWelcome);
    s.welcome = incoming.welcome;
    s.slave = made.at(ports - 1);
    s.command.session_id = s.welcome.session_id;
    s.command.epoch = s.welcome.epoch;
    s.command.flags = link::kFlagClutch | link::kFlagDeadman;
    return s;
  }
  /// Its next command, `later_ns` after the last by its own clock, with `recent` before it that have not
  /// come.
  void say(Session& s, const Vec3& to_w_nm, std::uint64_t later_ns, std::size_t recent = 0,
           bool superseded = false) {
    link::RecentCommands before;
    before.count = recent;
    for (std::size_t i = 0; i < recent; ++i) {
      before.record[i].age_ns = static_cast<std::uint32_t>((i + 1) * later_ns);
      before.record[i].flags = s.command.flags;
      before.record[i].tip_pos_w_nm = i % 2 == 0 ? Vec3(-to_w_nm) : to_w_nm;
    }
    s.command.sequence += 1 + recent;
    s.command.send_time_ns += later_ns * (1 + recent);
    s.command.tip_pos_w_nm = to_w_nm;
    const std::size_t n = recent > 0 ? codec.encode(s.command, before, in) : codec.encode(s.command, in);
    const std::size_t m =
        server->on_datagram({in.data(), n}, s.from, now_ns, out, nullptr, s.standing, superseded);
    if (m == 0 || codec.decode({out.data(), m}, incoming) != link::DropCause::kNone) return;
    if (incoming.type != link::MessageType::kReply) return;
    s.reply = incoming.reply;
    ++s.answered;
  }

  WorkBounds bounds;
  std::vector<CostlySlave*> made;
  std::unique_ptr<Server> server;
  std::uint64_t ports = 0;
  std::int64_t now_ns = 1'000'000'000;
  link::Codec codec;
  link::Incoming incoming;
  std::array<std::uint8_t, link::kMaxDatagramBytes> in{}, out{};
};

// 1000 datagrams a second, each with five commands a tenth of a second apart by their own clock: a hundred
// times as much as goes by. Oracle: the bounds as they are written down, not the server's count.
TEST(Work, NobodyTakesMoreThanItsShareWhateverItAsksFor) {
  Rig rig;
  auto insider = rig.open(1), neighbour = rig.open(2);
  double most_in_a_datagram = 0;
  for (int k = 0; k < 5000; ++k) {
    rig.now_ns += kMs;
    if (k % 5 == 0) rig.server->poll(rig.now_ns);
    const double before = insider.slave->work;
    rig.say(insider, Vec3(k % 2 == 0 ? 5000 : -5000, 0, 0), 100 * kMs, 4);
    most_in_a_datagram = std::max(most_in_a_datagram, insider.slave->work - before);
    rig.say(neighbour, Vec3(0, 0, 0.01 * k), kMs);
    ASSERT_EQ(neighbour.reply.fault_bits, 0u) << k;
  }
  EXPECT_EQ(insider.answered, 5000u) << "all are answered";
  EXPECT_EQ(neighbour.answered, 5000u);
  const double share_per_s = rig.bounds.all_per_s / 2;
  EXPECT_LE(insider.slave->work, 5 * share_per_s + 2 * rig.bounds.a_datagram + rig.bounds.a_datagram);
  EXPECT_GE(insider.slave->work, 0.9 * 5 * share_per_s) << "and has it";
  EXPECT_LE(most_in_a_datagram, rig.bounds.a_datagram + 1) << "nobody waits for longer";
  EXPECT_NE(insider.reply.fault_bits & link::kFaultShare, 0u) << "its station is told";
  EXPECT_GT(rig.server->counters().deferred + rig.server->counters().cut, 4000u);
}

TEST(Work, WhatIsLeftIsCaughtUpWithAndNoTimeIsLost) {
  Rig rig;
  auto s = rig.open(1);
  rig.open(2);                                                          // with which it shares
  for (int k = 0; k < 40; ++k) rig.say(s, Vec3(100.0 * k, 0, 0), kMs);  // at once: 20 ms of a share a step
  EXPECT_NE(s.reply.fault_bits & link::kFaultShare, 0u);
  EXPECT_LT(s.slave->at_w_nm.x(), 3000) << "it lags";
  int more = 0;
  for (; (s.reply.fault_bits & link::kFaultShare) != 0 && more < 1000; ++more) {
    rig.now_ns += kMs;
    rig.say(s, Vec3(3900, 0, 0), kMs);
  }
  // 2900 nm at 200 a millisecond.
  EXPECT_NEAR(more, 15, 3);
  EXPECT_EQ(s.slave->at_w_nm, Vec3(3900, 0, 0));
  // The first command's time is a tick (PROTOCOL.md, section 4); all others' are their spacing.
  EXPECT_NEAR(s.slave->time_s, 1e-3 * (40 + more), 1e-9);
}

TEST(Work, AStopNeverWaits) {
  Rig rig;
  auto s = rig.open(1);
  rig.open(2);  // with which it shares
  for (int k = 0; k < 20; ++k) rig.say(s, Vec3(k % 2 == 0 ? 5000 : -5000, 0, 0), 100 * kMs, 4);
  ASSERT_NE(s.reply.fault_bits & link::kFaultShare, 0u);
  const std::uint64_t steps = s.slave->steps;
  rig.say(s, Vec3(0, 0, 0), kMs);
  ASSERT_EQ(s.slave->steps, steps) << "nothing is left";
  s.command.flags |= link::kFlagStop;
  rig.say(s, Vec3(0, 0, 0), kMs);
  EXPECT_EQ(s.slave->retracts, 1u);
  EXPECT_NE(s.reply.fault_bits & link::kFaultRetracted, 0u);
  // Superseded neither, with flags that are new.
  auto t = rig.open(3);
  rig.say(t, Vec3(1, 0, 0), kMs);
  t.command.flags |= link::kFlagStop;
  rig.say(t, Vec3(1, 0, 0), kMs, 0, true);
  EXPECT_EQ(t.slave->retracts, 1u);
}

// One key's sessions share what one session of another key has alone; those that stand still are no worse
// off.
TEST(Work, TheSessionsOfOneKeyShare) {
  Rig rig;
  std::vector<Rig::Session> greedy;
  for (int i = 0; i < 8; ++i) greedy.push_back(rig.open(1));
  auto still = rig.open(1), other = rig.open(2);
  double most_of_other = 0;
  for (int k = 0; k < 3000; ++k) {
    rig.now_ns += kMs;
    if (k % 5 == 0) rig.server->poll(rig.now_ns);
    for (auto& s : greedy) rig.say(s, Vec3(k % 2 == 0 ? 5000 : -5000, 0, 0), 100 * kMs, 4);
    rig.say(still, Vec3(0, 0, 0), kMs);
    ASSERT_EQ(still.reply.fault_bits, 0u) << k;
    // 30 nm a tick: within what every session has.
    rig.say(other, Vec3(k % 2 == 0 ? 30 : 0, 0, 0), kMs);
    ASSERT_EQ(other.reply.fault_bits, 0u) << k;
    most_of_other = std::max(most_of_other, other.slave->most_in_a_step);
  }
  double of_key = 0;
  for (auto& s : greedy) of_key += s.slave->work;
  const double share_per_s = rig.bounds.all_per_s / 2;
  // Free of the share: ten units in each of 8 × 3000 datagrams. Begun before poll() has counted: a second of
  // the whole at most, here one look of it.
  EXPECT_LE(of_key, 3 * share_per_s + 8 * 3000 * rig.bounds.free_a_datagram + 3 * 8 * rig.bounds.a_datagram);
  EXPECT_GE(of_key, 0.5 * 3 * share_per_s);
  EXPECT_GE(most_of_other, 30);
}

TEST(Work, WithoutBoundsNothingIsLeft) {
  Rig rig(false);
  auto s = rig.open(1);
  for (int k = 0; k < 20; ++k) rig.say(s, Vec3(k % 2 == 0 ? 5000 : -5000, 0, 0), 100 * kMs, 4);
  EXPECT_EQ(s.reply.fault_bits, 0u);
  EXPECT_GT(s.slave->work, 20 * 5 * 5000);
}

// Where the server is behind, the newest command of a sender brings the motion of those before it.
TEST(Work, ASupersededCommandIsAnsweredAndItsMotionLeftToTheNext) {
  Rig rig;
  auto s = rig.open(1);
  rig.say(s, Vec3(1, 0, 0), kMs);
  const std::uint64_t steps = s.slave->steps;
  const double time_s = s.slave->time_s;
  for (int k = 2; k < 10; ++k) rig.say(s, Vec3(k, 0, 0), kMs, 0, true);
  EXPECT_EQ(s.answered, 9u);
  EXPECT_EQ(s.slave->steps, steps);
  EXPECT_NE(s.reply.fault_bits & link::kFaultShare, 0u);
  rig.say(s, Vec3(10, 0, 0), kMs);
  EXPECT_EQ(s.slave->steps, steps + 1);
  EXPECT_EQ(s.slave->at_w_nm, Vec3(10, 0, 0));
  EXPECT_NEAR(s.slave->time_s - time_s, 9e-3, 1e-12);
  EXPECT_EQ(s.reply.fault_bits, 0u);
}

// Steps of a log are made whole and in order, by as many as the share pays for; when one has waited for two
// seconds what is left is left out, and said to be. 2000 units a step, a step a millisecond, 200 units a
// millisecond: a tenth of the steps is made, so that at t the one of t/10 is, which has waited for 0.9 t.
TEST(Work, LoggedStepsWaitForTheirShareAndAreThenLeftOutAsADeclaredBreak) {
  Rig rig;
  auto s = rig.open(1, 1000, link::kKnownFeatures);
  auto other = rig.open(2);  // with which it shares
  std::array<std::uint8_t, link::kStepsBytesMost> bytes{};
  std::int64_t broken_ns = 0;
  const std::int64_t begin_ns = rig.now_ns;
  for (std::uint64_t k = 1; k <= 3000 && broken_ns == 0; ++k) {
    rig.now_ns += kMs;
    if (k % 5 == 0) rig.server->poll(rig.now_ns);
    if (k % 100 == 0) rig.say(other, Vec3::Zero(), 100 * kMs);  // it is there
    link::StepWriter writer(bytes, k);
    const Vec3 to_w_nm(k % 2 == 0 ? 1000 : -1000, 0, 0);
    ASSERT_TRUE(writer.add(link::logged_step(to_w_nm, s.command.flags, 1e-3)));
    ++s.command.sequence;
    s.command.send_time_ns += kMs;
    const std::size_t n = rig.codec.encode(s.command, std::span(bytes.data(), writer.size()), rig.in);
    const std::size_t m =
        rig.server->on_datagram({rig.in.data(), n}, s.from, rig.now_ns, rig.out, nullptr, s.standing);
    ASSERT_EQ(rig.codec.decode({rig.out.data(), m}, rig.incoming), link::DropCause::kNone);
    ASSERT_EQ(rig.incoming.type, link::MessageType::kReply);
    s.reply = rig.incoming.reply;
    ASSERT_EQ(s.reply.fault_bits & link::kFaultShare, 0u) << "none is cut";
    if (s.reply.steps.breaks > 0) {
      broken_ns = rig.now_ns;
    } else {
      ASSERT_EQ(s.reply.steps.executed, s.slave->steps) << "each once, none left out";
    }
  }
  ASSERT_NE(broken_ns, 0);
  EXPECT_EQ(s.reply.steps.break_reason, link::kBreakShare);
  EXPECT_GE(s.reply.steps.executed + 1, s.reply.steps.newest) << "it goes on with the newest";
  EXPECT_NEAR(1e-9 * static_cast<double>(broken_ns - begin_ns), 2.0 / 0.9, 0.1);
  // Owed afterwards is one step at most; saved up before, two datagrams' most.
  EXPECT_LE(s.slave->work, 2.3 * rig.bounds.all_per_s / 2 + 2 * rig.bounds.a_datagram + 2 * 2000);
  EXPECT_GE(s.slave->work, 0.9 * 2 * rig.bounds.all_per_s / 2);
}

// A station whose clock runs four times as fast as the server's: its steps wait, and after two seconds of
// that they are left out, and said to be. Else its tip would be further behind its hand with every second.
TEST(Work, StepsThatAreAheadOfTheWallAreLeftOutInTheEnd) {
  Rig rig;
  auto s = rig.open(1, 1000, link::kKnownFeatures);
  std::array<std::uint8_t, link::kStepsBytesMost> bytes{};
  std::int64_t late_ns = 0, broken_ns = 0;
  for (std::uint64_t k = 1; k <= 8000 && broken_ns == 0; ++k) {
    rig.now_ns += kMs;
    if (k % 5 == 0) rig.server->poll(rig.now_ns);
    link::StepWriter writer(bytes, k);
    ASSERT_TRUE(writer.add(link::logged_step(Vec3(1, 0, 0), s.command.flags, 4e-3)));
    ++s.command.sequence;
    s.command.send_time_ns += kMs;
    const std::size_t n = rig.codec.encode(s.command, std::span(bytes.data(), writer.size()), rig.in);
    const std::size_t m =
        rig.server->on_datagram({rig.in.data(), n}, s.from, rig.now_ns, rig.out, nullptr, s.standing);
    ASSERT_EQ(rig.codec.decode({rig.out.data(), m}, rig.incoming), link::DropCause::kNone);
    ASSERT_EQ(rig.incoming.type, link::MessageType::kReply);
    s.reply = rig.incoming.reply;
    if (late_ns == 0 && s.reply.steps.executed < s.reply.steps.newest) late_ns = rig.now_ns;
    if (s.reply.steps.breaks > 0) broken_ns = rig.now_ns;
  }
  ASSERT_NE(broken_ns, 0);
  EXPECT_EQ(s.reply.steps.break_reason, link::kBreakShare);
  // 3 s a second of the bucket's 5 s. From then on a quarter of what comes is made: the next one has waited
  // for 3/4 of the time since, until that is 2 s.
  EXPECT_NEAR(1e-9 * static_cast<double>(late_ns - 1'000'000'000), 5.0 / 3, 0.1);
  EXPECT_NEAR(1e-9 * static_cast<double>(broken_ns - late_ns), 2.0 / 0.75, 0.1);
  EXPECT_GE(s.reply.steps.executed + 1, s.reply.steps.newest) << "it goes on with the newest";
}

// What comes in one datagram may be more than a datagram's part of the work: the rest is made as soon as
// nobody else waits, not when the time-outs are looked at. 170 units a step, as ploughing takes, ten steps
// every ten milliseconds, alone: never further behind than what has just come.
TEST(Work, LoggedStepsBeyondOneDatagramsPartAreMadeAtOnce) {
  Rig rig;
  auto s = rig.open(1, 1000, link::kKnownFeatures);
  std::array<std::uint8_t, link::kStepsBytesMost> bytes{};
  for (std::uint64_t k = 1; k <= 5000; k += 10) {
    rig.now_ns += 10 * kMs;
    link::StepWriter writer(bytes, k);
    for (std::uint64_t i = 0; i < 10; ++i)
      ASSERT_TRUE(
          writer.add(link::logged_step(Vec3((k + i) % 2 == 0 ? 85 : -85, 0, 0), s.command.flags, 1e-3)));
    ++s.command.sequence;
    s.command.send_time_ns += 10 * kMs;
    const std::size_t n = rig.codec.encode(s.command, std::span(bytes.data(), writer.size()), rig.in);
    const std::uint64_t before = s.slave->steps;
    rig.server->on_datagram({rig.in.data(), n}, s.from, rig.now_ns, rig.out, nullptr, s.standing);
    EXPECT_LE(s.slave->steps - before, 5u) << "others wait";
    for (std::int64_t now_ns = rig.now_ns; rig.server->catch_up(now_ns) || s.slave->steps < k + 9;) {
      now_ns += 100'000;
      ASSERT_LT(now_ns, rig.now_ns + 9 * kMs) << k << ": " << s.slave->steps;
    }
  }
  EXPECT_EQ(s.slave->steps, 5000u);
}

// Steadily behind by a little less than what is too much is not waiting for ever: no step has waited for two
// seconds, and none is left out.
TEST(Work, WhoIsAlwaysALittleBehindLosesNothing) {
  Rig rig;
  auto s = rig.open(1, 1000, link::kKnownFeatures);
  auto other = rig.open(2);  // with which it shares: 200 units a millisecond
  std::array<std::uint8_t, link::kStepsBytesMost> bytes{};
  std::uint64_t behind_most = 0;
  for (std::uint64_t k = 1; k <= 12'000; ++k) {
    rig.now_ns += kMs;
    if (k % 5 == 0) rig.server->poll(rig.now_ns);
    if (k % 100 == 0) rig.say(other, Vec3::Zero(), 100 * kMs);  // it is there
    link::StepWriter writer(bytes, k);
    // For half a second ten times what it may take, then all the time just as much.
    const double way_nm = k <= 500 ? 600 : 190;
    ASSERT_TRUE(writer.add(link::logged_step(Vec3(k % 2 == 0 ? way_nm : 0, 0, 0), s.command.flags, 1e-3)));
    ++s.command.sequence;
    s.command.send_time_ns += kMs;
    const std::size_t n = rig.codec.encode(s.command, std::span(bytes.data(), writer.size()), rig.in);
    const std::size_t m =
        rig.server->on_datagram({rig.in.data(), n}, s.from, rig.now_ns, rig.out, nullptr, s.standing);
    ASSERT_EQ(rig.codec.decode({rig.out.data(), m}, rig.incoming), link::DropCause::kNone);
    ASSERT_EQ(rig.incoming.reply.steps.breaks, 0u) << k;
    behind_most = std::max(behind_most, rig.incoming.reply.steps.newest - rig.incoming.reply.steps.executed);
  }
  EXPECT_GT(behind_most, 500u) << "or nothing was tried";
  EXPECT_LT(behind_most, 2000u);
}

TEST(DrainOrder, SendersTakeTurns) {
  std::array<net::Address, 3> sender;
  for (std::size_t k = 0; k < sender.size(); ++k) sender[k].port = static_cast<std::uint16_t>(1 + k);
  // Twenty of one, then one of each other: they are second and third.
  std::vector<std::size_t> came(20, 0);
  came.push_back(1);
  came.push_back(2);
  DrainOrder order;
  std::vector<std::size_t> looked_at;
  for (const auto& item :
       order.of(came.size(), [&](std::size_t k) -> const net::Address& { return sender[came[k]]; })) {
    looked_at.push_back(item.index);
    EXPECT_FALSE(item.superseded) << "the server is not behind";
  }
  std::vector<std::size_t> expected{0, 20, 21};
  for (std::size_t k = 1; k < 20; ++k) expected.push_back(k);
  EXPECT_EQ(looked_at, expected);
}

TEST(DrainOrder, WhereTheServerIsBehindTheNewestOfEachSenderCounts) {
  std::array<net::Address, 4> sender;
  for (std::size_t k = 0; k < sender.size(); ++k) sender[k].ip[0] = static_cast<std::uint8_t>(1 + k);
  DrainOrder order;
  const auto from = [&](std::size_t k) -> const net::Address& { return sender[k % 4]; };
  std::vector<int> seen(DrainOrder::kMost, 0);
  std::size_t at = 0;
  for (const auto& item : order.of(DrainOrder::kMost, from)) {
    ++seen[item.index];
    EXPECT_EQ(item.index, at++) << "they came by turns";
    EXPECT_EQ(item.superseded, item.index < DrainOrder::kMost - 4) << item.index;
  }
  for (const int times : seen) EXPECT_EQ(times, 1);
  EXPECT_FALSE(order.of(1, from)[0].superseded);
}

}  // namespace
}  // namespace telenano::server

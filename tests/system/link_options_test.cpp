// What a station may do with its link: play-out, repeated commands, deadband, any rate; whole sessions in
// virtual time.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <utility>

#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/alloc_guard.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

std::shared_ptr<const scene::Scene> scene_of(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

VirtualSessionConfig config_for(const std::string& scene_name, device::Task task, double duration_s) {
  VirtualSessionConfig config;
  config.scene = scene_of(scene_name);
  config.task = task;
  config.task_options.duration_s = duration_s;
  return config;
}

double norm(const recording::Xyz& v) {
  return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

constexpr auto kConstant = link::PlayoutConfig::Mode::kConstant;
constexpr auto kAdaptive = link::PlayoutConfig::Mode::kAdaptive;
constexpr auto kContact = static_cast<std::uint32_t>(link::ContactState::kContact);

VirtualSessionConfig jittery(link::PlayoutConfig::Mode mode) {
  auto config = config_for("flat_silicon_oxide", device::Task::kIndent, 4);
  config.to_server.delay_ns = config.to_station.delay_ns = 2'000'000;
  config.to_server.jitter_ns = config.to_station.jitter_ns = 5'000'000;  // uniform: 4 to 14 ms there and back
  config.to_server.in_order = config.to_station.in_order = false;
  config.seed = 99;
  config.link_options.playout.mode = mode;
  config.link_options.playout.delay_ns = 15'000'000;
  return config;
}

/// How much the delay from a command to the tick that shows its reply varies, in ticks.
struct DelaySpread {
  std::map<std::int64_t, int> ticks;
  std::int64_t replies = 0;
  void run(VirtualSession& session, std::int64_t settle) {
    std::int64_t last = 0;
    session.run(20'000, [&](const recording::Sample& row) {
      if (row.tick < settle || row.reply_sequence == last || row.reply_age_ms > 0) return;
      last = row.reply_sequence;
      ++replies;
      // The command of tick k is commands_sent − (ticks since) …: with a command in every tick and none lost,
      // the tick of a command is its number less the number of the first.
      ++ticks[row.commands_sent - row.reply_sequence];
    });
  }
};

TEST(LinkOptions, PlayOutMakesTheDelayConstantUnderJitter) {
  // Commands overtake one another, and the server answers only those that are newer than all before: the
  // reply's number is not its command's. What a controller sees is how regularly replies come.
  const auto gaps = [](link::PlayoutConfig::Mode mode, std::uint64_t& late) {
    auto config = jittery(mode);
    config.to_server.jitter_ns = 0;  // all of it on the way back: one reply a tick is sent
    config.to_station.jitter_ns = 10'000'000;
    VirtualSession session(config);
    DelaySpread spread;
    spread.run(session, 500);
    late = session.loop().playout().counts().late;
    EXPECT_GT(spread.replies, 1'000);
    return spread.ticks;
  };
  std::uint64_t late = 0;
  const auto newest = gaps(link::PlayoutConfig::Mode::kNewest, late);
  EXPECT_GE(newest.rbegin()->first - newest.begin()->first, 4) << "without it the delay jumps about";
  const auto constant = gaps(kConstant, late);
  EXPECT_EQ(late, 0u);
  // 15 ms are 15 ticks, exactly: the command of tick k leaves in tick k and is shown in tick k + 15, when 15
  // others have been sent and its own reply has come: always the same number.
  EXPECT_EQ(constant.size(), 1u) << constant.begin()->first << " … " << constant.rbegin()->first;
}

TEST(LinkOptions, PlayOutKeepsAccountsFaultsAndPromises) {
  for (const auto mode : {kConstant, kAdaptive}) {
    auto config = jittery(mode);
    config.to_server.loss = config.to_station.loss = 0.1;
    VirtualSession session(config);
    double least_j = 0, bound_j = 0, deepest_nn = 0;
    std::uint32_t faults = 0;
    bool touched = false;
    session.run(20'000, [&](const recording::Sample& row) {
      least_j = std::min(least_j, row.energy_j);
      bound_j = row.energy_bound_j;
      touched |= row.contact_state == kContact;
      deepest_nn = std::max(deepest_nn, row.force_w_nn[2]);
      faults |= row.station_faults;
    });
    EXPECT_TRUE(session.done());
    EXPECT_TRUE(touched);
    EXPECT_GT(deepest_nn, 10);
    EXPECT_EQ(faults & ~std::uint32_t{station::kFaultStale}, 0u) << station::fault_name(faults);
    EXPECT_GE(least_j, -(config.station.allowance_j + bound_j));
    // The totals that the session knows are the newest, whatever waits; nothing was lost with what was late.
    EXPECT_EQ(session.client().slave_energy_aj().in(), session.client().reply().energy_in_aj);
  }
}

TEST(LinkOptions, AStopIsNotHeldBack) {
  auto config = jittery(kConstant);
  config.link_options.playout.delay_ns = 200'000'000;
  config.task = device::Task::kContact;
  VirtualSession session(config);
  int k = 0;
  for (; k < 10'000 && session.step().contact_state != kContact; ++k) {
  }
  ASSERT_LT(k, 10'000);
  session.loop().set_buttons(device::kButtonStop);
  EXPECT_EQ(norm(session.step().hand_force_commanded_h_n), 0) << "zero in the tick of the button";
  int ticks = 0;
  while (ticks < 1000 && (session.step().fault_bits & link::kFaultRetracted) == 0) ++ticks;
  // The way there and back, 14 ms at most, instead of the buffer's 200 ms.
  EXPECT_LE(ticks, 15) << "the slave's own fault is seen at once";
}

TEST(LinkOptions, PlayOutAndGateDoNotAllocate) {
  auto config = jittery(kConstant);
  config.link_options.gate.deadband_nm = 0.01;
  config.redundancy = link::kMaxRecent;
  config.link_options.reply_deadband = {.permille = 100, .adapts = false, .floor_n = 0.005};
  VirtualSession session(config);
  session.run(300);
  if (!AllocGuard::active()) GTEST_SKIP() << "a sanitizer owns malloc";
  const AllocGuard guard;
  session.run(2000);
  EXPECT_EQ(guard.allocations(), 0u);
}

TEST(LinkOptions, RepeatedCommandsKeepTheSlavesAccountUnderLoss) {
  const auto counts_of = [](double loss, std::size_t redundancy) {
    auto config = config_for("flat_silicon_oxide", device::Task::kIndent, 3);
    config.station.method = control::Method::kKsClamp;
    config.to_server.loss = loss;
    config.redundancy = redundancy;
    config.seed = 4;
    VirtualSession session(config);
    session.run(20'000);
    return std::pair(session.server().counters().recovered, session.server().counters().exchanges);
  };
  const auto [recovered, exchanges] = counts_of(0.2, 4);
  // A fifth is lost, nearly all of it is played: recovered / (exchanges + recovered) = 0.2.
  EXPECT_NEAR(static_cast<double>(recovered) / static_cast<double>(recovered + exchanges), 0.2, 0.03);
  EXPECT_EQ(counts_of(0.2, 0).first, 0u);
  EXPECT_EQ(counts_of(0, 4).first, 0u);
}

TEST(LinkOptions, DeadbandSavesPacketsWithinItsErrorAndKeepsTheAccounts) {
  struct Result {
    double packets_s = 0, worst_error_nm = 0, net_aj = 0, pull_off_nn = 0;
    std::uint64_t stale = 0;
    double observer_j = 0, sum_j = 0;
  };
  const auto run = [](double deadband_nm, double deadband_n) {
    auto config = config_for("flakes", device::Task::kIndent, 6);
    config.link_options.gate.deadband_nm = deadband_nm;
    config.link_options.gate.deadband_n = deadband_n;
    VirtualSession session(config);
    Result r;
    recording::Sample last{};
    std::int64_t ticks = 0, sent_before = -1;
    recording::Xyz known{};
    session.run(20'000, [&](const recording::Sample& row) {
      if (sent_before < 0 || row.commands_sent != sent_before) known = row.tip_target_w_nm;
      sent_before = row.commands_sent;
      recording::Xyz apart{};
      for (std::size_t i = 0; i < 3; ++i) apart[i] = known[i] - row.tip_target_w_nm[i];
      r.worst_error_nm = std::max(r.worst_error_nm, norm(apart));
      r.pull_off_nn = std::max(r.pull_off_nn, -row.force_w_nn[2]);
      if ((row.station_faults & station::kFaultStale) != 0) ++r.stale;
      last = row;
      ++ticks;
    });
    r.packets_s = 1000.0 * static_cast<double>(last.commands_sent) / static_cast<double>(ticks);
    r.net_aj = last.slave_energy_in_aj - last.slave_energy_out_aj;
    // The server's copy of the station's account is what the newest command said.
    for (std::size_t slot = 0; slot < 8; ++slot) {
      const link::Session& s = session.server().sessions()[slot];
      if (s.state != link::SlotState::kActive) continue;
      r.observer_j = last.energy_in_j;
      r.sum_j = s.station_energy.in();
    }
    return r;
  };
  const Result all = run(0, 0);
  EXPECT_NEAR(all.packets_s, 1000, 2);
  std::printf("%-12s %10s %12s %12s %12s\n", "deadband", "packets/s", "error nm", "pull-off nN", "net aJ");
  const auto print = [](const char* name, const Result& r) {
    std::printf("%-12s %10.0f %12.4f %12.3f %12.2f\n", name, r.packets_s, r.worst_error_nm, r.pull_off_nn,
                r.net_aj);
  };
  print("none", all);
  for (const auto& [name, nm, n] : {std::tuple("0.02 nm", 0.02, 0.0), std::tuple("0.1 nm", 0.1, 0.0),
                                    std::tuple("0.1 nm 50mN", 0.1, 0.05)}) {
    const Result r = run(nm, n);
    print(name, r);
    EXPECT_LT(r.packets_s, 0.7 * all.packets_s) << name;
    EXPECT_GE(r.packets_s, 99) << "the heartbeat";
    EXPECT_LE(r.worst_error_nm, nm) << name;
    EXPECT_EQ(r.stale, 0u) << "replies come often enough for the force never to be stale";
    EXPECT_NEAR(r.pull_off_nn, all.pull_off_nn, 0.05 * all.pull_off_nn) << name;
    // Accounts: the server has what the station had put in when it last spoke, at most a heartbeat ago.
    EXPECT_LE(r.sum_j, r.observer_j);
    EXPECT_GE(r.sum_j, r.observer_j - 1e-3);
  }
}

TEST(LinkOptions, SessionsOfEveryRateTouchStablyAndGoQuietInTime) {
  std::printf("%8s %12s %14s %14s %12s\n", "Hz", "force nN", "hand p-p mm", "zero after ms", "least mJ");
  for (const double rate_hz : {100.0, 500.0, 1000.0, 4000.0, 8000.0}) {
    auto config = config_for("flat_silicon_oxide", device::Task::kContact, 5);
    config.station.rate_hz = rate_hz;
    config.task_options.contact_depth_nm = 2;
    VirtualSession session(config);
    const double period_s = 1 / rate_hz;
    const auto ticks = [&](double seconds) {
      return static_cast<std::int64_t>(std::llround(seconds * rate_hz));
    };
    double least_j = 0, bound_j = 0, low_mm = 1e9, high_mm = -1e9, force_nn = 0;
    double worst_rise_n = 0, previous_n = 0;
    std::uint32_t faults = 0;
    session.run(ticks(3.0), [&](const recording::Sample& row) {
      least_j = std::min(least_j, row.energy_j);
      bound_j = row.energy_bound_j;
      faults |= row.station_faults;
      const double n = norm(row.hand_force_applied_h_n);
      worst_rise_n = std::max(worst_rise_n, n - previous_n);
      previous_n = n;
      if (row.time_s < 2.5) return;
      low_mm = std::min(low_mm, 1e3 * row.hand_pos_h_m[2]);
      high_mm = std::max(high_mm, 1e3 * row.hand_pos_h_m[2]);
      force_nn = row.force_w_nn[2];
    });
    const recording::Sample before = session.step();
    EXPECT_EQ(before.contact_state, kContact) << rate_hz;
    EXPECT_EQ(faults, 0u) << rate_hz << ": " << station::fault_name(faults);
    EXPECT_GE(least_j, -(config.station.allowance_j + bound_j)) << rate_hz;
    EXPECT_LE(worst_rise_n, config.station.slew_n_s * period_s * (1 + 1e-9)) << rate_hz;
    EXPECT_LT(high_mm - low_mm, 0.3) << rate_hz << ": the hand rests";
    ASSERT_GT(norm(before.hand_force_applied_h_n), 0.05) << rate_hz;

    // Silence: zero 100 ms after the last reply, by the clock and not by a number of ticks.
    session.link().path_b_to_a().down = true;
    double zero_ms = -1;
    for (std::int64_t k = 1; k <= ticks(0.3) && zero_ms < 0; ++k) {
      if (norm(session.step().hand_force_applied_h_n) == 0) zero_ms = 1e3 * static_cast<double>(k) * period_s;
    }
    EXPECT_GT(zero_ms, 15) << rate_hz << ": it is held first";
    EXPECT_LE(zero_ms, 100 + 2e3 * period_s) << rate_hz;
    // The server's time-out: half a second in this scene.
    session.link().path_a_to_b().down = true;
    for (std::int64_t k = 0; k < ticks(0.49); ++k) session.step();
    EXPECT_EQ(session.server().counters().timed_out, 0u) << rate_hz;
    for (std::int64_t k = 0; k < ticks(0.03) + 2; ++k) session.step();
    EXPECT_EQ(session.server().counters().timed_out, 1u) << rate_hz;
    std::printf("%8.0f %12.2f %14.3f %14.1f %12.3f\n", rate_hz, force_nn, high_mm - low_mm, zero_ms,
                1e3 * least_j);
  }
}

TEST(LinkOptions, ASlaveThatIsSlowerRefusesTheRate) {
  auto scene = std::make_shared<scene::Scene>(*scene_of("flat_silicon_oxide"));
  scene->limits.rate_max_hz = 500;
  auto config = config_for("flat_silicon_oxide", device::Task::kContact, 1);
  config.scene = scene;
  config.station.rate_hz = 500;
  EXPECT_EQ(VirtualSession(config).client().welcome().slave_rate_max_hz, 500u);
  config.station.rate_hz = 501;
  EXPECT_ANY_THROW(VirtualSession{config});
}

VirtualSessionConfig narrow(bool adapts, bool twin) {
  auto config = config_for("flat_silicon_oxide", device::Task::kIndent, 8);
  config.to_server.delay_ns = config.to_station.delay_ns = 2'000'000;
  config.to_server.rate_bit_s = config.to_station.rate_bit_s = 1e6;
  config.to_server.queue_bytes = config.to_station.queue_bytes = 65536;
  config.seed = 5;
  config.twin = twin;
  if (twin) config.station.method = control::Method::kTwin;
  config.link_options.rate.adapts = adapts;
  config.link_options.rate.full_hz = 1000;
  return config;
}

// What is asked for at 1 Mbit/s behind 64 KiB: 30 ms from 2 s on; without it the queue stands at hundreds.
// The work of the slave is done and felt meanwhile, and nothing is allocated for it.
TEST(LinkOptions, ARateThatFollowsTheLinkLeavesNoQueue) {
  double worst_us[2] = {0, 0};
  for (const bool adapts : {false, true}) {
    VirtualSession session(narrow(adapts, false));
    bool touched = false;
    double most_n = 0;
    session.run(2000);
    const std::function<void(const recording::Sample&)> look = [&](const recording::Sample& row) {
      worst_us[adapts] = std::max(worst_us[adapts], row.rtt_us);
      touched |= row.contact_state == kContact;
      if (row.tick > 2500) most_n = std::max(most_n, norm(row.hand_force_applied_h_n));
    };
    const AllocGuard guard;
    session.run(8000, look);
    if (AllocGuard::active()) {
      EXPECT_EQ(guard.allocations(), 0u);
    }
    EXPECT_TRUE(touched);
    if (!adapts) continue;
    EXPECT_GT(most_n, 0.05) << "nothing was felt";
    EXPECT_NE(session.loop().rate().reason(), link::RateReason::kFull);
    EXPECT_LT(session.loop().rate().rate_hz(), 900);
    EXPECT_GT(session.loop().rate().lowest_hz(), 150);
  }
  std::printf("longest round trip: %.0f ms, and %.1f ms with a rate that follows\n", 1e-3 * worst_us[0],
              1e-3 * worst_us[1]);
  EXPECT_GT(worst_us[0], 300e3);
  EXPECT_LE(worst_us[1], 30e3);
}

// With a log of steps every tick is one, whatever is sent: each is executed once and in order, none left out.
TEST(LinkOptions, ARateThatFollowsTheLinkLosesNoStep) {
  for (const double loss : {0.0, 0.03}) {
    auto config = narrow(true, true);
    config.to_server.rate_bit_s = config.to_station.rate_bit_s = 200e3;  // less than a twin's own pace takes
    config.to_server.loss = config.to_station.loss = loss;
    VirtualSession session(config);
    session.run(9000);
    ASSERT_TRUE(session.client().logs_steps());
    const link::StepReport& steps = session.client().reply().steps;
    EXPECT_EQ(steps.breaks, 0u) << loss;
    // What a round trip, the rate's 20 ms and one repetition leave open.
    EXPECT_LT(session.client().steps().open(), 400u) << loss;
    EXPECT_GT(steps.executed, 7000u);
    EXPECT_LT(session.datagrams_up(), 7000u) << loss;
    std::printf("loss %.2f: %llu steps executed, %zu open, %llu datagrams\n", loss,
                static_cast<unsigned long long>(steps.executed), session.client().steps().open(),
                static_cast<unsigned long long>(session.datagrams_up()));
  }
}

/// A slave, and what it has said last.
class ToldSlave final : public slave::Slave {
 public:
  ToldSlave(std::unique_ptr<slave::Slave> inner, std::shared_ptr<slave::SlaveOutput> said)
      : inner_(std::move(inner)), said_(std::move(said)) {}
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    inner_->step(input, dt_s, output);
    *said_ = output;
  }
  const slave::SlaveLimits& limits() const noexcept override { return inner_->limits(); }

 private:
  std::unique_ptr<slave::Slave> inner_;
  std::shared_ptr<slave::SlaveOutput> said_;
};

struct Thin {
  double commands_s = 0, replies_s = 0, left_out_s = 0, worst_rtt_ms = 0, nrmse = 0, least_rate_hz = 0;
  std::uint64_t stale = 0, lost = 0;
  bool accounts_agree = false;
};

/// An indentation, ten times in a row, over a link that carries so many bits a second each way.
Thin over_thin_link(double bit_s, const loop::ReplyDeadbandConfig& deadband) {
  auto config = narrow(true, false);
  config.to_server.rate_bit_s = config.to_station.rate_bit_s = bit_s;
  config.task_options.duration_s = 30;
  config.link_options.reply_deadband = deadband;
  const auto slave = std::make_shared<slave::SlaveOutput>();
  config.make_slave = [make = slave::nve_slaves(config.scene), slave] {
    return std::make_unique<ToldSlave>(make(), slave);
  };
  VirtualSession session(config);
  constexpr std::int64_t kFrom = 3000, kTo = 20'000;
  Thin thin;
  double sum = 0, most = 0, least = 0;
  link::LinkQuality before;
  recording::Sample row{};
  session.run(kTo, [&](const recording::Sample& now) {
    row = now;
    if (now.tick < kFrom) {
      before = session.client().quality(session.now_ns());
      return;
    }
    thin.worst_rtt_ms = std::max(thin.worst_rtt_ms, 1e-3 * now.rtt_us);
    thin.stale += (now.station_faults & station::kFaultStale) != 0;
    const double force_nn = slave->force_w_nn.z(), apart = now.force_w_nn[2] - force_nn;
    sum += apart * apart;
    most = std::max(most, force_nn);
    least = std::min(least, force_nn);
  });
  const link::LinkQuality q = session.client().quality(session.now_ns());
  const double seconds = 1e-3 * static_cast<double>(kTo - kFrom);
  thin.commands_s = static_cast<double>(q.commands_sent - before.commands_sent) / seconds;
  thin.replies_s = static_cast<double>(q.replies - before.replies) / seconds;
  thin.left_out_s = static_cast<double>(q.replies_left_out - before.replies_left_out) / seconds;
  thin.lost = q.commands_lost + q.replies_lost;
  thin.nrmse = std::sqrt(sum / static_cast<double>(kTo - kFrom)) / (most - least);
  thin.least_rate_hz = session.loop().rate().lowest_hz();
  // Nothing moves any more: what the station knows of the slave's account is all of it.
  session.loop().set_buttons(device::kButtonClutch);
  for (int i = 0; i < 500; ++i) session.step();
  const link::ReceivedEnergy& known = session.client().slave_energy_aj();
  thin.accounts_agree =
      known.in() > 0 && known.in() == slave->energy_in_aj && known.out() == slave->energy_out_aj;
  return thin;
}

// On a link that is full, replies are left out as far as it is, without a queue when the force moves; on one that has
// room there are none. Kept to, whatever the link does, the commands rise into the room that is left.
TEST(LinkOptions, AFullLinkLeavesRepliesOut) {
  constexpr loop::ReplyDeadbandConfig kNone{}, kAdapts{.permille = 100, .adapts = true, .floor_n = 0.005},
      kKept{.permille = 100, .adapts = false, .floor_n = 0.005};
  std::printf("%-22s %10s %10s %10s %8s %8s\n", "1 Mbit/s each way", "commands/s", "replies/s", "left out/s",
              "RTT ms", "NRMSE");
  const auto print = [](const char* name, const Thin& t) {
    std::printf("%-22s %10.0f %10.0f %10.0f %8.1f %8.4f\n", name, t.commands_s, t.replies_s, t.left_out_s,
                t.worst_rtt_ms, t.nrmse);
  };
  const Thin none = over_thin_link(1e6, kNone), adapts = over_thin_link(1e6, kAdapts),
             kept = over_thin_link(1e6, kKept);
  print("every reply", none);
  print("as the link asks for", adapts);
  print("100 per mille, kept", kept);
  EXPECT_EQ(none.left_out_s, 0);
  for (const Thin* const t : {&none, &adapts, &kept}) {
    EXPECT_TRUE(t->accounts_agree);
    EXPECT_LE(t->worst_rtt_ms, t == &kept ? 60 : 30);
    EXPECT_EQ(t->lost, 0u);
    EXPECT_EQ(t->stale, 0u);
    EXPECT_LT(t->nrmse, 0.05);
  }
  EXPECT_LT(adapts.replies_s, 0.7 * none.replies_s);
  EXPECT_LT(kept.replies_s, 0.7 * none.replies_s);
  EXPECT_GT(kept.commands_s, 1.1 * none.commands_s);
  const Thin wide = over_thin_link(10e6, kAdapts);
  print("10 Mbit/s, likewise", wide);
  EXPECT_EQ(wide.left_out_s, 0) << "there is room";
}

// While a recording is made, an adapting deadband is none: the forces in it are the slave's own.
TEST(LinkOptions, WhatIsRecordedHasEveryReply) {
  for (const bool records : {false, true}) {
    auto config = narrow(true, false);
    config.to_server.rate_bit_s = config.to_station.rate_bit_s = 500e3;
    config.link_options.reply_deadband = {.permille = 100, .adapts = true};
    VirtualSession session(config);
    if (records) session.loop().set_records();
    session.run(6000);
    EXPECT_NE(session.loop().rate().reason(), link::RateReason::kFull);
    EXPECT_EQ(session.client().reply().replies_left_out > 0, !records);
    EXPECT_EQ(session.loop().told_reply_deadband().empty(), records);
  }
}

// With a twin every reply confirms steps.
TEST(LinkOptions, WithATwinEveryCommandIsAnswered) {
  auto config = narrow(true, true);
  config.link_options.reply_deadband = {.permille = 500, .adapts = false, .floor_n = 1};
  VirtualSession session(config);
  session.run(5000);
  ASSERT_TRUE(session.client().logs_steps());
  EXPECT_EQ(session.client().features() & link::kFeatureReplyDeadband, 0u);
  EXPECT_EQ(session.server().counters().left_out, 0u);
  EXPECT_EQ(session.client().drops().total(), 0u);
}

}  // namespace
}  // namespace telenano::support

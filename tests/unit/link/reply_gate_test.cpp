#include "telenano/common/link/reply_gate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

namespace telenano::link {
namespace {

constexpr std::uint64_t kTickNs = 1'000'000;
constexpr double kTickS = 1e-3;

/// One exchange after the other, a millisecond apart.
struct Exchange {
  Command command;
  Reply reply;
  ReplyGate gate;

  Exchange() {
    command.flags = kFlagClutch | kFlagDeadman;
    command.control.energy_scale_aj_j = 1e17;
    command.reply_deadband = {500, 100};  // 0.5 nN, 10 %
    reply.session_id = 7;
    reply.epoch = 3;
    reply.force_w_nn = {0, 0, 20};
    command.send_time_ns = 1'000'000'000;
  }
  bool next(double force_nn, double spacing_s = kTickS) {
    command.send_time_ns += static_cast<std::uint64_t>(std::llround(1e9 * spacing_s));
    reply.force_w_nn.z() = force_nn;
    return gate.wants(reply, command, spacing_s);
  }
};

TEST(ReplyGate, WithoutADeadbandEveryReplyIsSent) {
  Exchange e;
  e.command.reply_deadband = {};
  for (int k = 0; k < 100; ++k) EXPECT_TRUE(e.next(20));
  EXPECT_EQ(e.gate.left_out(), 0u);
}

TEST(ReplyGate, LeavesOutWhatIsWithinTheGreaterOfTheTwo) {
  Exchange e;
  EXPECT_TRUE(e.next(20)) << "the first";
  EXPECT_FALSE(e.next(21.9));
  EXPECT_FALSE(e.next(18.1));
  EXPECT_TRUE(e.next(22.1));
  EXPECT_FALSE(e.next(24.2)) << "of the last one sent, not of the one before";
  EXPECT_TRUE(e.next(24.5));
  EXPECT_TRUE(e.next(1));
  EXPECT_FALSE(e.next(1.49)) << "the floor";
  EXPECT_TRUE(e.next(1.51));
  EXPECT_EQ(e.gate.left_out(), 4u);
  // Across as along.
  e.reply.force_w_nn.x() = 0.49;
  EXPECT_FALSE(e.next(1.51));
  e.reply.force_w_nn.x() = 0.51;
  EXPECT_TRUE(e.next(1.51));
  // Only one of the two.
  e.command.reply_deadband = {0, 100};
  EXPECT_TRUE(e.next(1.51)) << "another deadband";
  EXPECT_FALSE(e.next(1.55));
  EXPECT_TRUE(e.next(1.8));
  e.command.reply_deadband = {500, 0};
  EXPECT_TRUE(e.next(20));
  EXPECT_FALSE(e.next(20.4));
  EXPECT_TRUE(e.next(21));
}

TEST(ReplyGate, ANumberThatIsNoneIsSent) {
  Exchange e;
  EXPECT_TRUE(e.next(20));
  EXPECT_TRUE(e.next(std::nan("")));
  EXPECT_TRUE(e.next(std::nan("")));
  EXPECT_TRUE(e.next(20));
}

TEST(ReplyGate, WhatSaysSomethingElseIsSent) {
  using Change = std::function<void(Exchange&)>;
  const Change changes[] = {
      [](Exchange& e) { e.command.flags = kFlagClutch; },
      [](Exchange& e) { e.command.flags |= kFlagStop; },
      [](Exchange& e) { e.command.flags |= kFlagUndo; },
      [](Exchange& e) { e.command.control.method = kMethodTank; },
      [](Exchange& e) { e.command.control.energy_scale_aj_j *= 1.0001; },
      [](Exchange& e) { e.command.tip_hold = 4; },
      [](Exchange& e) { e.command.reply_deadband.floor_pn = 501; },
      [](Exchange& e) { e.reply.epoch = 4; },
      [](Exchange& e) { e.reply.contact_state = ContactState::kContact; },
      [](Exchange& e) { e.reply.fault_bits = kFaultForceLimit; },
      [](Exchange& e) { e.reply.tip.hold = 5; },
      [](Exchange& e) { e.reply.model.version = 9; },
      [](Exchange& e) { e.reply.particle.status = ParticleStatus::kPushed; },
      [](Exchange& e) { e.reply.port.energy_sent_aj = 1e-9; },
      [](Exchange& e) {
        e.reply.port.wave_sum = {0, 1e-9, 0};
      },
      [](Exchange& e) { e.reply.port.wave_energy_aj = 1e-9; },
      [](Exchange& e) { e.reply.measurement_age_ns = kNeverMeasuredNs; },
      [](Exchange& e) { e.reply.session_id = 8; },
  };
  int which = 0;
  for (const Change& change : changes) {
    SCOPED_TRACE(which++);
    Exchange e;
    EXPECT_TRUE(e.next(20));
    EXPECT_FALSE(e.next(20));
    change(e);
    EXPECT_TRUE(e.next(20));
    EXPECT_FALSE(e.next(20)) << "once";
  }
  // What is no news: place, deflection, energies, age of a measured force, particle's place.
  Exchange e;
  EXPECT_TRUE(e.next(20));
  e.reply.tip_pos_w_nm.z() = 3;
  e.reply.deflection_nm = 1;
  e.reply.energy_in_aj = 1e6;
  e.reply.energy_out_aj = 1e6;
  e.reply.measurement_age_ns = 5'000'000;
  e.reply.particle.pos_w_nm.x() = 1;
  EXPECT_FALSE(e.next(20));
}

TEST(ReplyGate, AWaveIsAlwaysSentAndALogsReplyToo) {
  Exchange e;
  e.command.control.method = kMethodWave;
  for (int k = 0; k < 20; ++k) EXPECT_TRUE(e.next(20));
  e.command.control.method = kMethodKs;
  EXPECT_TRUE(e.next(20));
  e.reply.steps.executed = 1;
  for (int k = 0; k < 20; ++k) EXPECT_TRUE(e.next(20));
}

// Between two replies lie 6 ms at most, as long as commands keep their rate; at a low one every second is left out, and
// they lie 10 ms apart at most.
TEST(ReplyGate, NoTwoRepliesAreFurtherApartThanSixMillisecondsOrTen) {
  for (const double rate_hz :
       {50.0, 100.0, 166.0, 200.0, 320.0, 340.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0}) {
    Exchange e;
    const auto spacing_ns = static_cast<std::uint64_t>(std::llround(1e9 / rate_hz));
    std::uint64_t last_ns = 0, longest_ns = 0, sent = 0;
    for (int k = 0; k < 1000; ++k) {
      if (!e.next(20, 1 / rate_hz)) continue;
      if (last_ns != 0) longest_ns = std::max(longest_ns, e.command.send_time_ns - last_ns);
      last_ns = e.command.send_time_ns;
      ++sent;
    }
    // As many as fit are left out.
    const std::uint64_t fit = 6'000'000 / spacing_ns, twice_ns = 2 * spacing_ns;
    const std::uint64_t expected_ns = fit >= 2                 ? std::min<std::uint64_t>(fit, 33) * spacing_ns
                                      : twice_ns <= 10'000'000 ? twice_ns
                                                               : spacing_ns;
    EXPECT_EQ(longest_ns, expected_ns) << rate_hz;
    EXPECT_LE(1000.0 / static_cast<double>(sent), 33.1) << rate_hz;
  }
}

// A station that says nonsense of its times is answered; by none of it for ever.
TEST(ReplyGate, TimesThatAreWrongEndNothing) {
  for (const std::uint64_t step_ns :
       {std::uint64_t{0}, ~std::uint64_t{0} - 999'999, std::uint64_t{1} << 63}) {
    Exchange e;
    int in_row = 0, most = 0;
    for (int k = 0; k < 1000; ++k) {
      e.command.send_time_ns += step_ns;
      in_row = e.gate.wants(e.reply, e.command, 1e-6) ? 0 : in_row + 1;
      most = std::max(most, in_row);
    }
    EXPECT_LE(most, step_ns == 0 ? 32 : 0) << step_ns;
  }
  Exchange e;
  EXPECT_TRUE(e.next(20));
  EXPECT_TRUE(e.gate.wants(e.reply, e.command, std::nan("")));
  EXPECT_TRUE(e.gate.wants(e.reply, e.command, 1e300));
}

}  // namespace
}  // namespace telenano::link

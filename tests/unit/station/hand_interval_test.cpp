// The time between two positions of a hand that moves by the clock on the wall, when ticks come late.
#include <gtest/gtest.h>

#include <cmath>

#include "telenano/common/rt/clock.h"
#include "telenano/master/loop/station_loop.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::loop {
namespace {

class NoNetwork final : public net::Datagram {
 public:
  net::SendStatus send(std::span<const std::uint8_t>, const net::Address&) noexcept override {
    return net::SendStatus::kSent;
  }
  bool receive(std::span<std::uint8_t>, net::Received&) noexcept override { return false; }
};

/// A hand that moves by itself, at constant speed, whenever it is looked at.
class RealHand final : public device::HapticDevice {
 public:
  RealHand(const rt::Clock& clock, double speed_m_s) : clock_(clock), speed_m_s_(speed_m_s) {
    info_ = station::StationRig::device();
    info_.moves_by_itself = true;
  }
  const device::DeviceInfo& info() const noexcept override { return info_; }
  void read(device::DeviceReading& reading) noexcept override {
    reading = {};
    reading.hand_pos_h_m.x() = speed_m_s_ * 1e-9 * static_cast<double>(clock_.now_ns());
  }
  Vec3 write_force(const Vec3& force) noexcept override { return force; }

 private:
  const rt::Clock& clock_;
  double speed_m_s_;
  device::DeviceInfo info_;
};

/// Ticks of 1 ms, every tenth late by `late_ns`, as a timer would give them. True when the velocity trip
/// acted.
bool trips(double speed_m_s, std::int64_t late_ns, double* fastest_m_s = nullptr) {
  rt::VirtualClock clock;
  RealHand hand(clock, speed_m_s);
  NoNetwork network;
  link::ClientSession client{link::ClientConfig{}};
  client.start(0);
  station::Station station{station::StationConfig{}, hand.info(), {10, 0, 500}};
  StationLoop loop{hand, network, net::Address{}, client, station, &clock};
  recording::Sample sample;
  constexpr std::int64_t kPeriodNs = 1'000'000;
  std::int64_t due_ns = kPeriodNs;
  for (int k = 0; k < 500; ++k) {
    const std::int64_t woke_ns = due_ns + (k % 10 == 5 ? late_ns : 0);
    const std::int64_t missed = (woke_ns - due_ns) / kPeriodNs;
    clock.advance_to(woke_ns);
    loop.tick(woke_ns, 1e-9 * static_cast<double>(kPeriodNs * (1 + missed)), sample);
    if (fastest_m_s != nullptr) *fastest_m_s = std::max(*fastest_m_s, loop.trace().hand_vel_h_m_s.norm());
    due_ns += kPeriodNs * (1 + missed);
  }
  return (station.latched_faults() & station::kFaultVelocityTrip) != 0;
}

TEST(HandInterval, ALateTickDoesNotMakeAHandTooFast) {
  for (const std::int64_t late_ns : {0, 10'000, 300'000, 900'000, 999'999, 1'500'000, 7'900'000}) {
    double fastest_m_s = 0;
    EXPECT_FALSE(trips(0.4, late_ns, &fastest_m_s)) << late_ns;
    EXPECT_LE(fastest_m_s, 0.4 * (1 + 1e-9)) << late_ns;  // positions of 0.2 m leave 1e-16/1e-3 of rounding
    EXPECT_TRUE(trips(0.51, late_ns)) << late_ns << ": a hand that is too fast is seen all the same";
  }
}

// A tick that is late takes the hand's time from its last position, and the one after it a whole period: the
// intervals add up to more than the time on the wall, here to 5.75 s in 5 s. A server executes logged steps
// no faster than the wall goes (link::StepReceiver: 1.001 of it, and 5 s in advance), so the steps must not
// add up so. The bound is what the station lets them run ahead, 0.1 s, and one tick.
TEST(HandInterval, StepsTakeNoLongerThanTheTimeThatHasPassed) {
  for (const std::int64_t late_ns : {0, 300'000}) {
    station::Station station{station::StationConfig{}, station::StationRig::device(), {10, 0, 500}};
    station.begin_session(station::StationRig::welcome_with_log());
    constexpr std::int64_t kPeriodNs = 1'000'000;
    constexpr std::int64_t kTicks = 5000;
    std::int64_t last_ns = 0;
    std::int64_t steps_ns = 0;
    for (std::int64_t k = 1; k <= kTicks; ++k) {
      station::StationInput input;
      input.time_ns = k * kPeriodNs + (k % 2 == 1 ? late_ns : 0);
      input.session_up = true;
      input.next_step = static_cast<std::uint64_t>(k);
      const std::int64_t interval_ns = std::max(kPeriodNs, input.time_ns - last_ns);
      last_ns = input.time_ns;
      station::StationOutput output;
      station.step(input, 1e-9 * static_cast<double>(interval_ns), output);
      ASSERT_TRUE(output.has_step);
      if (late_ns == 0) {
        ASSERT_EQ(output.step.dt_ns, kPeriodNs) << k;  // nothing is taken from a good one
      }
      steps_ns += output.step.dt_ns;
      ASSERT_LE(steps_ns, k * kPeriodNs + 101'000'000) << k;
    }
    EXPECT_GE(steps_ns, kTicks * kPeriodNs) << "nor are they less";
  }
}

}  // namespace
}  // namespace telenano::loop

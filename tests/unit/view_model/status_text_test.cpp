#include "telenano/master/view_model/status_text.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "telenano/common/link/messages.h"
#include "telenano/master/station/station.h"

namespace telenano::view_model {
namespace {

recording::Sample in_mode(station::Mode mode) {
  recording::Sample sample;
  sample.station_mode = static_cast<std::uint32_t>(mode);
  sample.buttons = device::kButtonDeadman;
  return sample;
}

// Every fault that the station names is told, in words of its own.
TEST(Words, TellEveryFaultOfTheStation) {
  std::set<std::string> told;
  for (std::uint32_t bit = 0; std::string(station::fault_name(1u << bit)) != "none"; ++bit) {
    recording::Sample sample = in_mode(station::Mode::kEngaged);
    sample.station_faults = 1u << bit;
    const auto messages = force_text(sample);
    ASSERT_EQ(messages.size(), 1u) << station::fault_name(1u << bit);
    EXPECT_TRUE(told.insert(messages[0].text).second) << messages[0].text;
  }
  EXPECT_GE(told.size(), 10u);
}

TEST(Words, TellEveryFaultOfTheSlave) {
  std::set<std::string> told;
  for (std::uint32_t bit = 0; bit < 6; ++bit) {
    const auto messages = slave_text(1u << bit);
    ASSERT_EQ(messages.size(), 1u) << bit;
    told.insert(messages[0].text);
  }
  EXPECT_EQ(slave_text(link::kFaultShare).size(), 1u);
  told.insert(slave_text(link::kFaultShare)[0].text);
  EXPECT_EQ(told.size(), 7u);
  EXPECT_TRUE(slave_text(0).empty());
}

TEST(Words, TellWhatTheParticleDoes) {
  std::set<std::string> told;
  for (std::uint32_t status = 0; status < 5; ++status)  // one more than there are
    told.insert(particle_text(static_cast<link::ParticleStatus>(status)));
  EXPECT_EQ(told.size(), 5u);
}

TEST(Words, TheGravestComesFirst) {
  recording::Sample sample = in_mode(station::Mode::kStopped);
  sample.station_faults = station::kFaultStopPressed | station::kFaultDeviceFailed | station::kFaultStale;
  const auto messages = force_text(sample);
  ASSERT_GE(messages.size(), 3u);
  EXPECT_NE(messages[0].text.find("device has failed"), std::string::npos);
  EXPECT_EQ(messages[0].mood, Mood::kAlarm);
  EXPECT_EQ(messages[2].mood, Mood::kWarning);
}

TEST(Words, SayWhyThereIsNoForceInEveryModeWithoutIt) {
  for (const auto mode : {station::Mode::kIdle, station::Mode::kHeld, station::Mode::kHoming})
    EXPECT_FALSE(force_text(in_mode(mode)).empty()) << station::mode_name(mode);
  EXPECT_TRUE(force_text(in_mode(station::Mode::kEngaged)).empty());
  recording::Sample ready = in_mode(station::Mode::kReady);
  ready.buttons = 0;
  EXPECT_NE(force_text(ready).at(0).text.find("deadman"), std::string::npos);
  EXPECT_NE(force_text(ready, device::ForceOffCause::kNone, true).at(0).text.find("left button"),
            std::string::npos);
  ready.buttons = device::kButtonClutch | device::kButtonDeadman;
  EXPECT_NE(force_text(ready).at(0).text.find("Clutch"), std::string::npos);
  EXPECT_NE(force_text(in_mode(station::Mode::kEngaged), device::ForceOffCause::kUsb).at(0).text.find("USB"),
            std::string::npos);
}

// Whoever looks on is told so, in the state and as the reason for the missing force, and is not asked to take
// hold of what would move nothing.
TEST(Words, AnObserverIsToldSo) {
  for (const auto mode : {station::Mode::kReady, station::Mode::kEngaged}) {
    recording::Sample sample = in_mode(mode);
    sample.limit_flags = recording::kLimitObserves;
    sample.buttons = 0;
    EXPECT_EQ(mode_text(sample).text, "Observing");
    const auto messages = force_text(sample);
    ASSERT_EQ(messages.size(), 1u);
    EXPECT_NE(messages[0].text.find("another session's"), std::string::npos);
  }
  recording::Sample stopped = in_mode(station::Mode::kStopped);
  stopped.limit_flags = recording::kLimitObserves;
  EXPECT_EQ(mode_text(stopped).text, "Stopped");
}

// From a fifth of a second on, against the server's age and, before any answer, the session's.
TEST(Words, ALostServerIsToldAtOnceAndForHowLongItIsWaitedFor) {
  recording::Sample sample = in_mode(station::Mode::kHeld);
  sample.time_s = 30;
  sample.reply_age_ms = 12;
  EXPECT_EQ(silent_s(sample), 0);
  sample.reply_age_ms = 250;
  EXPECT_NEAR(silent_s(sample), 0.25, 1e-12);
  sample.reply_age_ms = std::numeric_limits<double>::infinity();
  EXPECT_EQ(silent_s(sample), 30);
  EXPECT_EQ(silence_text(3.24, 10),
            "No answer from the server for 3.2 s: what is shown is old; the session ends in 7 s");
  EXPECT_EQ(silence_text(11, 10),
            "No answer from the server for 11.0 s: what is shown is old; the session ends in 0 s");
  EXPECT_EQ(silence_text(1, 0), "No answer from the server for 1.0 s: what is shown is old");
}

// A tip on a slope: 1.7 nN along z, and 12.7 in all (√(12.6² + 0.1² + 1.7²) = 12.71).
TEST(Words, TellTheWholeForce) {
  const Vec3 force(12.6, -0.1, 1.7);
  EXPECT_EQ(force_size_text(force), "push 12.7 nN");
  EXPECT_EQ(force_size_text(-force), "pull 12.7 nN");
  EXPECT_EQ(force_parts_text(force), "x +12.6  y -0.1  z +1.7 nN");
  EXPECT_EQ(force_parts_text(force, false), "+12.6 -0.1 +1.7");
  EXPECT_EQ(force_parts_text({0.001, -0.001, 0.5}), "x +0.00  y +0.00  z +0.50 nN");
  EXPECT_EQ(force_parts_text({300, -4, 12}), "x +300  y -4  z +12 nN");
  EXPECT_EQ(force_parts_text({std::numeric_limits<double>::quiet_NaN(), 0, 0}), "–");
}

TEST(Words, EveryModeHasItsOwn) {
  std::set<std::string> names;
  for (int mode = 0; mode <= static_cast<int>(station::Mode::kHoming); ++mode)
    names.insert(mode_text(in_mode(static_cast<station::Mode>(mode))).text);
  EXPECT_EQ(names.size(), 6u);
  EXPECT_FALSE(names.contains("Unknown"));
  EXPECT_EQ(mode_text(in_mode(static_cast<station::Mode>(99))).text, "Unknown");
}

TEST(Words, TellOfTheContact) {
  ShownContact contact;
  EXPECT_EQ(contact_area_text(contact), "needs a twin");
  EXPECT_EQ(adhesion_text(contact), "–");
  contact.area_known = true;
  contact.adhesion_nn = 38.9;
  EXPECT_EQ(contact_area_text(contact), "none");
  EXPECT_EQ(adhesion_text(contact), "lets go at 38.9 nN");
  contact.radius_nm = 2;
  EXPECT_EQ(contact_area_text(contact), "radius 2.00 nm, 12.6 nm²");
  EXPECT_EQ(method_text(control::Method::kTank, true), "tank, by the link");
  EXPECT_EQ(method_text(control::Method::kTank, false), "tank");
}

TEST(Words, ChooseUnits) {
  EXPECT_EQ(length_text(12.34), "12.3 nm");
  EXPECT_EQ(length_text(-0.277), "-277 pm");
  EXPECT_EQ(length_text(1234), "1.23 µm");
  EXPECT_EQ(length_text(0), "0.00 nm");
  EXPECT_EQ(length_text(999.6), "1.00 µm");
  EXPECT_EQ(force_text(0.0123), "12.3 pN");
  EXPECT_EQ(force_text(2.5e6), "2.50 mN");
  EXPECT_EQ(time_text(83), "83.0 µs");
  EXPECT_EQ(time_text(2.5e6), "2.50 s");
  EXPECT_EQ(length_text(std::numeric_limits<double>::quiet_NaN()), "–");
}

}  // namespace
}  // namespace telenano::view_model

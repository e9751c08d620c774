#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/recording/summary_builder.h"
#include "tests/support/alloc_guard.h"
#include "tests/unit/recording/numbered_row.h"

namespace telenano::recording {
namespace {

/// A touch and go at 1 kHz: in contact in the ticks 300..799, deepest 4 nm below the surface at 500.
Sample row(std::int64_t i) {
  Sample s;
  s.tick = i + 1;
  s.time_s = 1e-3 * static_cast<double>(i);
  const double x = static_cast<double>(i - 500);
  s.contact_state = i >= 300 && i < 800 ? (i < 310 ? 2 : 3) : 1;  // a neck first
  s.tip_target_w_nm = {10, 20, 100 + 1e-4 * x * x - 4};
  s.tip_pos_w_nm = s.tip_target_w_nm;
  s.force_w_nn = {0, 0, i == 500 ? 30.0 : i == 799 ? -25.0 : i == 299 ? -26.0 : 0.0};
  s.hand_pos_h_m = {0, 0, 1e-3 * std::cos(1e-2 * static_cast<double>(i))};
  s.hand_force_applied_h_n = {i % 2 == 0 ? 0.3 : 0.0, 0, 0.4};
  s.hand_force_scaled_h_n = {0, 3, 4};
  s.limit_flags =
      (i % 4 == 0 ? kLimitDamper : 0u) | (i % 10 == 0 ? kLimitClamp : 0u) | (i == 7 ? kLimitStale : 0u);
  s.damper_n_s_m = i % 4 == 0 ? 2.5 : 0.0;
  s.energy_j = 1e-3 * std::sin(1e-2 * static_cast<double>(i));
  s.energy_in_j = 1e-6 * static_cast<double>(i);
  s.energy_out_j = 5e-7 * static_cast<double>(i);
  s.reply_sequence = i;
  s.rtt_us = static_cast<double>(1 + i);
  s.lateness_us = i % 100 == 0 ? 400 : 3;
  s.step_us = 12;
  s.lost = i / 250;
  s.station_faults = i == 900 ? 4 : 0;
  return s;
}

constexpr std::int64_t kRows = 1000;

Summary of_rows(const SummaryContext& context) {
  SummaryBuilder builder(context);
  for (std::int64_t i = 0; i < kRows; ++i) builder.add(row(i));
  return builder.finish();
}

class SummaryTest : public ::testing::Test {
 protected:
  void SetUp() override {
    file_ =
        std::filesystem::temp_directory_path() / ("telenano_summary_" + std::to_string(::getpid()) + ".h5");
  }
  void TearDown() override { std::filesystem::remove(file_); }
  std::filesystem::path file_;
};

TEST_F(SummaryTest, GivesTheKnownAnswers) {
  const Summary s = of_rows({1000, 100.0});
  EXPECT_EQ(s.rows, 1000u);
  EXPECT_NEAR(s.duration_s, 0.999, 1e-12);
  EXPECT_EQ(s.pull_off_force_nn, 25) << "in contact only: the attraction just before it is no adhesion";
  EXPECT_EQ(s.largest_attraction_nn, 26);
  EXPECT_EQ(s.peak_repulsion_nn, 30);
  EXPECT_TRUE(s.depth_below_surface);
  EXPECT_NEAR(s.greatest_depth_nm, 4, 1e-12);
  EXPECT_NEAR(of_rows({}).greatest_depth_nm, 4, 1e-12) << "contact began 200 ticks earlier, 4 nm higher";
  EXPECT_FALSE(of_rows({}).depth_below_surface);
  EXPECT_EQ(s.contact_fraction, 0.5);
  EXPECT_EQ(s.peak_hand_force_n, std::sqrt(0.3 * 0.3 + 0.4 * 0.4));
  EXPECT_EQ(s.peak_scaled_force_n, 5);
  EXPECT_NEAR(s.force_step_rms_n, 0.3, 1e-12);
  EXPECT_NEAR(s.hand_z_max_mm, 1, 1e-12);
  // Of 1, 2, … 1000 µs without the first row, which has no reply; a bin is 1/16 of its value wide.
  EXPECT_NEAR(s.rtt_us.p50, 501, 501.0 / 16);
  EXPECT_NEAR(s.rtt_us.p99, 991, 991.0 / 16);
  EXPECT_EQ(s.rtt_us.max, 1000);
  EXPECT_EQ(s.replies, 999);
  EXPECT_EQ(s.lost, 3);
  EXPECT_EQ(s.damper_duty, 0.25);
  EXPECT_EQ(s.clamp_duty, 0.1);
  EXPECT_EQ(s.controller_duty, 0.3) << "every twentieth tick has both";
  EXPECT_EQ(s.damper_max_n_s_m, 2.5);
  EXPECT_EQ(s.stale_ticks, 1u);
  EXPECT_EQ(s.lateness_us.max, 400);
  EXPECT_NEAR(s.step_us.p50, 12, 12.0 / 16);
  EXPECT_EQ(s.missed_ticks, 0);
  EXPECT_EQ(s.station_faults, 4u);
}

TEST_F(SummaryTest, FaultsAreToldByName) {
  Summary s;
  const auto faults = [&s] { return summary_lines(s).back().second; };
  EXPECT_EQ(faults(), "none");
  s.station_fault_names = "stop pressed; too fast";
  s.slave_fault_names = "force limit; border; not finite; retracted";
  s.fault_bits = 1u << 3;
  s.station_faults = 1u << 0;
  EXPECT_EQ(faults(), "slave: retracted; station: stop pressed");
  s.fault_bits = 0;
  s.station_faults = 3;
  EXPECT_EQ(faults(), "station: stop pressed, too fast");
  s.station_faults = 1u << 2 | 1u << 31;  // of a newer program
  EXPECT_EQ(faults(), "station: bit 2, bit 31");
}

TEST_F(SummaryTest, AFileGivesTheSameAsTheLoop) {
  Recorder recorder({.path = file_, .queue_rows = kRows + 1},
                    {.rate_hz = 1000, .extra = {{"surface_z_w_nm", "100"}}});
  for (std::int64_t i = 0; i < kRows; ++i) recorder.push(row(i));
  recorder.close();
  const Summary from_file = summarise(RecordingReader(file_));
  EXPECT_EQ(summary_text(from_file), summary_text(of_rows({1000, 100.0})));
  EXPECT_FALSE(from_file.cut_short);
}

TEST_F(SummaryTest, RowsComeBackBitForBit) {
  constexpr std::int64_t kMany = 5000;  // more than a chunk of the file
  Recorder recorder({.path = file_, .queue_rows = kMany + 1}, {});
  for (std::int64_t i = 0; i < kMany; ++i) recorder.push(numbered_row(i, 1e-3 * static_cast<double>(i)));
  recorder.close();
  const RecordingReader reader(file_);
  std::vector<Sample> samples(3000);
  reader.read_samples(1500, samples);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto number = static_cast<std::int64_t>(i) + 1500;
    const Sample expected = numbered_row(number, 1e-3 * static_cast<double>(number));
    ASSERT_EQ(std::memcmp(&samples[i], &expected, sizeof expected), 0) << "row " << number;
  }
  EXPECT_THROW(reader.read_samples(4000, samples), UserError);
}

TEST_F(SummaryTest, CountsPeriodsWithoutATickButNotRowsThatWereDropped) {
  SummaryBuilder missed({1000, {}});
  SummaryBuilder dropped({1000, {}});
  for (std::int64_t i = 0; i < 100; ++i) {
    Sample s;
    s.tick = i;
    // 20 periods are lost in the middle; the last tick starts most of a period late.
    s.time_s = 1e-3 * static_cast<double>(i < 50 ? i : i + 20) + (i == 99 ? 9e-4 : 0);
    s.lateness_us = i == 99 ? 900 : 0;
    missed.add(s);
    s.tick = i < 50 ? i : i + 20;
    dropped.add(s);
  }
  EXPECT_EQ(missed.finish().missed_ticks, 20);
  EXPECT_EQ(dropped.finish().missed_ticks, 0);
}

TEST_F(SummaryTest, RepliesGoOnCountingInANewSession) {
  SummaryBuilder builder;
  for (const std::int64_t sequence : {1, 2, 500, 1, 2, 40}) {
    Sample s;
    s.reply_sequence = sequence;
    builder.add(s);
  }
  EXPECT_EQ(builder.finish().replies, 540);
}

TEST_F(SummaryTest, SurvivesNonFiniteRowsAndNone) {
  EXPECT_EQ(SummaryBuilder().finish().rows, 0u);
  EXPECT_EQ(summary_text(SummaryBuilder().finish()).find("pull-off"), std::string::npos)
      << "nothing was touched";
  SummaryBuilder builder;
  Sample s = row(500);
  builder.add(s);
  s.rtt_us = s.lateness_us = s.force_w_nn[2] = s.tip_pos_w_nm[2] = std::numeric_limits<double>::quiet_NaN();
  s.step_us = std::numeric_limits<double>::infinity();
  s.reply_sequence = 501;
  builder.add(s);
  EXPECT_EQ(builder.finish().peak_repulsion_nn, 30);
}

TEST_F(SummaryTest, AddTakesNoMemory) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "a sanitizer owns malloc";
  SummaryBuilder builder({1000, 100.0});
  const support::AllocGuard guard;
  for (std::int64_t i = 0; i < kRows; ++i) builder.add(row(i));
  const Summary s = builder.finish();
  EXPECT_EQ(guard.allocations(), 0u);
  EXPECT_EQ(s.rows, 1000u);
}

}  // namespace
}  // namespace telenano::recording

#include "telenano/master/view_model/playback.h"

#include <gtest/gtest.h>

#include <limits>

namespace telenano::view_model {
namespace {

// 100 s at 10 Hz, from 5 s on.
Playback made() {
  std::vector<recording::Sample> rows(1000);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    rows[i].tick = static_cast<std::int64_t>(i);
    rows[i].time_s = 5 + 0.1 * static_cast<double>(i);
  }
  return Playback(std::move(rows), {{10, "a"}, {60, "b"}, {60.5, "c"}});
}

TEST(Playback, HandsOutEveryRowOnceWhilePlaying) {
  Playback playback = made();
  Playback::Passed passed = playback.take();
  EXPECT_TRUE(passed.anew);
  EXPECT_EQ(passed.first, 0u);
  EXPECT_EQ(passed.end, 1u);
  std::size_t next = passed.end;
  for (int frame = 0; frame < 7000; ++frame) {
    playback.advance(1.0 / 60);
    passed = playback.take();
    ASSERT_FALSE(passed.anew);
    ASSERT_EQ(passed.first, next);
    ASSERT_GE(passed.end, passed.first);
    next = passed.end;
    if (passed.end > 0) {
      ASSERT_LE(playback.row(passed.end - 1).time_s, playback.time_s());
    }
  }
  EXPECT_EQ(next, 1000u);
  EXPECT_FALSE(playback.playing());
  EXPECT_EQ(playback.time_s(), playback.end_s());
  playback.play(true);  // from the beginning
  EXPECT_EQ(playback.time_s(), 5);
  EXPECT_TRUE(playback.take().anew);
}

TEST(Playback, SpeedIsSecondsOfTheRecordingASecond) {
  Playback playback = made();
  playback.set_speed(8);
  for (int frame = 0; frame < 60; ++frame) playback.advance(1.0 / 60);
  EXPECT_NEAR(playback.time_s(), 5 + 8, 1e-12);  // sixty sums
  playback.set_speed(1e9);
  EXPECT_EQ(playback.speed(), Playback::kFastest);
  playback.set_speed(0);
  playback.set_speed(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(playback.speed(), Playback::kFastest);
  playback.play(false);
  const double here_s = playback.time_s();
  playback.advance(1);
  EXPECT_EQ(playback.time_s(), here_s);
}

TEST(Playback, ALeapShowsThirtySecondsBeforeItAgain) {
  Playback playback = made();
  playback.take();
  for (const double to_s : {80.0, 50.0}) {
    playback.seek(to_s);
    const Playback::Passed passed = playback.take();
    EXPECT_TRUE(passed.anew);
    EXPECT_NEAR(playback.row(passed.first).time_s, to_s - Playback::kBeforeS, 0.1 + 1e-9);  // a row's time
    EXPECT_NEAR(playback.row(passed.end - 1).time_s, to_s, 0.1 + 1e-9);
    EXPECT_LE(playback.row(passed.end - 1).time_s, to_s + 1e-9);
    EXPECT_FALSE(playback.take().anew);
  }
  playback.seek(-1);
  EXPECT_EQ(playback.time_s(), 5);
  EXPECT_EQ(playback.take().end, 1u);  // never nothing at all
  playback.seek(1e9);
  EXPECT_EQ(playback.time_s(), playback.end_s());
  playback.seek(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(playback.time_s(), playback.end_s());
}

TEST(Playback, GoesFromMarkToMark) {
  Playback playback = made();
  playback.play(false);
  playback.seek_mark(1);
  EXPECT_EQ(playback.time_s(), 10);
  ASSERT_NE(playback.newest_mark(), nullptr);
  EXPECT_EQ(playback.newest_mark()->text, "a");
  playback.seek_mark(1);
  playback.seek_mark(1);
  EXPECT_EQ(playback.time_s(), 60.5);
  EXPECT_EQ(playback.newest_mark()->text, "c");
  playback.seek_mark(-1);
  EXPECT_EQ(playback.time_s(), 60);
  playback.seek(30);
  EXPECT_EQ(playback.newest_mark(), nullptr);
  playback.seek(70);
  playback.seek_mark(1);
  EXPECT_EQ(playback.time_s(), playback.end_s());
  playback.seek(8);
  playback.seek_mark(-1);
  EXPECT_EQ(playback.time_s(), 5);
}

}  // namespace
}  // namespace telenano::view_model

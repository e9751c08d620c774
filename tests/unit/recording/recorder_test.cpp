#include "telenano/common/recording/recorder.h"

#include <gtest/gtest.h>
#include <hdf5.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/recording/recover.h"
#include "tests/support/alloc_guard.h"
#include "tests/unit/recording/numbered_row.h"

namespace telenano::recording {
namespace {

class RecorderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() /
              ("telenano_recorder_" + std::string(info->name()) + "_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path file(const char* name = "a.h5") const { return folder_ / name; }

  static std::string message_of(const std::function<void()>& act) {
    try {
      act();
    } catch (const UserError& error) {
      return error.what();
    }
    return "no UserError";
  }

  std::filesystem::path folder_;
};

// The recorder asks before each flush and at the end, and gives the rows the time of its newest sample.
TEST_F(RecorderTest, MarksComeBackInOrderWithTheTimeOfTheNewestSample) {
  std::uint32_t asked = 0;
  {
    RecorderOptions options{.path = file(), .flush_period_s = 0.02};
    options.newest_marks = [&asked](std::vector<MarkRow>& rows) {
      if (asked == 0) rows.push_back({99, MarkRow::kPlace, 0, 3});
      for (std::uint32_t i = 0; i < 700; ++i) rows.push_back({99, i, asked, 0.5 * i});
      ++asked;
    };
    Recorder recorder(options, {});
    for (std::int64_t i = 0; i < 30; ++i) {
      recorder.push(numbered_row(i, 1e-3 * static_cast<double>(i)));
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    recorder.close();
    EXPECT_FALSE(recorder.failed()) << recorder.failure();
  }
  ASSERT_GE(asked, 2u);
  for (const bool isolated : {false, true}) {
    const RecordingReader reader = isolated ? RecordingReader::isolated(file()) : RecordingReader(file());
    const std::vector<MarkRow> rows = reader.marks();
    ASSERT_EQ(rows.size(), 1 + 700u * asked);
    EXPECT_EQ(rows[0].column, MarkRow::kPlace);
    EXPECT_EQ(rows[0].value, 3);
    for (std::size_t i = 1; i < rows.size(); ++i) {
      ASSERT_EQ(rows[i].column, (i - 1) % 700);
      ASSERT_EQ(rows[i].row, (i - 1) / 700);
      ASSERT_EQ(rows[i].value, 0.5 * rows[i].column);
      ASSERT_GE(rows[i].time_s, rows[i - 1].time_s);
    }
    EXPECT_EQ(rows.back().time_s, numbered_row(29, 0.029).time_s);
  }
}

TEST_F(RecorderTest, EveryFieldComesBackUnderItsNameWithItsUnit) {
  constexpr std::int64_t kRows = 3000;  // more than two chunks
  {
    Recorder recorder({.path = file(), .flush_period_s = 0.02}, {.title = "round trip"});
    for (std::int64_t i = 0; i < kRows; ++i) {
      ASSERT_TRUE(recorder.push(numbered_row(i, 1e-3 * static_cast<double>(i))));
      if (i % 1000 == 0) {
        ASSERT_TRUE(recorder.push(make_event(i, 0.5, 3, "engaged", 9)));
        std::this_thread::sleep_for(
            std::chrono::milliseconds(30));  // so that several flushes fall in between
      }
    }
    recorder.close();
    EXPECT_FALSE(recorder.failed());
    EXPECT_EQ(recorder.rows_written(), static_cast<std::uint64_t>(kRows));
    EXPECT_EQ(recorder.rows_dropped(), 0u);
  }
  const RecordingReader reader(file());
  ASSERT_EQ(reader.rows(), static_cast<std::size_t>(kRows));
  EXPECT_TRUE(reader.closed());
  EXPECT_FALSE(reader.cut_short());
  EXPECT_EQ(reader.columns().size(), sample_columns().size());
  std::size_t field = 0;
  for (const Column& column : sample_columns()) {
    EXPECT_EQ(reader.unit(column.name), column.unit);
    EXPECT_EQ(reader.description(column.name), column.description);
    for (std::size_t component = 0; component < column.components; ++component) {
      const std::vector<double> values = reader.read(column.name, component);
      for (std::int64_t i = 0; i < kRows; i += 7) {
        const double expected = field == 0   ? static_cast<double>(i)
                                : field == 1 ? 1e-3 * static_cast<double>(i)
                                             : numbered_value(i, field, component);
        ASSERT_EQ(values[static_cast<std::size_t>(i)], expected) << column.name << " row " << i;
      }
    }
    ++field;
  }
  const std::vector<Event> events = reader.events();
  ASSERT_EQ(events.size(), 3u);
  EXPECT_EQ(events[2].tick, 2000);
  EXPECT_EQ(events[2].code, 3u);
  EXPECT_EQ(events[2].value, 9u);
  EXPECT_STREQ(events[2].text.data(), "engaged");
}

TEST_F(RecorderTest, ExplainsItself) {
  const std::string long_scene(200'000, 'x');  // more than an HDF5 object header holds
  Recorder({.path = file()}, {.title = "t",
                              .program = "telenano-master 0.1.0",
                              .command_line = "run --seed 5",
                              .scene_name = "flakes",
                              .scene_hash = "0123",
                              .scene_text = long_scene,
                              .station_text = "a = \"µ\"",
                              .seed = "5",
                              .rate_hz = 1000,
                              .extra = {{"method", "ks-clamp"}}})
      .close();
  const RecordingReader reader(file());
  EXPECT_EQ(reader.rows(), 0u);
  EXPECT_EQ(reader.configuration("scene_text"), long_scene);
  EXPECT_EQ(reader.configuration("station_text"), "a = \"µ\"");
  EXPECT_EQ(reader.configuration("method"), "ks-clamp");
  EXPECT_EQ(reader.configuration("start_time_utc").size(), 20u) << "filled in by the recorder";
  EXPECT_EQ(reader.configuration("git_commit"), "") << "unknown is left out";
}

TEST_F(RecorderTest, PushTakesNoMemory) {
  if (!support::AllocGuard::active()) GTEST_SKIP() << "a sanitizer owns malloc";
  Recorder recorder({.path = file()}, {});
  const Sample sample;
  const support::AllocGuard guard;
  for (int i = 0; i < 1000; ++i) recorder.push(sample);
  EXPECT_EQ(guard.allocations(), 0u);
}

TEST_F(RecorderTest, AFullQueueDropsAndCounts) {
  Recorder recorder({.path = file(), .queue_rows = 4}, {});
  std::uint64_t dropped = 0;
  for (int i = 0; i < 1000; ++i) dropped += recorder.push(numbered_row(i, 0)) ? 0 : 1;
  recorder.close();
  EXPECT_GT(dropped, 0u);
  EXPECT_EQ(recorder.rows_dropped(), dropped);
  EXPECT_EQ(recorder.rows_written() + dropped, 1000u);
  EXPECT_EQ(RecordingReader(file()).rows_dropped(), dropped);
}

TEST_F(RecorderTest, RefusesToOverwriteUnlessForced) {
  std::ofstream(file()) << "precious";
  const std::string message = message_of([&] { Recorder({.path = file()}, {}); });
  EXPECT_NE(message.find("a.h5: exists already"), std::string::npos) << message;
  std::string kept;
  std::ifstream(file()) >> kept;
  EXPECT_EQ(kept, "precious");
  Recorder({.path = file(), .overwrite = true}, {}).close();
  EXPECT_EQ(RecordingReader(file()).rows(), 0u);
}

TEST_F(RecorderTest, RefusesWhatCannotBeWrittenInOneLine) {
  for (const std::filesystem::path& path : {folder_ / "no" / "such" / "folder.h5", folder_}) {
    const std::string message = message_of([&] { Recorder({.path = path, .overwrite = true}, {}); });
    EXPECT_NE(message.find(path.string()), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
  Recorder writer({.path = file()}, {});
  const std::string message = message_of([&] { Recorder({.path = file(), .overwrite = true}, {}); });
  EXPECT_NE(message.find("being recorded now"), std::string::npos) << message;
}

TEST_F(RecorderTest, RefusesForeignAndBrokenFilesInOneLine) {
  const auto expect_refused = [&](const char* name, const char* why) {
    for (const auto& act : {std::function<void()>([&] { RecordingReader reader(file(name)); }),
                            std::function<void()>([&] { recover(file(name)); })}) {
      const std::string message = message_of(act);
      EXPECT_NE(message.find(name), std::string::npos) << message;
      EXPECT_NE(message.find(why), std::string::npos) << message;
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
  };
  expect_refused("missing.h5", "no such file");
  std::ofstream(file("empty.h5")).close();
  expect_refused("empty.h5", "not a recording");
  std::ofstream(file("text.h5")) << "just text";
  expect_refused("text.h5", "not a recording");
  std::filesystem::create_directory(file("folder.h5"));
  expect_refused("folder.h5", "not a file");
  H5Fclose(H5Fcreate(file("foreign.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  expect_refused("foreign.h5", "not a Telenano recording");

  {
    Recorder recorder({.path = file("whole.h5")}, {});
    for (int i = 0; i < 5000; ++i) recorder.push(numbered_row(i, 0));
  }
  const auto size = std::filesystem::file_size(file("whole.h5"));
  for (const double part : {0.01, 0.1, 0.5, 0.99}) {
    std::filesystem::copy_file(file("whole.h5"), file("cut.h5"),
                               std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(file("cut.h5"),
                                 static_cast<std::uintmax_t>(static_cast<double>(size) * part));
    const std::string message = message_of([&] {
      const RecordingReader reader(file("cut.h5"));
      for (const std::string& column : reader.columns()) reader.read(column);
    });
    EXPECT_NE(message.find("cut.h5: "), std::string::npos) << part << ": " << message;
  }
}

TEST_F(RecorderTest, AsksForColumnsAndComponentsByName) {
  Recorder({.path = file()}, {}).close();
  const RecordingReader reader(file());
  EXPECT_TRUE(reader.has("rtt_us"));
  EXPECT_FALSE(reader.has("rtt"));
  EXPECT_NE(message_of([&] { reader.read("rtt"); }).find("no column 'rtt'"), std::string::npos);
  EXPECT_NE(message_of([&] { reader.read("hand_pos_h_m", 3); }).find("3 component(s)"), std::string::npos);
}

TEST_F(RecorderTest, RecoverLeavesAClosedFileAlone) {
  {
    Recorder recorder({.path = file()}, {});
    for (int i = 0; i < 10; ++i) recorder.push(numbered_row(i, 0));
  }
  const auto before = std::filesystem::last_write_time(file());
  const Recovered result = recover(file());
  EXPECT_TRUE(result.was_closed);
  EXPECT_EQ(result.rows, 10u);
  EXPECT_EQ(std::filesystem::last_write_time(file()), before);
}

}  // namespace
}  // namespace telenano::recording

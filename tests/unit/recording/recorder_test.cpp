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

DatagramRow numbered_datagram(std::int64_t tick) {
  const auto n = static_cast<std::uint64_t>(tick);
  DatagramRow row;
  row.tick = tick;
  row.came_ns = 1000 + tick;
  row.sequence = 2 * n;
  row.answers = 3 * n;
  row.executed = 5 * n;
  row.type = 6;
  row.state_hash = ~n;
  row.newest = 7 * n;
  row.break_step = 8 * n;
  row.breaks = static_cast<std::uint32_t>(n / 10);
  row.break_reason = 2;
  row.epoch = 77;
  return row;
}

StatePieceRow numbered_piece(std::int64_t tick, std::uint32_t piece) {
  StatePieceRow row;
  row.tick = tick;
  row.step = 11 + piece;
  row.state_hash = 0xfedcba9876543210u;
  row.breaks = 3;
  row.snapshot = 4;
  row.piece = piece;
  row.total = 1000;
  row.size = 432;
  for (std::size_t i = 0; i < row.data.size(); ++i) row.data[i] = static_cast<std::uint8_t>(i + piece);
  return row;
}

TEST_F(RecorderTest, WhatServersSayOfTheirLogAndTheirStatesComesBack) {
  constexpr std::int64_t kRows = 60;
  {
    Recorder recorder({.path = file(), .flush_period_s = 0.02}, {});
    for (std::int64_t i = 0; i < kRows; ++i) {
      ASSERT_TRUE(recorder.push(numbered_row(i, 1e-3 * static_cast<double>(i))));
      ASSERT_TRUE(recorder.push(numbered_datagram(i)));
      for (std::uint32_t piece = 0; piece < 2; ++piece) ASSERT_TRUE(recorder.push(numbered_piece(i, piece)));
      if (i % 20 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(30));
    }
    recorder.close();
    EXPECT_EQ(recorder.state_pieces_dropped(), 0u);
  }
  for (const bool isolated : {false, true}) {
    const RecordingReader reader = isolated ? RecordingReader::isolated(file()) : RecordingReader(file());
    const std::vector<StatePieceRow> pieces = reader.state_pieces();
    ASSERT_EQ(pieces.size(), 2u * kRows);
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      const StatePieceRow expected =
          numbered_piece(static_cast<std::int64_t>(i / 2), static_cast<std::uint32_t>(i % 2));
      ASSERT_EQ(std::memcmp(&pieces[i], &expected, sizeof expected), 0) << i;
    }
    const std::vector<DatagramRow> rows = reader.datagrams();
    ASSERT_EQ(rows.size(), static_cast<std::size_t>(kRows));
    for (std::size_t i = 1; i < rows.size(); ++i) {
      const DatagramRow expected = numbered_datagram(static_cast<std::int64_t>(i));
      ASSERT_EQ(std::memcmp(&rows[i], &expected, sizeof expected), 0) << i;
    }
  }
}

// However often a state is asked for, a recording stays bounded; what is missing is counted, and what is there
// has no hole.
TEST_F(RecorderTest, StatesAreWrittenUpToABoundAndWithoutAHole) {
  {
    Recorder recorder({.path = file(), .state_pieces_most = 50}, {});
    ASSERT_TRUE(recorder.push(numbered_row(0, 0)));
    for (std::uint32_t piece = 0; piece < 80; ++piece)
      ASSERT_EQ(recorder.push(numbered_piece(0, piece)), piece < 50);
    recorder.close();
    EXPECT_EQ(recorder.state_pieces_dropped(), 30u);
    EXPECT_FALSE(recorder.failed());
  }
  const std::vector<StatePieceRow> pieces = RecordingReader(file()).state_pieces();
  ASSERT_EQ(pieces.size(), 50u);
  for (std::uint32_t i = 0; i < 50; ++i) ASSERT_EQ(pieces[i].piece, i);
}

// A recording of before there were states, whose datagrams say less: what they say is read, the rest is zero.
TEST_F(RecorderTest, OlderRecordingsAreReadWithoutStates) {
  {
    Recorder recorder({.path = file()}, {});
    for (std::int64_t i = 1; i < 20; ++i) {
      ASSERT_TRUE(recorder.push(numbered_row(i, 1e-3 * static_cast<double>(i))));
      ASSERT_TRUE(recorder.push(numbered_datagram(i)));
    }
  }
  struct Older {
    std::int64_t tick, came_ns;
    std::uint64_t sequence, answers, steps_before, executed;
    std::uint32_t type, drop;
  };
  std::vector<Older> older;
  for (const DatagramRow& row : RecordingReader(file()).datagrams())
    older.push_back({row.tick, row.came_ns, row.sequence, row.answers, row.steps_before, row.executed,
                     row.type, row.drop});
  ASSERT_EQ(older.size(), 19u);
  {
    const hid_t h5 = H5Fopen(file().c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    ASSERT_GE(h5, 0);
    ASSERT_GE(H5Ldelete(h5, "/state_pieces", H5P_DEFAULT), 0);
    ASSERT_GE(H5Ldelete(h5, "/datagrams", H5P_DEFAULT), 0);
    const hid_t type = H5Tcreate(H5T_COMPOUND, sizeof(Older));
    H5Tinsert(type, "tick", offsetof(Older, tick), H5T_STD_I64LE);
    H5Tinsert(type, "came_ns", offsetof(Older, came_ns), H5T_STD_I64LE);
    H5Tinsert(type, "sequence", offsetof(Older, sequence), H5T_STD_U64LE);
    H5Tinsert(type, "answers", offsetof(Older, answers), H5T_STD_U64LE);
    H5Tinsert(type, "steps_before", offsetof(Older, steps_before), H5T_STD_U64LE);
    H5Tinsert(type, "executed", offsetof(Older, executed), H5T_STD_U64LE);
    H5Tinsert(type, "type", offsetof(Older, type), H5T_STD_U32LE);
    H5Tinsert(type, "drop", offsetof(Older, drop), H5T_STD_U32LE);
    const hsize_t rows = older.size();
    const hid_t space = H5Screate_simple(1, &rows, nullptr);
    const hid_t dataset = H5Dcreate2(h5, "/datagrams", type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    ASSERT_GE(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, older.data()), 0);
    H5Dclose(dataset), H5Sclose(space), H5Tclose(type), H5Fclose(h5);
  }
  for (const bool isolated : {false, true}) {
    const RecordingReader reader = isolated ? RecordingReader::isolated(file()) : RecordingReader(file());
    EXPECT_TRUE(reader.state_pieces().empty());
    const std::vector<DatagramRow> rows = reader.datagrams();
    ASSERT_EQ(rows.size(), 19u);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      DatagramRow expected = numbered_datagram(static_cast<std::int64_t>(i + 1));
      expected.state_hash = expected.newest = expected.break_step = expected.epoch = 0;
      expected.breaks = expected.break_reason = 0;
      ASSERT_EQ(std::memcmp(&rows[i], &expected, sizeof expected), 0) << i;
    }
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

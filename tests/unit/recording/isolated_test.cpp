// Files from anywhere are read in a process of its own: what happens there is one clear error here.
#include <gtest/gtest.h>
#include <hdf5.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <new>
#include <thread>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/child_call.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/recording/recording_source.h"
#include "telenano/common/recording/recover.h"
#include "telenano/common/recording/summary.h"
#include "tests/unit/recording/numbered_row.h"

namespace telenano::recording {
namespace {

template <class Error>
std::string message_of(const std::function<void()>& act) {
  try {
    act();
  } catch (const Error& error) {
    return error.what();
  }
  return "no such error";
}

std::string outcome_of(const ChildCall::Serve& serve,
                       std::chrono::seconds time_limit = std::chrono::seconds(60)) {
  return message_of<RunError>([&] { ChildCall("a.h5", serve, time_limit).ask("x"); });
}

TEST(ChildCall, AnswersAreThoseOfTheFunction) {
  const int here = ::getpid();
  ChildCall child("a.h5",
                  [](std::string_view request) { return std::string(request) + std::to_string(::getpid()); });
  const std::string answer = child.ask("pid ");
  EXPECT_EQ(answer.rfind("pid ", 0), 0u);
  EXPECT_NE(answer, "pid " + std::to_string(here)) << "in another process";
  EXPECT_EQ(child.ask("pid "), answer) << "always the same";
  const std::string large(3'000'000, 'x');  // more than a socket holds
  EXPECT_EQ(child.ask(large).size(), large.size() + answer.size() - 4);
}

TEST(ChildCall, ErrorsKeepTheirKind) {
  ChildCall child("a.h5", [](std::string_view request) -> std::string {
    if (request == "user") throw UserError("a.h5: no such column");
    throw RunError("a.h5: the disk is full");
  });
  EXPECT_EQ(message_of<UserError>([&] { child.ask("user"); }), "a.h5: no such column");
  EXPECT_EQ(message_of<RunError>([&] { child.ask("run"); }), "a.h5: the disk is full");
  EXPECT_EQ(message_of<UserError>([&] { child.ask("user"); }), "a.h5: no such column") << "and it goes on";
}

TEST(ChildCall, EveryKindOfEndIsOneClearLine) {
  const struct {
    const char* what;
    ChildCall::Serve serve;
    const char* said;
  } all[] = {
      {"crash", [](std::string_view) -> std::string { return ::raise(SIGSEGV), ""; },
       "crashed (Segmentation fault)"},
      {"abort", [](std::string_view) -> std::string { return ::raise(SIGABRT), ""; }, "crashed (Aborted)"},
      {"exit", [](std::string_view) -> std::string { ::_exit(3); }, "ended early"},
      {"no memory", [](std::string_view) -> std::string { throw std::bad_alloc(); },
       "do not fit into memory"},
  };
  for (const auto& one : all) {
    const std::string message = outcome_of(one.serve);
    EXPECT_EQ(message.rfind("a.h5: damaged: ", 0), 0u) << one.what << ": " << message;
    EXPECT_NE(message.find(one.said), std::string::npos) << one.what << ": " << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
}

TEST(ChildCall, ALoopWithoutEndIsEnded) {
  const auto forever = [](std::string_view) -> std::string {
    std::atomic<unsigned> turns{0};
    for (;;) ++turns;
  };
  EXPECT_NE(outcome_of(forever, std::chrono::seconds(1)).find("found no end"), std::string::npos);
}

TEST(ChildCall, ASleepWithoutEndIsEndedToo) {
  const auto asleep = [](std::string_view) -> std::string { return ::pause(), ""; };
  const std::string message = outcome_of(asleep, std::chrono::seconds(1));
  EXPECT_NE(message.find("found no end over it in 1 s"), std::string::npos) << message;
  EXPECT_EQ(message.find("damaged"), std::string::npos) << message;
}

TEST(ChildCall, AnAnswerIsWaitedForAsLongAsItIsWanted) {
  const auto slow = [](std::string_view request) {
    ::usleep(1'500'000);
    return std::string(request);
  };
  ChildCall child("a.h5", slow, std::chrono::seconds(1));
  EXPECT_EQ(child.ask("late", [] { return true; }), "late") << "the limit is the processor's time";
  EXPECT_FALSE(child.is_over());
  EXPECT_NE(message_of<RunError>([&] { child.ask("x", [] { return false; }); }).find("Killed"),
            std::string::npos);
  EXPECT_TRUE(child.is_over());
}

TEST(ChildCall, AskingAfterTheEndIsAnErrorToo) {
  ChildCall child("a.h5", [](std::string_view) -> std::string { ::_exit(0); });
  for (int i = 0; i < 2; ++i)
    EXPECT_NE(message_of<RunError>([&] { child.ask(""); }).find("ended early"), std::string::npos);
}

class IsolatedTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() /
              ("telenano_isolated_" + std::string(info->name()) + "_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path recorded(int rows) const {
    Recorder recorder({.path = folder_ / "a.h5"}, {.title = "isolated", .scene_name = "flakes"});
    for (int i = 0; i < rows; ++i) recorder.push(numbered_row(i, 1e-3 * i));
    recorder.push(make_event(7, 0.007, 2, "contact", 5));
    recorder.close();
    return folder_ / "a.h5";
  }
  /// Both ways of reading say so, in a line that names the file.
  static void expect_refused(const std::filesystem::path& file, const std::string& why) {
    const std::string plain = message_of<UserError>([&] {
      const RecordingReader reader(file);
      reader.events();
    });
    const std::string isolated = message_of<UserError>([&] {
      const auto reader = RecordingReader::isolated(file);
      reader.events();
    });
    EXPECT_EQ(isolated, plain);
    EXPECT_EQ(plain.rfind(file.string() + ": ", 0), 0u) << plain;
    EXPECT_NE(plain.find(why), std::string::npos) << plain;
  }

  std::filesystem::path folder_;
};

TEST_F(IsolatedTest, TheSameAsReadHere) {
  const auto file = recorded(2500);
  const RecordingReader here(file);
  const RecordingReader there = RecordingReader::isolated(file);
  EXPECT_EQ(there.path(), here.path());
  EXPECT_EQ(there.rows(), 2500u);
  EXPECT_EQ(there.columns(), here.columns());
  EXPECT_EQ(there.closed(), here.closed());
  EXPECT_EQ(there.cut_short(), here.cut_short());
  EXPECT_EQ(there.rows_dropped(), here.rows_dropped());
  EXPECT_EQ(there.configuration(), here.configuration());
  EXPECT_EQ(there.configuration("scene_name"), "flakes");
  EXPECT_TRUE(there.has("rtt_us"));
  EXPECT_FALSE(there.has("rtt"));
  for (const std::string& column : here.columns()) {
    EXPECT_EQ(there.unit(column), here.unit(column));
    EXPECT_EQ(there.description(column), here.description(column));
    EXPECT_EQ(there.read(column), here.read(column)) << column;
  }
  ASSERT_EQ(there.events().size(), 1u);
  EXPECT_STREQ(there.events()[0].text.data(), "contact");
  EXPECT_EQ(summary_lines(summarise(there)), summary_lines(summarise(here)));
  EXPECT_EQ(message_of<UserError>([&] { there.read("rtt"); }),
            message_of<UserError>([&] { here.read("rtt"); }));
  EXPECT_EQ(message_of<UserError>([&] { there.read("hand_pos_h_m", 3); }),
            message_of<UserError>([&] { here.read("hand_pos_h_m", 3); }));
}

TEST_F(IsolatedTest, ADamagedFileOfAKilledWriterIsNotWaitedForForEver) {
  // As a killed writer leaves it: still marked as being written, so that a reader takes what is damaged for
  // half written.
  {
    Recorder recorder({.path = folder_ / "live.h5", .flush_period_s = 0.01}, {});
    for (int i = 0; i < 20; ++i) recorder.push(numbered_row(i, 0));
    while (recorder.rows_written() < 20) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::filesystem::copy_file(folder_ / "live.h5", folder_ / "killed.h5");
  }
  const auto file = folder_ / "killed.h5";
  std::string bytes;
  {
    std::ifstream in(file, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(in), {});
  }
  // The checksum of every object header: the first one's is read with the file, others with what they belong
  // to.
  int spoilt = 0;
  for (std::size_t at = bytes.find("OHDR"); at != std::string::npos;
       at = bytes.find("OHDR", at + 4), ++spoilt)
    bytes[at + 6] = static_cast<char>(bytes[at + 6] ^ 0x10);
  ASSERT_GT(spoilt, 10);
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  const auto start = std::chrono::steady_clock::now();
  expect_refused(file, "");
  EXPECT_EQ(message_of<UserError>([&] { recover(file); }).rfind(file.string() + ": ", 0), 0u);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
}

// HDF5 writes as many values as the file says, into whatever room it is given: each of these wrote beyond it.

TEST_F(IsolatedTest, AVersionOfManyNumbersIsRefused) {
  const auto file = recorded(3);
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  H5Adelete(id, "format_version");
  const hsize_t many = 4096;
  const hid_t space = H5Screate_simple(1, &many, nullptr);
  H5Aclose(H5Acreate2(id, "format_version", H5T_STD_U32LE, space, H5P_DEFAULT, H5P_DEFAULT));
  H5Sclose(space);
  H5Fclose(id);
  expect_refused(file, "format_version");
}

TEST_F(IsolatedTest, ATextOfManyTextsIsNone) {
  const auto file = recorded(3);
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, 8);
  const hsize_t many = 4096;
  const hid_t space = H5Screate_simple(1, &many, nullptr);
  H5Adelete(id, "format");
  H5Aclose(H5Acreate2(id, "format", type, space, H5P_DEFAULT, H5P_DEFAULT));
  H5Sclose(space);
  H5Tclose(type);
  H5Fclose(id);
  expect_refused(file, "not a Telenano recording");
}

TEST_F(IsolatedTest, EventsInTwoDimensionsAreRefused) {
  const auto file = recorded(3);
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t old = H5Dopen2(id, "/events", H5P_DEFAULT);
  const hid_t type = H5Dget_type(old);
  H5Dclose(old);
  H5Ldelete(id, "/events", H5P_DEFAULT);
  const std::array<hsize_t, 2> size{1, 64};
  const hid_t space = H5Screate_simple(2, size.data(), nullptr);
  H5Dclose(H5Dcreate2(id, "/events", type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  H5Sclose(space);
  H5Tclose(type);
  H5Fclose(id);
  expect_refused(file, "no readable /events");
}

TEST_F(IsolatedTest, RowsThatWereNeverWrittenAreRefused) {
  const auto file = recorded(3);
  {
    const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const RecordingReader reader(file);
    for (const std::string& column : reader.columns()) {
      const hid_t dataset = H5Dopen2(id, ("/samples/" + column).c_str(), H5P_DEFAULT);
      const hid_t space = H5Dget_space(dataset);
      std::array<hsize_t, 2> size{};
      H5Sget_simple_extent_dims(space, size.data(), nullptr);
      H5Sclose(space);
      size[0] = hsize_t{1} << 40;  // 8 TB a column, in a file of a megabyte
      EXPECT_GE(H5Dset_extent(dataset, size.data()), 0);
      H5Dclose(dataset);
    }
    const std::array<std::int64_t, 4> progress{std::int64_t{1} << 40, 1, 0, 1};
    const hid_t dataset = H5Dopen2(id, "/progress", H5P_DEFAULT);
    H5Dwrite(dataset, H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, progress.data());
    H5Dclose(dataset);
    H5Fclose(id);
  }
  expect_refused(file, "more than fit into it");
}

// A file of a program that called the column otherwise is read by today's name, and a script that asks a new file
// for the former name finds the column.
TEST_F(IsolatedTest, ARenamedColumnIsFoundByBothNames) {
  const auto file = recorded(3);
  const std::vector<double> written = open_recording(file)->read("account_j", 0);
  ASSERT_EQ(written.size(), 3U);
  hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t by_former_name = H5Dopen2(id, "/samples/ledger_j", H5P_DEFAULT);
  ASSERT_GE(by_former_name, 0);
  std::array<double, 3> values{};
  EXPECT_GE(H5Dread(by_former_name, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  EXPECT_TRUE(std::equal(values.begin(), values.end(), written.begin()));
  H5Dclose(by_former_name);

  H5Ldelete(id, "/samples/ledger_j", H5P_DEFAULT);
  H5Lmove(id, "/samples/account_j", id, "/samples/ledger_j", H5P_DEFAULT, H5P_DEFAULT);
  H5Fclose(id);
  const auto former = open_recording(file);
  EXPECT_EQ(former->read("account_j", 0), written);
  const auto& columns = former->facts().columns;
  EXPECT_EQ(std::count(columns.begin(), columns.end(), "account_j"), 1);
  EXPECT_EQ(std::count(columns.begin(), columns.end(), "ledger_j"), 0);
  std::vector<Sample> rows(3);
  former->read_samples(0, rows);
  EXPECT_EQ(rows[2].account_j, written[2]);
}

TEST_F(IsolatedTest, AColumnInAnotherFileIsRefused) {
  const auto file = recorded(3);
  const auto other = folder_ / "secret";
  std::ofstream(other) << "0123456789abcdef";
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  H5Ldelete(id, "/samples/rtt_us", H5P_DEFAULT);
  const hsize_t two = 2;
  const hid_t space = H5Screate_simple(1, &two, nullptr);
  const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_external(creation, other.c_str(), 0, 16);
  H5Dclose(H5Dcreate2(id, "/samples/rtt_us", H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, creation, H5P_DEFAULT));
  H5Pclose(creation);
  H5Sclose(space);
  H5Fclose(id);
  expect_refused(file, "in other files");
}

}  // namespace
}  // namespace telenano::recording

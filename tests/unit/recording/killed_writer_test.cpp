// The recorder against a violent end: SIGKILL at random moments, and a disk that is full.
#include <gtest/gtest.h>
#include <hdf5.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/common/recording/recover.h"
#include "telenano/common/rt/steady_clock.h"
#include "tests/unit/recording/numbered_row.h"

namespace telenano::recording {
namespace {

class Child {
 public:
  explicit Child(const std::vector<std::string>& arguments) {
    std::array<int, 2> ends{};
    if (::pipe(ends.data()) != 0) std::abort();
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(ends[1], STDOUT_FILENO);
      ::close(ends[0]);
      ::close(ends[1]);
      std::vector<char*> argv{const_cast<char*>(WRITER_CHILD)};
      for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
      argv.push_back(nullptr);
      ::execv(WRITER_CHILD, argv.data());
      std::_Exit(127);
    }
    ::close(ends[1]);
    output_ = ::fdopen(ends[0], "r");
  }
  ~Child() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      wait();
    }
    std::fclose(output_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  std::string line() {
    std::array<char, 512> text{};
    if (std::fgets(text.data(), text.size(), output_) == nullptr) return {};
    return text.data();
  }
  void kill() const { ::kill(pid_, SIGKILL); }
  int wait() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return status;
  }

 private:
  pid_t pid_ = -1;
  FILE* output_ = nullptr;
};

class ViolentEndTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_violent_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
    path_ = folder_ / "killed.h5";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path folder_;
  std::filesystem::path path_;
};

/// Row i of every column is what numbered_row(i) put there, from row 0 without a gap.
void expect_rows_right(const RecordingReader& reader) {
  std::size_t field = 0;
  for (const Column& column : sample_columns()) {
    for (std::size_t component = 0; component < column.components && field != 1; ++component) {
      const std::vector<double> values = reader.read(column.name, component);
      for (std::size_t i = 0; i < values.size(); ++i) {
        const auto number = static_cast<std::int64_t>(i);
        const double expected =
            field == 0 ? static_cast<double>(number) : numbered_value(number, field, component);
        ASSERT_EQ(values[i], expected)
            << column.name << "[" << component << "] row " << i << " of " << values.size();
      }
    }
    ++field;
  }
  const std::vector<Event> events = reader.events();
  for (std::size_t i = 0; i < events.size(); ++i)
    ASSERT_EQ(events[i].tick, static_cast<std::int64_t>(100 * i));
}

double last_time_s(const RecordingReader& reader) {
  return reader.rows() == 0 ? 0.0 : reader.read("time_s").back();
}

/// Opens the file plainly, past our reader, and looks whether every column is exactly `rows` long.
void expect_plain_columns(const std::filesystem::path& path, std::size_t rows) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  ASSERT_GE(file, 0) << "does not open plainly";
  for (const Column& column : sample_columns()) {
    const hid_t dataset = H5Dopen2(file, (std::string("/samples/") + column.name).c_str(), H5P_DEFAULT);
    ASSERT_GE(dataset, 0) << column.name;
    const hid_t space = H5Dget_space(dataset);
    std::array<hsize_t, 2> size{};
    H5Sget_simple_extent_dims(space, size.data(), nullptr);
    EXPECT_EQ(size[0], rows) << column.name;
    H5Sclose(space);
    H5Dclose(dataset);
  }
  H5Fclose(file);
}

bool python_has_h5py() {
  return std::system("/usr/bin/python3 -c 'import h5py' >/dev/null 2>&1") == 0;
}

/// Opens the file plainly in another HDF5 program and reads every column whole.
int read_with_h5py(const std::filesystem::path& path, std::size_t rows) {
  const std::string script =
      "import h5py, sys\n"
      "f = h5py.File(sys.argv[1], 'r')\n"
      "n = int(sys.argv[2])\n"
      "for name, d in f['samples'].items():\n"
      "    assert d.shape[0] == n, (name, d.shape, n)\n"
      "    assert isinstance(d.attrs['unit'].decode() if isinstance(d.attrs['unit'], bytes) else "
      "d.attrs['unit'], str)\n"
      "    v = d[...]\n"
      "    assert len(v) == n\n"
      "assert list(f['samples/tick'][...]) == list(range(n))\n"
      "assert f['progress'][0] == n and f['progress'][3] == 2\n"
      "assert len(f['events'][...]) == f['progress'][1]\n"
      "assert len(f['configuration'].attrs['scene_text']) == 100000\n";
  const std::filesystem::path script_path = path.string() + ".py";
  FILE* out = std::fopen(script_path.c_str(), "w");
  std::fputs(script.c_str(), out);
  std::fclose(out);
  return std::system(
      ("/usr/bin/python3 " + script_path.string() + " " + path.string() + " " + std::to_string(rows))
          .c_str());
}

/// Killed at a random moment: our reader opens the file as it is, no more than the last second is missing,
/// and after recovery it opens plainly, here and in h5py, with the same rows.
TEST_F(ViolentEndTest, KilledAtRandomMomentsLosesAtMostTheLastSecond) {
  const bool with_python = python_has_h5py();
  std::mt19937 random(20);
  const char* trials_text = std::getenv("TELENANO_KILL_TRIALS");
  const int trials = trials_text == nullptr ? 6 : std::atoi(trials_text);
  for (int trial = 0; trial < trials; ++trial) {
    std::filesystem::remove(path_);
    Child child({path_.string(), "4000"});
    ASSERT_EQ(child.line(), "recording\n");
    const double started_at_s = static_cast<double>(rt::SteadyClock{}.now_ns()) * 1e-9;
    // Up to 2 s: before, at and after flushes and chunk borders.
    std::this_thread::sleep_for(
        std::chrono::microseconds(std::uniform_int_distribution<>(0, 2'000'000)(random)));
    const double killed_at_s = static_cast<double>(rt::SteadyClock{}.now_ns()) * 1e-9;
    child.kill();
    child.wait();

    std::size_t rows = 0;
    std::size_t events = 0;
    {
      const RecordingReader reader(path_);
      EXPECT_FALSE(reader.closed());
      rows = reader.rows();
      events = reader.events().size();
      const double kept_until_s = rows > 0 ? last_time_s(reader) : started_at_s;
      EXPECT_GT(kept_until_s, killed_at_s - 1.0) << "trial " << trial;
      expect_rows_right(reader);
    }
    const Recovered recovered = recover(path_);
    EXPECT_FALSE(recovered.was_closed);
    EXPECT_EQ(recovered.rows, rows);
    EXPECT_EQ(recovered.events, events);
    const RecordingReader reader(path_);
    EXPECT_TRUE(reader.closed());
    EXPECT_TRUE(reader.cut_short());
    EXPECT_EQ(reader.rows(), rows);
    EXPECT_EQ(reader.configuration("title"), "numbered rows");
    expect_rows_right(reader);
    expect_plain_columns(path_, rows);
    if (with_python) {
      EXPECT_EQ(read_with_h5py(path_, rows), 0) << "trial " << trial;
    }
    EXPECT_TRUE(recover(path_).was_closed) << "nothing to do the second time";
    if (HasFailure()) return;
  }
}

TEST_F(ViolentEndTest, CanBeReadWhileItIsWrittenButNotRecovered) {
  Child child({path_.string(), "4000"});
  ASSERT_EQ(child.line(), "recording\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  std::size_t rows = 0;
  {
    const RecordingReader reader(path_);
    rows = reader.rows();
    EXPECT_GT(rows, 0u);
    EXPECT_FALSE(reader.closed());
    expect_rows_right(reader);
  }
  try {
    recover(path_);
    FAIL() << "recovered a file under its writer's hands";
  } catch (const UserError& error) {
    EXPECT_NE(std::string(error.what()).find("is being recorded now"), std::string::npos) << error.what();
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  EXPECT_GT(RecordingReader(path_).rows(), rows) << "the writer goes on";
}

/// A file that may not grow is a full disk with another number: the loop goes on, the program ends with 0,
/// the failure is told once, and what had been confirmed before is still there.
TEST_F(ViolentEndTest, AFullDiskStopsTheRecordingAndNothingElse) {
  for (const char* limit : {"200000", "1000000", "2500000"}) {
    std::filesystem::remove(path_);
    Child child({path_.string(), "20000", "20000", limit});
    std::vector<std::string> lines;
    for (std::string line = child.line(); !line.empty(); line = child.line()) lines.push_back(line);
    const int status = child.wait();
    ASSERT_TRUE(WIFEXITED(status)) << "ended by signal " << WTERMSIG(status);
    EXPECT_EQ(WEXITSTATUS(status), 0);
    ASSERT_EQ(lines.size(), 3u);
    EXPECT_NE(lines[1].find("File too large"), std::string::npos) << lines[1];
    long pushed = 0;
    long accepted = 0;
    unsigned long long written = 0;
    unsigned long long dropped = 0;
    int failed = 0;
    int told = 0;
    ASSERT_EQ(
        std::sscanf(lines[2].c_str(), "pushed %ld accepted %ld written %llu dropped %llu failed %d told %d",
                    &pushed, &accepted, &written, &dropped, &failed, &told),
        6)
        << lines[2];
    EXPECT_EQ(pushed, 20000) << "the loop went on to its end";
    EXPECT_EQ(failed, 1);
    EXPECT_EQ(told, 1);
    EXPECT_EQ(written + dropped, 20000u);
    EXPECT_GE(RecordingReader(path_).rows(), written);
    expect_rows_right(RecordingReader(path_));
    const Recovered recovered = recover(path_);
    EXPECT_GE(recovered.rows, written);
    expect_rows_right(RecordingReader(path_));
    expect_plain_columns(path_, recovered.rows);
  }
}

}  // namespace
}  // namespace telenano::recording

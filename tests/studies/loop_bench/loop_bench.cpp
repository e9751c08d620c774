#include "tests/studies/loop_bench/loop_bench.h"

#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/studies/loop_bench/cyclictest.h"
#include "tests/support/child_process.h"

namespace telenano::studies {
namespace {

using support::ChildProcess;
namespace fs = std::filesystem;

constexpr std::size_t kBuckets = 20'000;  // µs

int last_cpu() {
  return std::max(0, static_cast<int>(std::thread::hardware_concurrency()) - 1);
}

/// Keeps the first core busy, in this process, as long as it lives.
class Load {
 public:
  explicit Load(bool on) {
    if (on)
      thread_ = std::jthread([](const std::stop_token& stop) {
        cpu_set_t first;
        CPU_ZERO(&first);
        CPU_SET(0, &first);
        sched_setaffinity(0, sizeof first, &first);
        volatile double x = 1;
        while (!stop.stop_requested())
          for (int i = 0; i < 1000; ++i) x = x * 1.0000001;
      });
  }

 private:
  std::jthread thread_;
};

LoopBenchRow row_of(const std::string& who, const LatenessHistogram& histogram) {
  LoopBenchRow row;
  row.who = who;
  row.p50_us = quantile_us(histogram, 0.5);
  row.p99_us = quantile_us(histogram, 0.99);
  row.p999_us = quantile_us(histogram, 0.999);
  row.max_us = quantile_us(histogram, 1);
  for (const long count : histogram) row.wakes += count;
  return row;
}

/// A folder of its own that goes with it.
class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("telenano_loop_bench_" + std::to_string(::getpid()))) {
    fs::create_directories(path_);
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  fs::path operator/(const std::string& name) const { return path_ / name; }

 private:
  fs::path path_;
};

std::string last_line(const std::string& text) {
  const std::size_t end = text.find_last_not_of("\n");
  if (end == std::string::npos) return "it said nothing";
  const std::size_t begin = text.find_last_of('\n', end);
  return text.substr(begin == std::string::npos ? 0 : begin + 1,
                     end - (begin == std::string::npos ? 0 : begin + 1) + 1);
}

std::chrono::milliseconds patience(double seconds) {
  return std::chrono::milliseconds(static_cast<long>(1000 * (seconds + 30)));
}

}  // namespace

LoopBenchRow run_cyclictest(const LoopBenchConfig& config, double rate_hz) {
  const Load load(config.load);
  const auto text = [](auto number) { return std::to_string(number); };
  std::vector<std::string> command{"/usr/bin/env",
                                   "cyclictest",
                                   "--laptop",
                                   "-m",
                                   "-q",
                                   "-t1",
                                   "-a" + text(last_cpu()),
                                   "-i" + text(static_cast<long>(1e6 / rate_hz)),
                                   "-l" + text(static_cast<long>(config.seconds * rate_hz)),
                                   "-h" + text(kBuckets)};
  if (config.priority > 0) command.push_back("-p" + text(config.priority));
  support::Finished done;
  try {
    done = support::run_program(command, {}, patience(config.seconds));
  } catch (const std::runtime_error&) {
    throw UserError("cyclictest is not installed; run: apt-get install rt-tests");
  }
  if (done.exit_code == 127) throw UserError("cyclictest is not installed; run: apt-get install rt-tests");
  if (done.exit_code != 0) throw RunError("cyclictest failed: " + last_line(done.err));
  return row_of("cyclictest", parse_cyclictest(done.out, kBuckets));
}

LoopBenchRow run_station(const LoopBenchConfig& config, double rate_hz) {
  const Folder folder;
  const std::string file = folder / "bench.h5";
  const Load load(config.load);
  ChildProcess server({"/usr/bin/env", "taskset", "-c", "0", config.nve.string(), "serve", "--scene",
                       "flakes", "--listen", "127.0.0.1:0"});
  if (!server.wait_for_err("serving ", std::chrono::seconds(20)))
    throw RunError("the server did not start: " + last_line(server.err()));
  const std::string said = server.err();
  const std::size_t at = said.find("127.0.0.1:");
  const std::string address = said.substr(at, said.find_first_of(" ,\n", at) - at);
  // Only the loop is pinned, by itself: recorder and viewer go wherever there is room.
  std::vector<std::string> command{config.master.string(),
                                   "run",
                                   "--server",
                                   address,
                                   "--task",
                                   "position",
                                   "--duration-s",
                                   std::to_string(config.seconds),
                                   "--rate",
                                   std::to_string(static_cast<long>(rate_hz)),
                                   "--record",
                                   file,
                                   "--quiet",
                                   "--rt-priority",
                                   std::to_string(config.priority),
                                   "--rt-cpu",
                                   std::to_string(last_cpu())};
  command.insert(command.end(), config.station_flags.begin(), config.station_flags.end());
  const support::Finished done = support::run_program(command, {}, patience(config.seconds));
  if (done.exit_code != 0) throw RunError("the station failed: " + last_line(done.err));
  LatenessHistogram histogram(kBuckets + 1, 0);
  for (const double late_us : recording::RecordingReader(file).read("lateness_us"))
    ++histogram[std::min(kBuckets, static_cast<std::size_t>(std::max(0.0, late_us)))];
  return row_of("station", histogram);
}

double median_ratio(const std::vector<LoopBenchRow>& rows, double rate_hz, double LoopBenchRow::*field) {
  std::vector<double> ratios;
  for (const LoopBenchRow& floor : rows) {
    if (floor.who != "cyclictest" || floor.rate_hz != rate_hz) continue;
    for (const LoopBenchRow& station : rows) {
      if (station.who != "station" || station.rate_hz != rate_hz || station.pair != floor.pair) continue;
      // Both are whole microseconds: below one they are equal.
      ratios.push_back(std::max(station.*field, 1.0) / std::max(floor.*field, 1.0));
    }
  }
  if (ratios.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(ratios.begin(), ratios.end());
  const std::size_t n = ratios.size();
  return n % 2 == 1 ? ratios[n / 2] : 0.5 * (ratios[n / 2 - 1] + ratios[n / 2]);
}

}  // namespace telenano::studies

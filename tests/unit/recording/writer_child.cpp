// Records numbered rows until it is killed or, with a row count, until it is done. For tests that kill it and
// for those that take its disk space away: writer_child FILE ROWS_PER_SECOND [ROWS [FILE_SIZE_LIMIT]]
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <thread>

#include "telenano/common/recording/recorder.h"
#include "telenano/common/rt/steady_clock.h"
#include "tests/unit/recording/numbered_row.h"

namespace {

int record(int argc, char** argv) {
  using namespace telenano::recording;
  const long rate_hz = std::atol(argv[2]);
  const long rows = argc > 3 ? std::atol(argv[3]) : 0;
  int told = 0;
  RecorderOptions options;
  options.path = argv[1];
  options.on_failure = [&told](const std::string& line) {
    ++told;
    std::printf("told: %s\n", line.c_str());
  };
  Recorder recorder(options, {.title = "numbered rows", .scene_text = std::string(100'000, 's')});
  if (argc > 4) {
    // The signal SIGXFSZ stays at its default, which would end the process: the recorder must cope by itself.
    const rlimit limit{static_cast<rlim_t>(std::atol(argv[4])), static_cast<rlim_t>(std::atol(argv[4]))};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  std::printf("recording\n");
  std::fflush(stdout);
  const telenano::rt::SteadyClock clock;
  const std::int64_t start_ns = clock.now_ns();
  long accepted = 0;
  long number = 0;
  for (; rows == 0 || number < rows; ++number) {
    const std::int64_t due_ns = start_ns + number * 1'000'000'000 / rate_hz;
    while (clock.now_ns() < due_ns) std::this_thread::sleep_for(std::chrono::microseconds(200));
    if (recorder.push(numbered_row(number, static_cast<double>(clock.now_ns()) * 1e-9))) ++accepted;
    if (number % 100 == 0) recorder.push(make_event(number, 0.0, 7, "a hundred more"));
  }
  recorder.close();
  std::printf("pushed %ld accepted %ld written %llu dropped %llu failed %d told %d\n", number, accepted,
              static_cast<unsigned long long>(recorder.rows_written()),
              static_cast<unsigned long long>(recorder.rows_dropped()), recorder.failed() ? 1 : 0, told);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  try {
    return record(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}

#include "tests/studies/stress/sweep.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <exception>
#include <map>
#include <mutex>
#include <thread>

#include "telenano/common/base/version.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/results.h"

namespace telenano::studies::stress {
namespace {

using Time = std::chrono::steady_clock;

std::string time_left(double seconds) {
  if (seconds < 90) return fmt::format("{:.0f} s", seconds);
  if (seconds < 5400) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.1f} h", seconds / 3600);
}

class Progress {
 public:
  Progress(std::size_t all, std::size_t there, bool quiet)
      : all_(all), there_(there), done_(there), quiet_(quiet), terminal_(::isatty(2) != 0) {}
  void add(const Row& row) {
    ++done_;
    ticks_ += row.outcome.ticks;
    broken_ += (row.outcome.violated & promised(row.spec.method)) != 0;
    const auto now = Time::now();
    if (quiet_ || now - shown_ < std::chrono::seconds(terminal_ ? 1 : 10)) return;
    shown_ = now;
    show(false);
  }
  void show(bool last) {
    if (quiet_) return;
    const double spent_s = seconds();
    const double left_s = spent_s / static_cast<double>(std::max<std::size_t>(1, done_ - there_)) *
                          static_cast<double>(all_ - done_);
    const std::string line =
        fmt::format("stress: {} of {} runs, {} broken promises, {:.2f} M steps/s, {}", done_, all_, broken_,
                    1e-6 * static_cast<double>(ticks_) / std::max(spent_s, 1e-3),
                    last ? time_left(spent_s) + " in all" : time_left(left_s) + " left");
    std::fprintf(stderr, terminal_ ? "\r%-78s%s" : "%s%s", line.c_str(), terminal_ && !last ? "" : "\n");
    std::fflush(stderr);
  }
  double seconds() const { return std::chrono::duration<double>(Time::now() - begin_).count(); }
  std::int64_t ticks() const noexcept { return ticks_; }

 private:
  std::size_t all_, there_, done_, broken_ = 0;
  std::int64_t ticks_ = 0;
  bool quiet_, terminal_;
  Time::time_point begin_ = Time::now(), shown_ = Time::now();
};

}  // namespace

Manifest manifest_of(const ProfileOptions& options, std::size_t runs) {
  return {fmt::format("telenano-stress {} runs={} version={} commit={}", options.text(), runs, kVersion,
                      kGitCommit),
          runs};
}

SweepResult sweep(const SweepOptions& options) {
  const std::vector<RunSpec> specs = make_profile(options.profile);
  std::vector<SceneKind> kinds = options.profile.scenes;
  kinds.insert(kinds.end(), options.profile.across.begin(), options.profile.across.end());
  const Scenes scenes(options.scenes, kinds);
  ShardTable table(options.out, manifest_of(options.profile, specs.size()), options.shard, options.wait);
  std::vector<std::size_t> mine;
  for (std::size_t i = 0; i < specs.size(); ++i) {
    if (options.shard.holds(i)) mine.push_back(i);
  }
  if (table.dropped_half_line() && !options.quiet)
    std::fprintf(stderr, "stress: %s: a half-written last line was dropped\n", table.path().c_str());
  if (table.rows() > 0 && !options.quiet)
    std::fprintf(stderr, "stress: %zu of %zu runs were there already\n", table.rows(), mine.size());

  SweepResult result;
  result.runs = mine.size();
  result.threads = options.threads > 0 ? options.threads : std::max(1u, std::thread::hardware_concurrency());
  Progress progress(mine.size(), table.rows(), options.quiet);
  std::atomic<std::size_t> next{table.rows()};
  std::size_t to_write = table.rows();
  std::map<std::size_t, Row> waiting;  // computed, but an earlier one is not yet
  std::mutex mutex;
  std::exception_ptr failure;
  auto synced = Time::now();
  const auto work = [&] {
    try {
      for (std::size_t at = next++; at < mine.size(); at = next++) {
        Row row{mine[at], specs[mine[at]], {}};
        row.outcome = run(row.spec, scenes);
        if (row.index % kRepeatEvery == 0 && run(row.spec, scenes).hash != row.outcome.hash)
          row.outcome.violated |= kInvariantRepeat;
        const std::lock_guard lock(mutex);
        waiting.emplace(at, std::move(row));
        for (auto it = waiting.find(to_write); it != waiting.end(); it = waiting.find(++to_write)) {
          table.append(it->second);
          progress.add(it->second);
          waiting.erase(it);
        }
        if (Time::now() - synced > std::chrono::seconds(5)) {
          table.sync();
          synced = Time::now();
        }
      }
    } catch (...) {
      next = mine.size();  // nothing more is begun
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  };
  std::vector<std::thread> threads;
  for (unsigned i = 1; i < result.threads; ++i) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
  table.sync();
  result.computed = mine.size() - table.rows();
  result.ticks = progress.ticks();
  result.seconds = progress.seconds();
  if (result.computed == 0) return result;
  progress.show(true);
  note_timing(options.out, options.shard, {result.computed, result.ticks, result.seconds, result.threads});
  return result;
}

std::vector<const Row*> broken_promises(const std::vector<Row>& rows) {
  std::vector<const Row*> broken;
  for (const Row& row : rows) {
    if ((row.outcome.violated & promised(row.spec.method)) != 0) broken.push_back(&row);
  }
  return broken;
}

}  // namespace telenano::studies::stress

#include "tests/studies/stress/stress_bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <ctime>
#include <thread>
#include <vector>

#include "tests/studies/stress/stress_run.h"

namespace telenano::studies::stress {
namespace {

constexpr double kTargetMillions = 1, kTargetScaling = 1.8;

double wall_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
double thread_s() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}
double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Case {
  RunSpec spec;
  bool has_target = false;
  std::vector<double> wall_ns{}, processor_ns{};  // of a step
};

std::vector<Case> cases(double seconds) {
  std::vector<Case> all;
  for (const SceneKind scene : {SceneKind::kWall, SceneKind::kOxide, SceneKind::kScan}) {
    for (const HandKind hand : {HandKind::kGreedy, HandKind::kPress}) {
      for (const control::Method method : control::kAllMethods) {
        Case c;
        c.spec.method = method;
        c.spec.scene = scene;
        c.spec.hand = hand;
        if (hand == HandKind::kGreedy) {
          c.spec.hand_a = 0.1;
          c.spec.hand_b = 0.01;
        }
        c.spec.rtt_ms = 20;
        c.spec.seconds = seconds;
        // A scan is shaped by its splines, a press steps two slaves: shown, without a target.
        c.has_target = scene != SceneKind::kScan && hand == HandKind::kGreedy;
        all.push_back(c);
      }
    }
  }
  return all;
}

void measure(Case& c, const Scenes& scenes) {
  const double wall = wall_s(), processor = thread_s();
  const auto ticks = static_cast<double>(run(c.spec, scenes).ticks);
  c.processor_ns.push_back(1e9 * (thread_s() - processor) / ticks);
  c.wall_ns.push_back(1e9 * (wall_s() - wall) / ticks);
}

struct Together {
  double wall_s = 0, processor_ns = 0;  ///< all of it; of a step
};

/// These runs as a sweep makes them: each thread takes the next one.
Together together(const std::vector<RunSpec>& specs, unsigned threads, const Scenes& scenes) {
  std::atomic<std::size_t> next{0};
  struct alignas(64) Part {
    double processor_s = 0;
    std::int64_t ticks = 0;
  };
  std::vector<Part> parts(threads);
  const auto work = [&](Part& part) {
    const double begin_s = thread_s();
    for (std::size_t i = next++; i < specs.size(); i = next++) part.ticks += run(specs[i], scenes).ticks;
    part.processor_s = thread_s() - begin_s;
  };
  const double begin_s = wall_s();
  std::vector<std::thread> others;
  for (unsigned i = 1; i < threads; ++i) others.emplace_back([&work, &parts, i] { work(parts[i]); });
  work(parts[0]);
  for (std::thread& thread : others) thread.join();
  Together result;
  result.wall_s = wall_s() - begin_s;
  double processor_s = 0;
  std::int64_t ticks = 0;
  for (const Part& part : parts) {
    processor_s += part.processor_s;
    ticks += part.ticks;
  }
  result.processor_ns = 1e9 * processor_s / static_cast<double>(ticks);
  return result;
}

std::string row(const char* quantity, const char* scene, std::string_view hand, std::string_view method,
                unsigned threads, double value, double of_processor, double target) {
  return fmt::format("{},{},{},{},{},{:.3f},{:.3f},{},{}\n", quantity, scene, hand, method, threads, value,
                     of_processor, target > 0 ? fmt::format("{:g}", target) : std::string(),
                     target > 0 ? (value >= target ? "yes" : "no") : "");
}

}  // namespace

std::string stress_bench_csv(const StressBenchOptions& options) {
  const Scenes scenes(options.scenes, {SceneKind::kWall, SceneKind::kOxide, SceneKind::kScan});
  std::vector<Case> all = cases(options.seconds);
  for (int round = 0; round < options.rounds; ++round) {
    for (Case& c : all) measure(c, scenes);
  }
  std::string csv = "quantity,scene,hand,method,threads,value,of_processor_time,target,holds\n";
  for (const Case& c : all)
    csv += row("steps_per_s", scene_kind_name(c.spec.scene).data(), hand_name(c.spec.hand),
               control::method_name(c.spec.method), 1, 1e3 / median(c.wall_ns), 1e3 / median(c.processor_ns),
               c.has_target ? kTargetMillions : 0);

  // Short runs and many, so that the last one does not decide how long two threads take.
  std::vector<RunSpec> specs;
  for (const Case& c : all) {
    for (int part = 0; part < 5; ++part) {
      RunSpec spec = c.spec;
      spec.seconds = 0.2 * options.seconds;
      spec.seed = static_cast<std::uint64_t>(part + 1);
      specs.push_back(spec);
    }
  }
  std::vector<double> ratios, processor_ratios;
  for (int round = 0; round < options.rounds; ++round) {
    const Together one = together(specs, 1, scenes), two = together(specs, 2, scenes);
    ratios.push_back(one.wall_s / two.wall_s);
    processor_ratios.push_back(one.processor_ns / two.processor_ns);
  }
  return csv +
         row("scaling", "all", "all", "all", 2, median(ratios), median(processor_ratios), kTargetScaling);
}

}  // namespace telenano::studies::stress

#include "telenano/master/app/devices/device_monitor.h"

#include <gmock/gmock.h>

#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

namespace telenano::app {
namespace {

using Clock = std::chrono::steady_clock;
using ::testing::HasSubstr;

/// A loop of which a test decides whether it runs.
class FakeLoop {
 public:
  MonitoredLoop seen() {
    return {[this] {
              if (running) ++ticks;
              return ticks.load();
            },
            [this] { return cause.load(); }, &calls};
  }
  std::atomic<bool> running{true};
  std::atomic<std::uint64_t> ticks{1};
  std::atomic<device::ForceOffCause> cause{device::ForceOffCause::kNone};
  device::CallWatch calls;
};

class Told {
 public:
  void operator()(const std::string& line) {
    const std::lock_guard lock(mutex_);
    lines_.push_back(line);
  }
  std::vector<std::string> lines() {
    const std::lock_guard lock(mutex_);
    return lines_;
  }
  /// How long it took until so many lines were there.
  std::chrono::milliseconds wait(std::size_t count) {
    const auto begin = Clock::now();
    while (lines().size() < count && Clock::now() < begin + std::chrono::seconds(10))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - begin);
  }

 private:
  std::mutex mutex_;
  std::vector<std::string> lines_;
};

TEST(DeviceMonitor, ALoopThatIsStuckInTheLibraryIsToldWithin100Ms) {
  FakeLoop loop;
  Told told;
  const DeviceMonitor monitor(loop.seen(), [&](const std::string& line) { told(line); });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_TRUE(told.lines().empty());
  EXPECT_EQ(monitor.stuck_ns(), 0);
  loop.calls.enter("dhdSetForce");
  loop.running = false;
  const auto took = told.wait(1);
  std::printf("told after %d ms\n", static_cast<int>(took.count()));
  ASSERT_EQ(told.lines().size(), 1u);
  EXPECT_THAT(told.lines()[0], HasSubstr("stuck in the SDK function dhdSetForce"));
  EXPECT_LT(took, std::chrono::milliseconds(160));  // 55 on a machine that has time; this one may be busy
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(told.lines().size(), 1u) << "once";
  EXPECT_GT(monitor.stuck_ns(), 100'000'000);
  loop.calls.leave();
  loop.running = true;
  told.wait(2);
  EXPECT_THAT(told.lines().back(), HasSubstr("runs again after"));
}

TEST(DeviceMonitor, ALoopThatIsStuckElsewhereIsNotBlamedOnTheLibrary) {
  FakeLoop loop;
  Told told;
  const DeviceMonitor monitor(loop.seen(), [&](const std::string& line) { told(line); });
  loop.running = false;
  told.wait(1);
  ASSERT_EQ(told.lines().size(), 1u);
  EXPECT_THAT(told.lines()[0], HasSubstr("too busy"));
}

TEST(DeviceMonitor, ALoopThatHasNotBegunOrHasEndedIsNotStuck) {
  FakeLoop loop;
  loop.running = false;
  loop.ticks = 0;
  Told told;
  const DeviceMonitor monitor(loop.seen(), [&](const std::string& line) { told(line); });
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  EXPECT_TRUE(told.lines().empty());
}

TEST(DeviceMonitor, WhyThereIsNoForceIsTold) {
  FakeLoop loop;
  Told told;
  const DeviceMonitor monitor(loop.seen(), [&](const std::string& line) { told(line); });
  loop.cause = device::ForceOffCause::kVelocity;
  told.wait(1);
  loop.cause = device::ForceOffCause::kNone;
  told.wait(2);
  ASSERT_EQ(told.lines().size(), 2u);
  EXPECT_THAT(told.lines()[0], HasSubstr("moved too fast"));
  EXPECT_THAT(told.lines()[1], HasSubstr("ready again"));
}

}  // namespace
}  // namespace telenano::app

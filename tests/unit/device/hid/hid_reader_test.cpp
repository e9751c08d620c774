// The reader's thread with a scripted port: order, floods, unplugging.
#include "telenano/master/device/hid/hid_reader.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <mutex>
#include <thread>

#include "telenano/common/base/random.h"
#include "tests/support/puck_bytes.h"

namespace telenano::device {
namespace {

using support::Bytes;

/// What a port is told to say, in order; then silence, or it goes.
struct Script {
  std::mutex mutex;
  std::vector<Bytes> reports;
  std::size_t next = 0;
  std::atomic<bool> unplugged{false};
  std::atomic<bool> flood{false};
  std::atomic<bool> closed{false};
};

class ScriptedPort final : public HidPort {
 public:
  explicit ScriptedPort(Script& script) : script_(script) {}
  ~ScriptedPort() override { script_.closed = true; }
  int read(std::span<std::uint8_t> report, int timeout_ms) noexcept override {
    {
      const std::lock_guard lock(script_.mutex);
      if (script_.next < script_.reports.size()) {
        const Bytes& bytes = script_.reports[script_.next++];
        std::memcpy(report.data(), bytes.data(), std::min(bytes.size(), report.size()));
        return static_cast<int>(std::min(bytes.size(), report.size()));
      }
    }
    if (script_.unplugged) return -1;
    if (script_.flood) {
      std::memcpy(report.data(), support::kCombined.data(), support::kCombined.size());
      return static_cast<int>(support::kCombined.size());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(std::min(timeout_ms, 1)));
    return 0;
  }

 private:
  Script& script_;
};

template <class Condition>
bool soon(const Condition& condition) {
  for (int k = 0; k < 2000; ++k) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

TEST(HidReaderTest, PublishesTheNewestAndCountsPressesAndUnknown) {
  Script script;
  script.reports = {support::kSplitRight,  support::kRightPressed, support::kNonePressed,
                    support::kBattery,     support::kRightPressed, support::kNonePressed,
                    support::kSplitLifted, support::kSplitTurned};
  const HidReader reader(std::make_unique<ScriptedPort>(script), take_puck_report);
  ASSERT_TRUE(soon([&] { return reader.news().load().reports == 3; }));
  const HidNews news = reader.news().load();
  EXPECT_EQ(news.puck.axes, (std::array<std::int16_t, 6>{0, 0, -175, 10, -10, 300}));
  EXPECT_EQ(news.puck.buttons, 0u);
  EXPECT_EQ(news.presses[1], 2u);
  EXPECT_EQ(news.unknown, 1u);
  EXPECT_FALSE(news.gone);
}

TEST(HidReaderTest, SilenceStillBeats) {
  Script script;
  const HidReader reader(std::make_unique<ScriptedPort>(script), take_puck_report);
  const std::uint64_t before = reader.news().count();
  EXPECT_TRUE(soon([&] { return reader.news().count() > before + 3; }));
}

TEST(HidReaderTest, UnpluggedIsTold) {
  Script script;
  const HidReader reader(std::make_unique<ScriptedPort>(script), take_puck_report);
  script.unplugged = true;
  EXPECT_TRUE(soon([&] { return reader.news().load().gone; }));
}

TEST(HidReaderTest, AFloodLeavesNoBacklog) {
  Script script;
  script.flood = true;
  std::uint64_t reports = 0;
  {
    const HidReader reader(std::make_unique<ScriptedPort>(script), take_puck_report);
    EXPECT_TRUE(soon([&] { return reader.news().load().reports > 10'000; }));
    {
      const std::lock_guard lock(script.mutex);
      script.reports = {support::kLeftPressed};
    }
    const auto before = std::chrono::steady_clock::now();
    EXPECT_TRUE(soon([&] { return reader.news().load().puck.buttons == 1; }));
    // Whatever came before is not in its way; the bound is for a machine with other work.
    EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::milliseconds(500));
    reports = reader.news().load().reports;
  }
  EXPECT_GT(reports, 10'000u);
  EXPECT_TRUE(script.closed) << "ends while reports pour in";
}

TEST(HidReaderTest, RandomReportsOfAllLengthsAreHarmless) {
  Random random(11);
  HidNews news;
  std::array<std::uint8_t, 80> bytes;
  for (int k = 0; k < 300'000; ++k) {
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random.bits());
    if (random.chance(0.7)) bytes[0] = static_cast<std::uint8_t>(random.below(5));
    take_puck_report(std::span<const std::uint8_t>(bytes).first(random.below(bytes.size() + 1)), news);
  }
  EXPECT_GT(news.reports, 0u);
  EXPECT_GT(news.unknown, 0u);
}

}  // namespace
}  // namespace telenano::device

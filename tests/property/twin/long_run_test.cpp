// Twin and server step by step over a long session on a bad link: losses, jitter, duplicates, and a session
// resumed now and then. Two slaves that never saw each other; what compares them is the hash of the state after
// a step, which hangs on all steps before. TELENANO_TWIN_STEPS says how many; ctest -C full makes a million.
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "tests/property/twin/felt_run.h"

namespace telenano::support {
namespace {

int ticks() {
  const char* const given = std::getenv("TELENANO_TWIN_STEPS");
  return given != nullptr ? std::atoi(given) : 12000;
}

class LongRun : public ::testing::TestWithParam<std::string> {};

TEST_P(LongRun, EveryStateIsTheServersOverABadLink) {
  const auto scene = deployed(GetParam());
  const auto deaf = std::make_shared<bool>(false);
  VirtualSessionConfig config = session_config(scene, {60, 0.05, 10, 0.05}, std::make_shared<ExecutedLog>());
  config.make_slave = [scene] { return std::make_unique<slave::NveSlave>(scene); };
  config.lie = [deaf](std::span<std::uint8_t> bytes, std::size_t n) {
    return *deaf && bytes[5] == static_cast<std::uint8_t>(link::MessageType::kReply) ? 0 : n;
  };
  const std::vector<device::IntendedMotion::Waypoint> once = config.script;
  config.script.clear();
  constexpr double kCycleS = 6;
  for (int cycle = 0; cycle * kCycleS < 1e-3 * ticks(); ++cycle) {
    for (device::IntendedMotion::Waypoint to : once) {
      to.time_s += cycle * kCycleS;
      to.pos_nm.y() += cycle % 7 * 5;
      config.script.push_back(to);
    }
  }
  VirtualSession session(config);
  const station::TwinRun& twin = *session.station().twin();
  std::uint64_t most_behind = 0, partings = 0, withdrawn = 0;
  for (int tick = 0; tick < ticks(); ++tick) {
    *deaf = tick % 8000 > 4000 && tick % 8000 < 4350;  // commands go on; the station says Hello again
    session.step();
    most_behind = std::max(most_behind, twin.behind());
    if (twin.partings() == partings) continue;
    partings = twin.partings();
    // A handshake that is lost twice takes longer than the server waits: it withdraws, and says so.
    if (twin.reason() == std::uint32_t{link::kBreakSilence}) {
      ++withdrawn;
      continue;
    }
    const link::StepReport& said = session.client().reply().steps;
    ADD_FAILURE() << GetParam() << ": apart in tick " << tick << ", reason " << twin.reason()
                  << ", server at step " << said.executed << " with " << said.breaks << " breaks";
  }
  for (int tick = 0; tick < 1500; ++tick) session.step();
  EXPECT_LE(withdrawn, static_cast<std::uint64_t>(ticks() / 100000));
  EXPECT_EQ(twin.partings(), withdrawn) << station::twin_state_name(twin.state());
  EXPECT_GE(session.client().sessions(),
            static_cast<std::uint64_t>(1 + ticks() / 16000));  // most of the times
  EXPECT_GT(twin.confirmed() + 600, session.client().next_step());
  EXPECT_GE(twin.confirmed(), static_cast<std::uint64_t>(ticks()));
  EXPECT_EQ(session.station().method(), control::Method::kTwin);
  std::printf("%s: %llu of %llu steps confirmed in %llu sessions, never more than %llu behind\n",
              GetParam().c_str(), static_cast<unsigned long long>(twin.confirmed()),
              static_cast<unsigned long long>(session.client().next_step() - 1),
              static_cast<unsigned long long>(session.client().sessions()),
              static_cast<unsigned long long>(most_behind));
}

INSTANTIATE_TEST_SUITE_P(Scenes, LongRun,
                         ::testing::Values("flat_silicon_oxide", "flat_pdms", "flat_polystyrene",
                                           "flat_table", "flakes", "flakes_potential", "humid_flakes",
                                           "particle", "lithography"),
                         [](const auto& scene) { return scene.param; });

}  // namespace
}  // namespace telenano::support

// What is felt with a twin, against what is true: the force of each tick against that of the step with the
// same number in the log that the server has executed, replayed by a slave that was built for it. Over round
// trips, losses, jitter and duplicates. The server's slave is recorded at its own port, behind all of link,
// session and server, so that the oracle knows nothing of what the station computed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "tests/property/twin/logged_slave.h"
#include "tests/source_dir.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

std::shared_ptr<const scene::Scene> deployed(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

struct Link {
  double rtt_ms = 0;
  double loss = 0;
  double jitter_ms = 0;
  double duplicates = 0;
};

VirtualSessionConfig session_config(const std::shared_ptr<const scene::Scene>& scene, const Link& link,
                                    const std::shared_ptr<ExecutedLog>& log) {
  VirtualSessionConfig config;
  config.scene = scene;
  config.make_slave = [scene, log] { return std::make_unique<LoggedSlave>(scene, log); };
  config.station.method = control::Method::kTwin;
  config.twin = true;
  for (net::SimPath* const path : {&config.to_server, &config.to_station}) {
    path->delay_ns = static_cast<std::int64_t>(0.5e6 * link.rtt_ms);
    path->jitter_ns = static_cast<std::int64_t>(1e6 * link.jitter_ms);
    path->loss = link.loss;
    path->duplicate = link.duplicates;
  }
  // Down, along, up.
  const double deep = scene->particle ? 4 : scene->marks ? -12 : -6;
  const double z0 = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
  config.task = device::Task::kScript;
  config.script = {{0, {0, 0, z0}},    {1.2, {0, 0, deep}},  {2.2, {60, 8, deep}}, {3, {60, 8, z0}},
                   {3.6, {60, 8, z0}}, {4.2, {60, 8, deep}}, {4.6, {50, 8, deep}}, {5.2, {50, 8, z0}}};
  return config;
}

struct Felt {
  std::uint64_t step = 0;
  Vec3 force_w_nn = Vec3::Zero();
  bool shown = false;  ///< in full: engaged, by the twin, behind no ramp
};

struct Outcome {
  double nrmse = 0;
  double true_rms_nn = 0;
  std::size_t compared = 0;
  std::uint64_t confirmed = 0;
  std::uint64_t steps = 0;
  std::uint64_t partings = 0;
  std::size_t unequal_hashes = 0;
  std::size_t executed = 0;
  station::TwinState end = station::TwinState::kNone;
  double bits_up_s = 0;
};

Outcome run(const std::string& name, const Link& link, double extra_s = 1.5) {
  const auto scene = deployed(name);
  const auto log = std::make_shared<ExecutedLog>();
  VirtualSession session(session_config(scene, link, log));
  std::vector<Felt> felt;
  const double to_n = session.station().config().scaling.hand_force_n(Vec3::UnitX()).x();
  const auto note = [&] {
    const station::StationTrace& t = session.loop().trace();
    felt.push_back({session.client().next_step() - 1, t.rendered_force_h_n / to_n,
                    t.mode == station::Mode::kEngaged && t.method == control::Method::kTwin && t.ramp >= 1});
  };
  session.run(12000, [&](const recording::Sample&) { note(); });
  for (int i = 0; i < extra_s * 1000; ++i) {
    session.step();
    note();
  }
  // The executed log, by a slave of its own.
  Outcome out;
  slave::NveSlave independent(scene);
  std::vector<Vec3> truth(log->size() + 1, Vec3::Zero());
  slave::SlaveOutput output;
  for (std::size_t i = 0; i < log->size(); ++i) {
    independent.step((*log)[i].input, (*log)[i].dt_s, output);
    truth[i + 1] = output.force_w_nn;
    out.unequal_hashes += independent.state_hash() != (*log)[i].hash;
  }
  double wrong = 0, right = 0;
  for (const Felt& f : felt) {
    if (!f.shown || f.step == 0 || f.step >= truth.size()) continue;
    wrong += (f.force_w_nn - truth[f.step]).squaredNorm();
    right += truth[f.step].squaredNorm();
    ++out.compared;
  }
  out.true_rms_nn = out.compared > 0 ? std::sqrt(right / static_cast<double>(out.compared)) : 0;
  out.nrmse = right > 0 ? std::sqrt(wrong / right) : 1;
  const station::TwinRun& twin = *session.station().twin();
  out.confirmed = twin.confirmed();
  out.steps = session.client().next_step() - 1;
  out.partings = twin.partings();
  out.executed = log->size();
  out.end = twin.state();
  return out;
}

class FeltTest : public ::testing::TestWithParam<std::string> {};

// 0.02 is what the twin promises. In virtual time felt and true are the very same numbers, so that any
// difference is a defect: 1e-12 leaves room for the scaling's rounding only.
TEST_P(FeltTest, IsTheTruthAtAnyRoundTripAndLoss) {
  for (const Link& link :
       {Link{0, 0, 0, 0}, Link{100, 0, 0, 0}, Link{200, 0.02, 5, 0.05}, Link{100, 0.1, 30, 0.02}}) {
    const Outcome out = run(GetParam(), link);
    const std::string what =
        GetParam() + " at " + std::to_string(link.rtt_ms) + " ms, loss " + std::to_string(link.loss);
    EXPECT_GT(out.compared, 3000u) << what;
    EXPECT_GT(out.true_rms_nn, 1) << what;
    EXPECT_LT(out.nrmse, 1e-12) << what;
    EXPECT_EQ(out.partings, 0u) << what;
    EXPECT_EQ(out.unequal_hashes, 0u) << what;
    EXPECT_TRUE(out.end == station::TwinState::kBehind || out.end == station::TwinState::kConfirmed) << what;
    // All but what is still on its way.
    EXPECT_GT(out.confirmed + 600, out.steps) << what;
    std::printf(
        "%-22s rtt %3.0f ms loss %4.2f: nrmse %.3g, true rms %.3g nN, %zu ticks, confirmed %llu of %llu\n",
        GetParam().c_str(), link.rtt_ms, link.loss, out.nrmse, out.true_rms_nn, out.compared,
        static_cast<unsigned long long>(out.confirmed), static_cast<unsigned long long>(out.steps));
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, FeltTest,
                         ::testing::Values("flat_silicon_oxide", "flat_pdms", "flakes", "humid_flakes",
                                           "particle", "lithography"),
                         [](const auto& scene) { return scene.param; });

}  // namespace
}  // namespace telenano::support

// What is felt with a twin, against what is true: the force of each tick against that of the step with the
// same number in the log that the server has executed, replayed by a slave that was built for it. Over round
// trips, losses, jitter and duplicates. The server's slave is recorded at its own port, behind all of link,
// session and server, so that the oracle knows nothing of what the station computed.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>

#include "tests/property/twin/felt_run.h"

namespace telenano::support {
namespace {

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

// What a session with a twin sends while the hand moves: the bytes of its datagrams, repetitions included.
// Asked: 200 kbit/s at 1 kHz, 600 at 8 kHz, with the 28 bytes that IP and UDP add to each.
TEST(Bandwidth, OfTheWayUpIsWithinWhatIsAsked) {
  for (const auto& [rate_hz, asked_kbit_s] : {std::pair{1000.0, 200.0}, {4000.0, 600.0}, {8000.0, 600.0}}) {
    for (const Link& link : {Link{40, 0, 0, 0}, Link{100, 0.02, 5, 0}}) {
      VirtualSessionConfig config = session_config(deployed("flakes"), link, std::make_shared<ExecutedLog>());
      config.station.rate_hz = rate_hz;
      VirtualSession session(config);
      const auto up_bits = [&] { return 8.0 * static_cast<double>(session.bytes_up()); };
      const auto ticks = [&](double s) { return static_cast<int>(s * rate_hz); };
      for (int i = 0; i < ticks(1); ++i) session.step();
      const double before = up_bits();
      const auto datagrams = static_cast<double>(session.datagrams_up());
      constexpr double kSeconds = 4;  // down, along, up
      for (int i = 0; i < ticks(kSeconds); ++i) session.step();
      // What is lost has been sent too.
      const double sent_s = kSeconds * (1 - link.loss);
      const double kbit_s = 1e-3 * (up_bits() - before) / sent_s;
      const double headers_kbit_s = 8e-3 * static_cast<double>(net::kHeaderBytes) *
                                    (static_cast<double>(session.datagrams_up()) - datagrams) / sent_s;
      EXPECT_EQ(session.station().method(), control::Method::kTwin);
      EXPECT_LE(kbit_s + headers_kbit_s, asked_kbit_s) << rate_hz << " Hz, " << link.rtt_ms << " ms";
      EXPECT_GT(kbit_s, 10);
      std::printf("%4.0f Hz, %3.0f ms, loss %4.2f: %.0f kbit/s up, and %.0f of headers\n", rate_hz,
                  link.rtt_ms, link.loss, kbit_s, headers_kbit_s);
    }
  }
}

// A link that carries less than 50 datagrams a second: 64 kbit/s behind a queue of 20 kB, 2.5 s of it. The rate falls
// as far as it must, and the twin stays.
TEST(Narrow, ALinkOf64KilobitsKeepsTheTwin) {
  const Outcome out = run("flat_silicon_oxide", Link{40}, 1.5, [](VirtualSessionConfig& config) {
    config.link_options.rate = {};
    for (net::SimPath* const path : {&config.to_server, &config.to_station}) {
      path->rate_bit_s = 64e3;
      path->queue_bytes = 20'000;
    }
  });
  std::printf("64 kbit/s: nrmse %.3g, %zu ticks, round trip %.0f ms at the end, at most %.0f\n", out.nrmse,
              out.compared, out.rtt_ms, out.most_rtt_ms);
  EXPECT_GT(out.compared, 5000u);
  EXPECT_LT(out.nrmse, 1e-12);
  EXPECT_EQ(out.partings, 0u);
  EXPECT_TRUE(out.end == station::TwinState::kBehind || out.end == station::TwinState::kConfirmed);
  EXPECT_LT(out.most_rtt_ms, 500);
}

INSTANTIATE_TEST_SUITE_P(Scenes, FeltTest,
                         ::testing::Values("flat_silicon_oxide", "flat_pdms", "flakes", "humid_flakes",
                                           "particle", "lithography"),
                         [](const auto& scene) { return scene.param; });

}  // namespace
}  // namespace telenano::support

// The scaling planner as people use it, and `run` that uses the plan: real processes, with a way of known
// length between them where it matters.
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <thread>

#include "telenano/common/net/udp.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

using Plan = std::map<std::string, std::string>;

/// The CSV of a plan that must end well.
Plan plan_of(const std::vector<std::string>& more) {
  std::vector<std::string> command{kMaster, "plan"};
  command.insert(command.end(), more.begin(), more.end());
  const Finished run = run_program(command);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("recommended: "), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("\ndevice damping: "), std::string::npos) << run.err;
  Plan plan;
  const auto lines = lines_of(run.out);
  EXPECT_FALSE(lines.empty());
  if (lines.empty()) return plan;
  EXPECT_EQ(lines[0], "key,value,unit");
  for (std::size_t i = 1; i < lines.size(); ++i) {
    EXPECT_EQ(std::count(lines[i].begin(), lines[i].end(), ','), 2) << lines[i];
    const auto first = lines[i].find(',');
    plan[lines[i].substr(0, first)] = lines[i].substr(first + 1, lines[i].rfind(',') - first - 1);
  }
  plan["words"] = run.err;
  return plan;
}

double value(const Plan& plan, const std::string& key) {
  const auto at = plan.find(key);
  EXPECT_NE(at, plan.end()) << key;
  return at == plan.end() ? std::nan("") : std::strtod(at->second.c_str(), nullptr);
}

/// 15 printed digits of numbers that are refined to 1e-9 (scaling.h).
void expect_value(const Plan& plan, const std::string& key, double expected) {
  EXPECT_NEAR(value(plan, key), expected, 2e-9 * std::fabs(expected)) << key;
}

/// A way between a station and a server that takes a given time each way. Datagrams keep their order; those
/// to the server of which `loses` says so, by their number from 1, are lost. The first two say Hello.
class Way {
 public:
  Way(const std::string& server, Milliseconds one_way, std::function<bool(int)> loses = {})
      : server_(net::parse_address(server, "test")),
        near_(net::Udp::listen(net::parse_address("127.0.0.1:0", "test"))),
        far_(net::Udp::open_for(server_)),
        one_way_(one_way),
        loses_(std::move(loses)),
        thread_([this] { carry(); }) {}
  ~Way() {
    done_ = true;
    thread_.join();
  }
  Way(const Way&) = delete;
  Way& operator=(const Way&) = delete;
  std::string address() const { return "127.0.0.1:" + std::to_string(near_.local().port); }

 private:
  using Clock = std::chrono::steady_clock;
  struct Late {
    Clock::time_point due;
    bool to_server;
    std::vector<std::uint8_t> bytes;
  };

  void carry() {
    std::array<std::uint8_t, 512> bytes;
    std::deque<Late> on_the_way;
    net::Received received;
    while (!done_) {
      near_.wait_readable(200'000);
      while (near_.receive(bytes, received)) {
        station_ = received.from;
        if (loses_ && loses_(++to_server_)) continue;
        on_the_way.push_back({Clock::now() + one_way_, true, {bytes.begin(), bytes.begin() + received.size}});
      }
      while (far_.receive(bytes, received)) {
        on_the_way.push_back(
            {Clock::now() + one_way_, false, {bytes.begin(), bytes.begin() + received.size}});
      }
      for (; !on_the_way.empty() && on_the_way.front().due <= Clock::now(); on_the_way.pop_front()) {
        const Late& late = on_the_way.front();
        if (late.to_server) far_.send(late.bytes, server_);
        if (!late.to_server) near_.send(late.bytes, station_);
      }
    }
  }

  net::Address server_;
  net::Address station_;
  net::Udp near_;
  net::Udp far_;
  Milliseconds one_way_;
  std::function<bool(int)> loses_;
  int to_server_ = 0;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

class PlanTest : public ProgramsTest {
 protected:
  std::string limits_of(const std::string& scene) const {
    const std::string file = path(scene + "_limits.toml");
    const Finished run = run_program({kNve, "check", "--scene", scene_path(scene), "--limits", file});
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return file;
  }
  static Finished run_with(const std::string& server, const std::vector<std::string>& more) {
    std::vector<std::string> command{kMaster,  "run",      "--server",     server,
                                     "--task", "position", "--duration-s", "1"};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command, {}, kLong);
  }
};

TEST_F(PlanTest, AFileOfLimitsPlansAsItsServerDoes) {
  for (const char* scene : {"flakes", "flat_pdms"}) {
    SCOPED_TRACE(scene);
    const std::string limits = limits_of(scene);
    Server server(scene_path(scene));
    for (const char* rtt_ms : {"0", "7.5"}) {
      const Finished by_file = run_program({kMaster, "plan", "--limits", limits, "--rtt-ms", rtt_ms});
      const Finished by_server =
          run_program({kMaster, "plan", "--server", server.address(), "--rtt-ms", rtt_ms});
      EXPECT_EQ(by_file.exit_code, 0) << by_file.err;
      EXPECT_EQ(by_file.out, by_server.out);
      EXPECT_EQ(by_file.err, by_server.err);
      EXPECT_GT(lines_of(by_file.out).size(), 30u);
    }
    EXPECT_NE(server.stop().find("in 2 sessions"), std::string::npos);
  }
}

/// Silicon oxide: k_c = 20·40/60 N/m, 500 nN, 160 nm high; device: 2 N s/m, 12 N, 110 mm. A spring, so that
/// all bounds are closed forms.
TEST_F(PlanTest, NumbersAreTheClosedForms) {
  const std::string limits = limits_of("flat_silicon_oxide");
  const double k_c = 40.0 / 3, alpha_v = 160e-9 / 0.110;
  for (const char* method : {"none", "ks", "ks-clamp"}) {
    SCOPED_TRACE(method);
    const Plan plan = plan_of({"--limits", limits, "--rtt-ms", "7.5", "--method", method});
    const bool clamp = std::string(method) == "ks-clamp";
    const int d = 8;  // 7.5 periods, rounded up
    EXPECT_EQ(plan.at("method"), method);
    expect_value(plan, "loop_delay", d);
    expect_value(plan, "binding_delay", clamp ? 1 : d);
    expect_value(plan, "haptic_to_visual", 0.110 / 0.3);
    expect_value(plan, "visual_to_nano", 0.3 / 160e-9);
    expect_value(plan, "recommended_velocity_scale", alpha_v);
    const double impedance = 2 * 2.0 / (1e-3 * k_c);
    expect_value(plan, "force_scale_published", 4 * impedance / alpha_v);
    expect_value(plan, "force_scale_no_delay", impedance / alpha_v);
    expect_value(plan, "force_scale_loop_delay", impedance / 81 / alpha_v);
    expect_value(plan, "force_scale_passive", impedance / (clamp ? 4 : 81) / alpha_v);
    expect_value(plan, "force_scale_device", 0.8 * 12 / 500e-9);
    expect_value(plan, "force_scale_case_1", 1 / alpha_v);
    expect_value(plan, "force_scale_case_2", 1 / (alpha_v * alpha_v));
    EXPECT_EQ(plan.at("case_1_safe"), "yes");  // 6.9e5, below 2.5e6
    EXPECT_EQ(plan.at("case_2_safe"), "no");
    expect_value(plan, "passive_wall", 4000);
    expect_value(plan, "passive_wall_loop_delay", 4000.0 / 17);
    const double largest = clamp ? 0.8 * 12 / 500e-9 : impedance / 81 / alpha_v;
    EXPECT_EQ(plan.at("binding"), clamp ? "device" : "passivity");
    expect_value(plan, "recommended_force_scale", 0.99 * largest);
    expect_value(plan, "shown_stiffness", 0.99 * largest * alpha_v * k_c);
    expect_value(plan, "felt_force_max", 0.99 * largest * 500e-9);
    EXPECT_EQ(plan.at("words").find("note: with 8 samples") != std::string::npos, clamp) << plan.at("words");
  }
}

TEST_F(PlanTest, FlagsWinOverTheStationFile) {
  const std::string limits = limits_of("flat_silicon_oxide");
  const std::string station =
      write("station.toml",
            "rate_hz = 2000\n[workspaces]\nhaptic_m = 0.2\nnano_nm = 50.0\n[scaling]\nforce = 5e8\n");
  Plan plan = plan_of({"--station", station, "--limits", limits});
  expect_value(plan, "recommended_velocity_scale", 50e-9 / 0.2);
  expect_value(plan, "rate", 2000);
  expect_value(plan, "passive_wall", 8000);
  // α_F = 5e8 of the file times α_v = 2.5e-7 are 125; passive is 2b/((1+1)² T k_c) = 150.
  EXPECT_NE(plan.at("words").find("as the station file has it: velocity scale 2.5e-07 x force scale 5e+08 = "
                                  "125, within the 150"),
            std::string::npos)
      << plan.at("words");
  plan = plan_of({"--config", station, "--limits", limits, "--haptic-m", "0.1", "--visual-m", "0.5",
                  "--nano-nm", "20", "--rate", "500"});
  expect_value(plan, "recommended_velocity_scale", 20e-9 / 0.1);
  expect_value(plan, "haptic_to_visual", 0.2);
  expect_value(plan, "rate", 500);
}

TEST_F(PlanTest, WhereNothingIsSafeItSaysSo) {
  const std::string limits = limits_of("flat_silicon_oxide");
  const std::string bare = write("bare.toml", "[device]\ndamping_n_s_m = 0\n");
  const Plan without = plan_of({"--limits", limits, "--station", bare});
  EXPECT_EQ(without.at("binding"), "nothing_is_safe");
  EXPECT_EQ(value(without, "recommended_force_scale"), 0);
  EXPECT_NE(without.at("words").find("recommended: nothing; no force scale is safe"), std::string::npos);
  EXPECT_EQ(without.at("words").find("nan"), std::string::npos) << without.at("words");
  const Plan far = plan_of({"--limits", limits, "--rtt-ms", "300", "--method", "none"});
  EXPECT_NE(far.at("words").find("nothing that could be felt is safe"), std::string::npos);
  // α_F = 2b/(301² T k_c α_v), and 500 nN of it.
  expect_value(far, "felt_force_max", 0.99 * 300 / (301 * 301 * (160e-9 / 0.110)) * 500e-9);
}

TEST_F(PlanTest, DrawsThePicture) {
  if (std::system("gnuplot --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "no gnuplot here";
  const std::string limits = limits_of("flakes");
  for (const char* kind : {"svg", "png"}) {
    const std::string file = path(std::string("plan's.") + kind);
    plan_of({"--limits", limits, "--rtt-ms", "20", "--method", "ks-clamp", "--plot", file});
    const std::string picture = file_text(file);
    EXPECT_EQ(picture.compare(0, 5, kind[0] == 's' ? "<?xml" : "\x89PNG\r"), 0) << file;
    EXPECT_GT(picture.size(), 5000u);
    if (kind[0] == 's') {
      for (const char* text :
           {"as published (Llewellyn)", "exact, no delay", "exact, 20 samples of this link",
            "exact, 1 sample (binds ks-clamp)", "KS case I,", "KS case II,", "recommended"}) {
        EXPECT_NE(picture.find(text), std::string::npos) << text;
      }
    }
  }
  const Finished none = run_program(
      {"/usr/bin/env", "PATH=/nowhere", kMaster, "plan", "--limits", limits, "--plot", path("no.svg")});
  EXPECT_EQ(none.exit_code, 1);
  EXPECT_EQ(none.out, "");
  EXPECT_EQ(lines_of(none.err).size(), 1u) << none.err;
  EXPECT_NE(none.err.find("gnuplot is not installed"), std::string::npos) << none.err;
  EXPECT_FALSE(std::filesystem::exists(path("no.svg")));
}

TEST_F(PlanTest, MeasuresTheWayAndLeavesNoSessionBehind) {
  // One place and no time-out to speak of: the next one gets in because of Bye.
  Server server(scene_path("flat_silicon_oxide"), 0, {"--max-sessions", "1", "--timeout-ms", "60000"});
  for (const int one_way_ms : {0, 12}) {
    Way way(server.address(), Milliseconds(one_way_ms));
    const Plan plan = plan_of({"--server", one_way_ms == 0 ? server.address() : way.address()});
    EXPECT_EQ(value(plan, "round_trips_measured"), 500)
        << "nothing is lost on a loopback that is not flooded";
    const double median_ms = value(plan, "round_trip_median");
    EXPECT_GE(median_ms, std::max(2.0 * one_way_ms, 0.005));
    EXPECT_LT(median_ms, 2.0 * one_way_ms + 8) << "half the answers of a busy machine late by so much?";
    EXPECT_LE(median_ms, value(plan, "round_trip_p99"));
    EXPECT_EQ(value(plan, "loop_delay"), std::max(1.0, std::ceil(median_ms)));
  }
  EXPECT_NE(server.stop().find("in 2 sessions"), std::string::npos);
}

TEST_F(PlanTest, MeasuresOverALossyWayAndSaysWhenThereIsNone) {
  Server server(scene_path("flat_silicon_oxide"));
  {
    const Way lossy(server.address(), Milliseconds(2), [](int n) { return n > 2 && n % 5 == 0; });
    const Plan plan = plan_of({"--server", lossy.address()});
    EXPECT_EQ(value(plan, "round_trips_measured"), 400);  // of 500
    EXPECT_GE(value(plan, "round_trip_median"), 4);
    EXPECT_NE(plan.at("words").find("median of 400 of 500 answered"), std::string::npos) << plan.at("words");
  }
  const Way dead(server.address(), Milliseconds(0), [](int n) { return n > 2; });
  const Finished run =
      run_program({kMaster, "plan", "--server", dead.address(), "--connect-timeout-s", "0.5"}, {}, kLong);
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.out, "");
  EXPECT_EQ(lines_of(run.err).size(), 1u) << run.err;
  EXPECT_NE(run.err.find("does not answer commands"), std::string::npos) << run.err;
}

TEST_F(PlanTest, ASessionUsesThePlanUnlessToldOtherwise) {
  Server server(scene_path("flat_pdms"));
  const Plan plan = plan_of({"--server", server.address(), "--rtt-ms", "0"});
  EXPECT_EQ(plan.at("binding"), "passivity");
  struct Case {
    std::vector<std::string> flags;
    bool velocity_given, force_given;
  };
  const std::string station = write("station.toml", "[scaling]\nvelocity = 2e-6\n");
  for (const Case& c : {Case{{}, false, false}, Case{{"--config", station}, true, false},
                        Case{{"--force-scale", "3e6"}, false, true},
                        Case{{"--config", station, "--force-scale", "3e6"}, true, true}}) {
    SCOPED_TRACE(std::to_string(c.velocity_given) + std::to_string(c.force_given));
    std::vector<std::string> flags{"--record", path("s.h5"), "--overwrite"};
    flags.insert(flags.end(), c.flags.begin(), c.flags.end());
    const Finished run = run_with(server.address(), flags);
    ASSERT_EQ(run.exit_code, 0) << run.err;
    const recording::RecordingReader reader(path("s.h5"));
    const auto number = [&](const char* key) {
      return std::strtod(reader.configuration(key).c_str(), nullptr);
    };
    const double velocity = c.velocity_given ? 2e-6 : value(plan, "recommended_velocity_scale");
    // 2b/((1+1)² T k_c): passivity binds at either velocity scale.
    const double force = c.force_given ? 3e6 : 0.99 * 75 / velocity;
    EXPECT_NEAR(number("scaling.velocity"), velocity, 1e-14 * velocity);
    EXPECT_NEAR(number("scaling.force"), force, 2e-9 * force);
    EXPECT_NEAR(reader.read("force_scale")[0], force, 2e-9 * force);
    EXPECT_GT(number("round_trip_median_s"), 0);
    const bool planned = !c.velocity_given || !c.force_given;
    EXPECT_EQ(run.err.find("scaling planned: velocity scale") != std::string::npos, planned) << run.err;
    EXPECT_EQ(reader.configuration("scaling_chosen") == "given", !planned);
    EXPECT_EQ(run.err.find("passivity binds") != std::string::npos, !c.force_given) << run.err;
  }
}

TEST_F(PlanTest, AScalingBeyondTheRegionAtTheDelayOfTheWayIsRefused) {
  Server server(scene_path("flat_silicon_oxide"));
  const Way way(server.address(), Milliseconds(10));
  // Given: 20 of α_v α_F; passive are 75 at one tick, but at 20 to 40 ms 0.68 to 0.18 only.
  const std::vector<std::string> given{"--velocity-scale", "1e-6", "--force-scale", "2e7"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), given.begin(), given.end());
    return run_with(way.address(), more);
  };
  for (const char* method : {"none", "ks"}) {
    const Finished refused = with({"--method", method});
    EXPECT_EQ(refused.exit_code, 2) << refused.err;
    EXPECT_EQ(lines_of(refused.err).size(), 1u) << refused.err;
    for (const char* word :
         {"= 20, more than the 0.", "samples of delay", "lower --force-scale", "--allow-unsafe-scaling"}) {
      EXPECT_NE(refused.err.find(word), std::string::npos) << word << "\n" << refused.err;
    }
  }
  const Finished insisted = with({"--method", "none", "--allow-unsafe-scaling"});
  EXPECT_EQ(insisted.exit_code, 0) << insisted.err;
  const Finished clamp = with({"--method", "ks-clamp"});
  EXPECT_EQ(clamp.exit_code, 0) << clamp.err;
  EXPECT_NE(clamp.err.find("the loop alone is passive only up to 0."), std::string::npos) << clamp.err;
  // Planned: what none may show at that delay runs as it is.
  const Finished planned = run_with(way.address(), {"--method", "none"});
  EXPECT_EQ(planned.exit_code, 0) << planned.err;
  EXPECT_NE(planned.err.find("scaling planned"), std::string::npos) << planned.err;
  EXPECT_NE(server.stop().find("in 5 sessions"), std::string::npos);
}

TEST_F(PlanTest, ADeviceWithoutDampingIsRefusedWithTheReason) {
  Server server(scene_path("flat_silicon_oxide"));
  const std::string bare = write("bare.toml", "[device]\ndamping_n_s_m = 0\n");
  const Finished planned = run_with(server.address(), {"--config", bare});
  EXPECT_EQ(planned.exit_code, 2);
  EXPECT_EQ(lines_of(planned.err).size(), 1u) << planned.err;
  EXPECT_NE(planned.err.find("no force scale is safe"), std::string::npos) << planned.err;
  EXPECT_NE(planned.err.find("--allow-unsafe-scaling"), std::string::npos) << planned.err;
  const Finished given = run_with(server.address(), {"--config", bare, "--force-scale", "1e6"});
  EXPECT_EQ(given.exit_code, 2);
  EXPECT_EQ(lines_of(given.err).size(), 1u) << given.err;
  EXPECT_NE(given.err.find("without damping of the device"), std::string::npos) << given.err;
  const Finished insisted =
      run_with(server.address(), {"--config", bare, "--force-scale", "1e6", "--allow-unsafe-scaling"});
  EXPECT_EQ(insisted.exit_code, 0) << insisted.err;
}

// What will be felt is said before the session, by pressing a copy of the scene; a session then finds it.
TEST_F(PlanTest, WhatWillBeFeltIsWhatASessionFeels) {
  Server server(scene_path("flakes"));
  const Plan plan = plan_of({"--server", server.address(), "--felt", "--method", "auto"});
  EXPECT_EQ(plan.at("scene"), "flakes");
  EXPECT_EQ(plan.at("method"), "twin");
  EXPECT_EQ(plan.at("felt"), "touch");
  expect_value(plan, "felt_per_nanonewton", 1e-9 * value(plan, "recommended_force_scale"));
  expect_value(plan, "felt_pull_off", value(plan, "felt_per_nanonewton") * value(plan, "pull_off_force"));
  const Finished run =
      run_program({kMaster, "run", "--server", server.address(), "--task", "indent", "--duration-s", "4",
                   "--rt-priority", "0", "--quiet", "--record", path("felt.h5")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  double pull_nn = 0;
  double push_nn = 0;
  for (const double nn : recording::RecordingReader(path("felt.h5")).read("force_w_nn", 2)) {
    pull_nn = std::max(pull_nn, -nn);
    push_nn = std::max(push_nn, nn);
  }
  // Rows are a tick apart, and a pull-off is over in less; a hand gives way, a plan's does not.
  EXPECT_NEAR(value(plan, "pull_off_force"), pull_nn, 0.15 * pull_nn);
  EXPECT_GT(value(plan, "press_force"), push_nn);
  server.stop();

  Server silent(scene_path("flakes"), 0, {"--no-scene-sharing"});
  const Plan blind = plan_of({"--server", silent.address(), "--felt"});
  EXPECT_EQ(blind.at("felt"), "unknown");
  EXPECT_NE(blind.at("words").find("does not share its scene"), std::string::npos) << blind.at("words");
  EXPECT_EQ(blind.at("felt_unknown_because"), "this server does not share its scene");
  const Finished refused = run_program({kMaster, "plan", "--limits", path("none.toml"), "--felt"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("--felt needs --server"), std::string::npos) << refused.err;
}

// 265 kB over 60 kbit/s take twice as long as a plan waits for them.
TEST_F(PlanTest, ASceneThatIsStillFetchedIsNotCalledOneThatIsNotShared) {
  Server server(scene_path("flakes"));
  ChildProcess relay(
      {kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address(), "--rate-bit-s", "60000"});
  const std::string before_port = "relay on 127.0.0.1:";
  ASSERT_TRUE(relay.wait_for_err(before_port, kLong) && relay.wait_for_err("\n", kLong)) << relay.err();
  const std::string said = relay.err();
  const int port = std::atoi(said.c_str() + said.find(before_port) + before_port.size());
  ::setenv("XDG_CACHE_HOME", path("cache").c_str(), 1);  // where no other session has left it
  const Plan plan = plan_of({"--server", "127.0.0.1:" + std::to_string(port), "--felt"});
  ::unsetenv("XDG_CACHE_HOME");
  relay.signal(SIGTERM);
  ASSERT_EQ(plan.at("felt"), "unknown");
  EXPECT_NE(plan.at("felt_unknown_because").find("is still being fetched: "), std::string::npos)
      << plan.at("felt_unknown_because");
  EXPECT_NE(plan.at("words").find("note: the server's scene is being fetched: "), std::string::npos)
      << plan.at("words");
  EXPECT_EQ(plan.at("words").find("does not share"), std::string::npos) << plan.at("words");
}

}  // namespace
}  // namespace telenano::programs

// Real programs with a Force Dimension device: the vendor's symbols are a stand-in's, all else is what a
// person runs. A hand presses on a sample; then something goes wrong.
#include <gmock/gmock.h>
#include <sys/stat.h>
#include <time.h>

#include <cmath>
#include <thread>

#include "telenano/common/recording/recording_reader.h"
#include "tests/support/standin_drd/standin_sdk.h"
#include "tests/system/programs.h"
#include "tests/system/recorded.h"

namespace telenano::programs {
namespace {

using recording::RecordingReader;
using support::DrdCall;
using support::StandinSdk;
using ::testing::HasSubstr;

constexpr double kHoming = 5;  // station::Mode
constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kWatchdogNs = 10 * kMs;
constexpr std::int64_t kTickNs = kMs;
// Threads of two programs and of the stand-in's watchdog wait for a processor on a machine that is busy.
constexpr std::int64_t kSchedulingNs = 60 * kMs;

std::int64_t now_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{1'000'000'000} * now.tv_sec + now.tv_nsec;
}

template <class Condition>
bool soon(const Condition& condition, Seconds most = kLong) {
  const auto end = std::chrono::steady_clock::now() + most;
  while (std::chrono::steady_clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  return false;
}

class OmegaTest : public ProgramsTest {
 protected:
  void SetUp() override {
    ProgramsTest::SetUp();
    ::setenv("FDSDK", TELENANO_STANDIN_SDK, 1);
  }
  void TearDown() override {
    station_.reset();
    ::unsetenv("FDSDK");
    ProgramsTest::TearDown();
  }

  void start(std::vector<std::string> more = {}) {
    sdk_->buttons = 1;  // the handle's button: deadman
    std::vector<std::string> command{kMaster,
                                     "run",
                                     "--server",
                                     server_.address(),
                                     "--device",
                                     "omega",
                                     "--velocity-scale",
                                     "1e-6",
                                     "--force-scale",
                                     "1e7",
                                     "--method",
                                     "ks-clamp",
                                     "--allow-unsafe-scaling",
                                     "--record",
                                     path("omega.h5")};
    command.insert(command.end(), more.begin(), more.end());
    station_ = std::make_unique<ChildProcess>(command);
    ASSERT_TRUE(station_->wait_for_err("loop:", kLong)) << station_->err();
  }

  /// The hand goes down by 0.1 m/s until it feels so much; once the station is engaged, since what it moves
  /// before that moves no tip.
  ::testing::AssertionResult press(double force_n) {
    const auto engaged = wait_for(*station_, path("omega.h5"), [this](const RecordingReader& reader) {
      give_force_back();
      const std::vector<double> mode = reader.read("station_mode");
      return !mode.empty() && mode.back() == kEngaged;
    });
    if (!engaged) return ::testing::AssertionFailure() << "never engaged; " << station_->err();
    for (int k = 0; k < 20'000; ++k) {
      if (sdk_.force_n() >= force_n) return ::testing::AssertionSuccess();
      if (!station_->running()) break;
      give_force_back();
      if (sdk_->pos_d_m[2] > -0.06) sdk_->pos_d_m[2] = sdk_->pos_d_m[2] - 2e-5;
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    return ::testing::AssertionFailure() << "felt only " << sdk_.force_n() << " N at " << sdk_->pos_d_m[2]
                                         << " m; the station says: " << station_->err();
  }

  /// `calibrate --dynamics` on the stand-in, whose handle moves; Enter is there from the start. Where this
  /// machine stood still for longer than the watchdog waits, the device has cut its force: a person presses
  /// its button, and it begins again.
  Finished measure(const std::string& out) {
    for (int attempt = 0;; ++attempt) {
      give_force_back();
      const Finished run =
          run_program({"/bin/sh", "-c",
                       "echo | { " + kMaster + " calibrate --dynamics --seconds 10 --out " + out + "; }"});
      if (!was_paused(run) || attempt == 5) return run;
    }
  }

  /// This machine stood still, too often or for as long as the device's watchdog waits; the program has said so.
  static bool was_paused(const Finished& run) {
    return run.err.find("watchdog") != std::string::npos ||
           run.err.find("paused too often") != std::string::npos;
  }

  /// A person presses the device's force button after its watchdog has cut the force, as it does when this
  /// machine was too busy for ten milliseconds.
  void give_force_back() {
    if (sdk_->force_off_cause != 3) return;
    sdk_->watchdog_fired_ns = 0;
    sdk_->force_off_cause = 0;
  }

  /// Time from now until the motors show nothing; negative when they go on.
  std::int64_t time_to_zero_ns() {
    const std::int64_t begin_ns = now_ns();
    return soon([&] { return sdk_.force_n() == 0; }, Seconds(5)) ? now_ns() - begin_ns : -1;
  }

  /// How often the station of the first recording let go of the tip.
  int releases() const {
    const std::vector<double> mode = RecordingReader(path("omega.h5")).read("station_mode");
    int n = 0;
    for (std::size_t k = 1; k < mode.size(); ++k) n += mode[k - 1] == kEngaged && mode[k] != kEngaged;
    return n;
  }

  /// Ends the session and plays its hand again, to a tip that starts at the same place.
  void compare_with_its_replay() {
    station_->signal(SIGINT);
    ASSERT_TRUE(station_->wait(kLong));
    const Finished run =
        run_program({kMaster, "run", "--quiet", "--server", server_.address(), "--device",
                     "replay:" + path("omega.h5"), "--velocity-scale", "1e-6", "--force-scale", "1e7",
                     "--method", "ks-clamp", "--allow-unsafe-scaling", "--record", path("again.h5")});
    ASSERT_EQ(run.exit_code, 0) << run.err;
    const RecordingReader first(path("omega.h5"));
    const RecordingReader again(path("again.h5"));
    const auto lowest = [](const RecordingReader& reader, const char* column) {
      const auto z = reader.read(column, 2);
      return *std::min_element(z.begin(), z.end());
    };
    EXPECT_NEAR(lowest(again, "hand_pos_h_m"), lowest(first, "hand_pos_h_m"), 1e-9);
    // 1 nm is 1 mm of the hand; one tick of the hand at 0.1 m/s is 0.1 nm. The ticks of a replay lie between
    // those of the recording, so up to a tick's motion is lost where the tip is let go, and where it is taken.
    EXPECT_NEAR(lowest(again, "tip_target_w_nm"), lowest(first, "tip_target_w_nm"), 0.2 * (1 + releases()));
  }

  Server server_{scene_path("flat_silicon_oxide")};
  StandinSdk sdk_;
  std::unique_ptr<ChildProcess> station_;
};

TEST_F(OmegaTest, IsListed) {
  const Finished run = run_program({kMaster, "devices"});
  EXPECT_EQ(run.exit_code, 0);
  const auto lines = lines_of(run.out);
  ASSERT_GE(lines.size(), 3u);
  EXPECT_EQ(lines[0], "backend,name,serial,node,usable,why");
  EXPECT_THAT(run.out, HasSubstr("\nomega,omega.3,4711,,yes,\n"));
}

TEST_F(OmegaTest, ASessionIsFeltRecordedAndEndsInZeroForce) {
  start();
  ASSERT_TRUE(press(1.0));
  EXPECT_EQ(sdk_->first_force_n, 0);
  EXPECT_EQ(sdk_->gravity, 1);
  EXPECT_EQ(sdk_->watchdog_units, 80);
  station_->signal(SIGINT);
  ASSERT_TRUE(station_->wait(kLong));
  EXPECT_EQ(station_->exit_code(), 0) << station_->err();
  EXPECT_THAT(station_->err(), HasSubstr("omega.3, serial number 4711"));
  EXPECT_EQ(sdk_.force_n(), 0);
  EXPECT_EQ(sdk_->stopped, 1);
  EXPECT_EQ(sdk_->open, 0);
  const RecordingReader reader(path("omega.h5"));
  EXPECT_THAT(reader.configuration("device"), HasSubstr("omega.3"));
  // The observer counted what the device applied: by hand, from the recording, −ΣF(k−1)·Δx(k).
  std::array<std::vector<double>, 3> force;
  std::array<std::vector<double>, 3> pos;
  for (std::size_t c = 0; c < 3; ++c) {
    force[c] = reader.read("hand_force_applied_h_n", c);
    pos[c] = reader.read("hand_pos_h_m", c);
  }
  double energy_j = 0;
  for (std::size_t k = 1; k < pos[0].size(); ++k) {
    for (std::size_t c = 0; c < 3; ++c) energy_j -= force[c][k - 1] * (pos[c][k] - pos[c][k - 1]);
  }
  EXPECT_GT(energy_j, 0);
  EXPECT_NEAR(energy_j, reader.read("energy_j").back(), 1e-12);
}

TEST_F(OmegaTest, SaturationIsCountedAsApplied) {
  sdk_->saturation_n = 0.5;
  start();
  ASSERT_TRUE(press(0.49));
  for (int k = 0; k < 40; ++k) {  // and 4 mm further
    sdk_->pos_d_m[2] = sdk_->pos_d_m[2] - 1e-4;
    std::this_thread::sleep_for(Milliseconds(1));
  }
  std::this_thread::sleep_for(Milliseconds(100));
  station_->signal(SIGINT);
  ASSERT_TRUE(station_->wait(kLong));
  const RecordingReader reader(path("omega.h5"));
  double most_n = 0;
  double asked_n = 0;
  for (const double f : reader.read("hand_force_applied_h_n", 2)) most_n = std::max(most_n, std::fabs(f));
  for (const double f : reader.read("hand_force_commanded_h_n", 2)) asked_n = std::max(asked_n, std::fabs(f));
  EXPECT_NEAR(most_n, 0.5, 1e-12);
  EXPECT_GT(asked_n, 0.5);
}

TEST_F(OmegaTest, UncalibratedItHomesFirstWithoutForce) {
  sdk_->calibrated = 0;
  sdk_->pos_d_m[0] = 0.3;  // where it is means nothing yet
  start();
  EXPECT_THAT(station_->err(), HasSubstr("not calibrated"));
  std::this_thread::sleep_for(Milliseconds(300));
  EXPECT_EQ(sdk_.force_n(), 0);
  sdk_->pos_d_m[0] = 0;  // a leap that is no motion
  sdk_->calibrated = 1;
  ASSERT_TRUE(press(0.5));
  station_->signal(SIGINT);
  ASSERT_TRUE(station_->wait(kLong));
  EXPECT_EQ(station_->exit_code(), 0) << station_->err();
  const std::vector<double> mode = RecordingReader(path("omega.h5")).read("station_mode");
  EXPECT_EQ(mode.front(), kHoming);
  EXPECT_EQ(std::count(mode.begin(), mode.end(), kEngaged) > 0, true);
}

TEST_F(OmegaTest, FaultsEndInZeroForceAndOneLine) {
  struct Fault {
    const char* name;
    void (*inject)(support::StandinState&);
    const char* told;
  };
  const Fault faults[] = {
      {"unplugged", [](auto& s) { s.unplugged = 1; }, "unplugged"},
      {"position refused", [](auto& s) { s.result_of(DrdCall::kGetPosition) = -1; }, "device failed"},
      {"force refused", [](auto& s) { s.result_of(DrdCall::kSetForce) = -1; }, "device failed"},
      {"no power", [](auto& s) { s.power = 0; }, "no power"},
      {"device error", [](auto& s) { s.error = 1; }, "reports an error"},
      {"position not a number", [](auto& s) { s.pos_d_m[1] = std::nan(""); }, "not finite"},
      {"position leaps", [](auto& s) { s.pos_d_m[1] = 0.2; }, "velocity trip"},
      {"position leaps by metres", [](auto& s) { s.pos_d_m[1] = 50; }, "not believable"},
      {"applied force not a number",
       [](auto& s) {
         s.reported_force_n[2] = std::nan("");
         s.lie_about_force = 1;
         s.saturation_n = 0.01;
       },
       "applied force not finite"},
  };
  for (const Fault& fault : faults) {
    SCOPED_TRACE(fault.name);
    StandinSdk fresh;
    start({"--overwrite"});
    ASSERT_TRUE(press(0.5));
    fault.inject(*sdk_);
    const std::int64_t zero_ns = time_to_zero_ns();
    ASSERT_GE(zero_ns, 0) << "the motors go on";
    std::printf("%-28s zero force after %.1f ms\n", fault.name, 1e-6 * static_cast<double>(zero_ns));
    // A device that refuses commands is left to its watchdog; otherwise the status is seen within ten ticks.
    EXPECT_LE(zero_ns, std::max(kWatchdogNs, 10 * kTickNs) + kTickNs + kSchedulingNs);
    ASSERT_TRUE(station_->wait(kLong)) << "does not end";
    EXPECT_EQ(station_->exit_code(), 1);
    EXPECT_EQ(station_->ended_by(), 0);
    EXPECT_THAT(station_->err(), HasSubstr(fault.told));
    EXPECT_EQ(sdk_.force_n(), 0);
  }
}

TEST_F(OmegaTest, ForceOffIsToldAndHeldAtZeroUntilItIsOnAgain) {
  start();
  ASSERT_TRUE(press(0.5));
  sdk_->force_off_cause = 2;
  EXPECT_TRUE(station_->wait_for_err("moved too fast", kLong));
  EXPECT_EQ(sdk_.force_n(), 0);
  std::this_thread::sleep_for(Milliseconds(100));
  EXPECT_TRUE(station_->running());
  sdk_->force_off_cause = 0;
  EXPECT_TRUE(station_->wait_for_err("ready again", kLong));
  EXPECT_TRUE(soon([&] { return sdk_.force_n() > 0; }, Seconds(5))) << "the hand still presses";
  station_->signal(SIGINT);
  ASSERT_TRUE(station_->wait(kLong));
  EXPECT_EQ(station_->exit_code(), 0) << station_->err();
}

TEST_F(OmegaTest, StallsOfTheSdk) {
  start();
  for (const DrdCall call : {DrdCall::kGetPosition, DrdCall::kSetForce, DrdCall::kGetStatus}) {
    for (const int stall_ms : {1, 5, 20, 100, 500}) {
      if (stall_ms == 500 && call != DrdCall::kGetPosition) continue;  // for the length of the test
      SCOPED_TRACE("call " + std::to_string(static_cast<int>(call)) + ", ms " + std::to_string(stall_ms));
      ASSERT_TRUE(press(0.3));
      const std::size_t said = station_->err().size();
      const std::int64_t begin_ns = now_ns();
      sdk_->stall_of(call) = stall_ms * 1000;
      ASSERT_TRUE(soon([&] { return sdk_->stall_of(call) == 0; })) << "never called";
      std::int64_t told_ns = 0;
      while (now_ns() < begin_ns + (stall_ms + 50) * kMs) {
        if (told_ns == 0 && station_->err().find("stuck in the SDK function", said) != std::string::npos)
          told_ns = now_ns();
        std::this_thread::sleep_for(Milliseconds(1));
      }
      const std::int64_t fired_ns = sdk_->watchdog_fired_ns;
      if (stall_ms > 20) {
        ASSERT_NE(fired_ns, 0);
        EXPECT_LE(fired_ns - begin_ns, kWatchdogNs + kTickNs + kSchedulingNs);
        ASSERT_NE(told_ns, 0) << station_->err();
        std::printf("call %d stuck for %d ms: zero force after %.1f ms, told after %.0f ms\n",
                    static_cast<int>(call), stall_ms, 1e-6 * static_cast<double>(fired_ns - begin_ns),
                    1e-6 * static_cast<double>(told_ns - begin_ns));
        EXPECT_LE(told_ns - begin_ns, 100 * kMs + kSchedulingNs);
      }
      if (fired_ns != 0) {
        EXPECT_EQ(sdk_.force_n(), 0) << "nothing comes back by itself";
      }
      ASSERT_TRUE(station_->running()) << station_->err();
      // A person lets go, goes up, and presses the device's force button.
      give_force_back();
      for (int k = 0; k < 100 && sdk_->pos_d_m[2] < 0; ++k) {
        sdk_->pos_d_m[2] = sdk_->pos_d_m[2] + 1e-4;
        std::this_thread::sleep_for(Milliseconds(1));
      }
    }
  }
  station_->signal(SIGINT);
  ASSERT_TRUE(station_->wait(kLong));
  EXPECT_EQ(station_->exit_code(), 0) << station_->err();
}

TEST_F(OmegaTest, ACallThatNeverReturnsDoesNotKeepAPersonFromStopping) {
  start();
  ASSERT_TRUE(press(0.3));
  sdk_->stall_of(DrdCall::kGetPosition) = 60'000'000;
  EXPECT_TRUE(station_->wait_for_err("stuck in the SDK function dhdGetPosition", kLong));
  EXPECT_EQ(time_to_zero_ns() >= 0, true);
  station_->signal(SIGINT);
  ASSERT_TRUE(station_->wait(Seconds(10)));
  EXPECT_EQ(station_->exit_code(), 1);
  EXPECT_THAT(station_->err(), HasSubstr("does not return from the SDK's dhdGetPosition"));
  EXPECT_FALSE(RecordingReader(path("omega.h5")).cut_short());
}

TEST_F(OmegaTest, AReplayOfItIsTheSameMotion) {
  start();
  ASSERT_TRUE(press(0.5));
  compare_with_its_replay();
}

// While the device's force is cut, and when the station itself stood still, the hand moves no tip.
TEST_F(OmegaTest, AReplayLeavesOutWhatMovedNoTip) {
  start();
  ASSERT_TRUE(press(0.1));
  sdk_->force_off_cause = 3;
  ASSERT_TRUE(wait_for(*station_, path("omega.h5"), [](const RecordingReader& reader) {
    return reader.read("station_mode").back() != kEngaged;
  }));
  for (int k = 0; k < 150; ++k) {
    sdk_->pos_d_m[2] = sdk_->pos_d_m[2] - 2e-5;
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  ASSERT_TRUE(press(0.2));
  station_->signal(SIGSTOP);
  sdk_->pos_d_m[2] = sdk_->pos_d_m[2] - 5e-3;
  std::this_thread::sleep_for(Milliseconds(200));
  station_->signal(SIGCONT);
  ASSERT_TRUE(press(0.5));
  compare_with_its_replay();
  EXPECT_GE(releases(), 2);
}

/// A person at the prompt: their Enter goes through a named pipe, their hand is the stand-in's position.
TEST_F(OmegaTest, CalibrationFindsAxesSignsAndWorkspace) {
  const std::string pipe = path("enter");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  const std::string out = path("device.toml");
  ChildProcess wizard({"/bin/sh", "-c", "exec " + kMaster + " calibrate --out " + out + " <" + pipe});
  std::ofstream enter(pipe);
  std::size_t said = 0;
  const auto asks = [&](const std::string& words) {
    return soon([&] { return wizard.err().find(words, said) != std::string::npos; });
  };
  const auto press_enter = [&](const std::string& after) {
    ASSERT_TRUE(asks(after)) << wizard.err();
    said = wizard.err().size();
    std::this_thread::sleep_for(Milliseconds(20));  // for the position to be read
    enter << "\n" << std::flush;
  };
  const auto move_to = [&](double x, double y, double z) {
    sdk_->pos_d_m[0] = x;
    sdk_->pos_d_m[1] = y;
    sdk_->pos_d_m[2] = z;
    std::this_thread::sleep_for(Milliseconds(20));
  };
  // Mounted askew: the operator's right is the device's −x, away is −y, up is z.
  press_enter("Hold the handle still");
  move_to(-0.005, 0, 0);
  press_enter("to the right");
  press_enter("only 5.0 mm");  // too short: asked again
  move_to(-0.045, 0.003, 0);
  press_enter("to the right");
  press_enter("Hold the handle still");
  move_to(-0.04, -0.05, 0.01);
  press_enter("away from you");
  press_enter("Hold the handle still");
  move_to(-0.04, -0.05, 0.06);
  press_enter("up and hold");
  ASSERT_TRUE(asks("ends of its range"));
  move_to(-0.07, -0.06, -0.04);
  move_to(0.09, 0.08, 0.08);
  press_enter("ends of its range");
  ASSERT_TRUE(wizard.wait(kLong)) << wizard.err();
  EXPECT_EQ(wizard.exit_code(), 0) << wizard.err();
  EXPECT_EQ(file_text(out),
            "[device]\nkind = \"omega\"\naxes = \"-x -y +z\"\ncentre_m = [0.0100, 0.0100, 0.0200]\n"
            "workspace_half_m = 0.0600\n");
  EXPECT_EQ(sdk_.force_n(), 0);
  // And a session takes it.
  const Finished run =
      run_program({kMaster, "run", "--config", out, "--server", server_.address(), "--duration-s", "0.5",
                   "--quiet", "--velocity-scale", "1e-6", "--force-scale", "3e6"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
}

double value_of(const std::string& toml, const std::string& key) {
  const std::size_t at = toml.find("\n" + key + " = ");
  return at == std::string::npos ? -1 : std::stod(toml.substr(at + key.size() + 4));
}

TEST_F(OmegaTest, CalibrationMeasuresDampingAndMass) {
  sdk_->mass_kg = 0.3;
  sdk_->damping_n_s_m = 0.8;
  sdk_->friction_n = 0.02;
  const std::string out = path("dynamics.toml");
  const Finished run = measure(out);
  // Time is what is measured: a machine whose processors are taken away for too long cannot, six times, and says so.
  if (was_paused(run)) GTEST_SKIP() << run.err;
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("The handle will move by itself"));
  const std::string toml = file_text(out);
  // A lower bound; within 5 % where the loop keeps its time (AxisDynamics.*), less close on a busy machine.
  EXPECT_LT(value_of(toml, "damping_n_s_m"), 0.8 * 1.005) << run.err;
  EXPECT_GT(value_of(toml, "damping_n_s_m"), 0.8 * 0.85) << run.err;
  EXPECT_NEAR(value_of(toml, "mass_kg"), 0.3, 0.05 * 0.3) << run.err;
  EXPECT_EQ(sdk_.force_n(), 0);
  EXPECT_EQ(sdk_->open, 0);
  // The plan rests on it, and says so.
  const Finished plan = run_program({kMaster, "plan", "--config", out, "--server", server_.address()});
  EXPECT_EQ(plan.exit_code, 0) << plan.err;
  EXPECT_THAT(plan.err, HasSubstr("as [device] damping_n_s_m states"));
}

TEST_F(OmegaTest, CalibrationRefusesAHandThatHoldsOn) {
  sdk_->mass_kg = 0.3;
  sdk_->damping_n_s_m = 0.8;
  sdk_->held_n_m = 300;
  const std::string out = path("dynamics.toml");
  const Finished run = measure(out);
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, HasSubstr("axis x"));
  EXPECT_THAT(run.err, HasSubstr("let go of it"));
  EXPECT_THAT(run.err, ::testing::Not(HasSubstr("measuring: 50 %")))
      << "before the other two axes are measured";
  EXPECT_FALSE(std::filesystem::exists(out));
  EXPECT_EQ(sdk_.force_n(), 0);
}

TEST_F(OmegaTest, CalibrationWaitsForAHandleThatIsNotYetCalibrated) {
  sdk_->calibrated = 0;
  const std::string pipe = path("enter");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  ChildProcess wizard(
      {"/bin/sh", "-c", "exec " + kMaster + " calibrate --dynamics --out " + path("d.toml") + " <" + pipe});
  std::ofstream enter(pipe);
  enter << "\n" << std::flush;
  ASSERT_TRUE(wizard.wait_for_err("The device is not calibrated", kLong)) << wizard.err();
  EXPECT_THAT(wizard.err(), ::testing::Not(HasSubstr("measuring")));
  sdk_->calibrated = 1;
  std::this_thread::sleep_for(Milliseconds(200));  // until the status is looked at
  enter << "\n" << std::flush;
  EXPECT_TRUE(wizard.wait_for_err("measuring", kLong)) << wizard.err();
  wizard.signal(SIGINT);
  ASSERT_TRUE(wizard.wait(kLong)) << wizard.err();
  EXPECT_EQ(wizard.exit_code(), 1);
  EXPECT_EQ(sdk_.force_n(), 0);
}

TEST_F(OmegaTest, CalibrationTellsOfADeviceThatIsUnpluggedBeforeItBegins) {
  const std::string pipe = path("enter");
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  ChildProcess wizard(
      {"/bin/sh", "-c", "exec " + kMaster + " calibrate --dynamics --out " + path("d.toml") + " <" + pipe});
  std::ofstream enter(pipe);
  ASSERT_TRUE(wizard.wait_for_err("press Enter", kLong)) << wizard.err();
  sdk_->unplugged = 1;
  ASSERT_TRUE(wizard.wait(kLong)) << wizard.err();
  EXPECT_EQ(wizard.exit_code(), 1);
  EXPECT_THAT(wizard.err(), HasSubstr("unplugged"));
}

TEST_F(OmegaTest, CalibrationEndsWithItsInput) {
  const Finished run = run_program({"/bin/sh", "-c", kMaster + " calibrate --dynamics </dev/null"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, HasSubstr("calibrate: end of input; nothing was written"));
  EXPECT_EQ(sdk_->open, 0);
}

TEST_F(OmegaTest, CalibrationThatLosesTheDeviceSaysSo) {
  sdk_->mass_kg = 0.3;
  sdk_->damping_n_s_m = 0.8;
  const std::string out = path("dynamics.toml");
  for (int attempt = 0; attempt < 5; ++attempt) {
    give_force_back();
    sdk_->unplugged = 0;
    ChildProcess wizard(
        {"/bin/sh", "-c", "echo | { " + kMaster + " calibrate --dynamics --out " + out + "; }"});
    const bool measuring = wizard.wait_for_err("measuring", kLong);
    sdk_->unplugged = 1;
    ASSERT_TRUE(wizard.wait(kLong)) << wizard.err();
    EXPECT_EQ(wizard.exit_code(), 1);
    // This machine stood still for longer than the watchdog waits.
    if (!measuring || wizard.err().find("watchdog") != std::string::npos) continue;
    EXPECT_THAT(wizard.err(), HasSubstr("unplugged"));
    EXPECT_FALSE(std::filesystem::exists(out));
    return;
  }
  FAIL() << "the watchdog has cut the force five times";
}

/// The vendor's library never comes back: said at once, and Ctrl-C ends the program all the same.
TEST_F(OmegaTest, CalibrationThatIsStuckInACallIsSaidAndCanBeStopped) {
  sdk_->mass_kg = 0.3;
  sdk_->damping_n_s_m = 0.8;
  const std::string out = path("dynamics.toml");
  give_force_back();
  // The shell waits for nothing: the signal is the program's.
  ChildProcess wizard(
      {"/bin/sh", "-c", "exec " + kMaster + " calibrate --dynamics --out " + out + " <<E\n\nE\n"});
  ASSERT_TRUE(wizard.wait_for_err("measuring", kLong)) << wizard.err();
  sdk_->stall_of(DrdCall::kGetPosition) = 60'000'000;
  const bool said = wizard.wait_for_err("stuck in the SDK function", kLong);
  // A machine that stood still for as long as the device's watchdog waits: the program ended before the call that is stuck.
  if (!said && wizard.err().find("heard nothing within its watchdog") != std::string::npos)
    GTEST_SKIP() << wizard.err();
  ASSERT_TRUE(said) << wizard.err();
  wizard.signal(SIGINT);
  ASSERT_TRUE(wizard.wait(kLong)) << wizard.err();
  EXPECT_EQ(wizard.exit_code(), 1);
  EXPECT_THAT(wizard.err(), HasSubstr("ended without it"));
  EXPECT_FALSE(std::filesystem::exists(out));
}

/// Nobody has measured it: the plan names what it took.
TEST_F(OmegaTest, APlanForADeviceNeverMeasuredIsPessimisticAndSaysSo) {
  const Finished plan = run_program({kMaster, "plan", "--device", "omega", "--server", server_.address()});
  EXPECT_EQ(plan.exit_code, 0) << plan.err;
  EXPECT_THAT(plan.err, HasSubstr("device damping: not measured, 0.1 N s/m taken"));
  EXPECT_THAT(plan.out, HasSubstr("device_damping,0.1,"));
}

}  // namespace
}  // namespace telenano::programs

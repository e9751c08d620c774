// What a server with an AFM refuses before anything moves, by the real programs.
#include <string>
#include <utility>
#include <vector>

#include "tests/system/afm_programs.h"

namespace telenano::programs {
namespace {

TEST_F(AfmProgramsTest, WhatDoesNotFitIsRefusedInOneLineAndNothingMoves) {
  struct Case {
    std::vector<std::string> sim;
    std::string key, value, expected;
    std::vector<int> order{0, 1, 2, 3};
  };
  const std::vector<Case> cases = {
      {{}, "sensitivity_nm_v", "-50.0", "sensitivity_nm_v"},
      {{"--z-sign", "-1"}, "step_nm", "1.0", "z_sign"},
      {{}, "deflection", "40", "there is no signal 40"},
      {{}, "half_width_nm", "6000.0", "beyond the piezo's range"},
      {{"--range-z-nm", "80"}, "step_nm", "1.0", "beyond the piezo's range"},
      {{"--restrict-roles"}, "step_nm", "1.0", "port for that role", {1, 0, 2, 3}},
      {{"--restrict-roles"}, "step_nm", "1.0", "port for that role", {0, 1, 3, 2}},
      {{}, "z_sign", "0", "z_sign"},
      {{}, "step_nm", "6.0", "step_nm"},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.key + " = " + c.value + " " + c.expected);
    Simulator simulator(c.sim);
    const Finished done = run_program(serve(simulator.ports(c.order), changed(c.key, c.value)));
    EXPECT_EQ(done.exit_code, 2);
    EXPECT_NE(done.err.find(c.expected), std::string::npos) << done.err;
    EXPECT_EQ(lines_of(done.err).size(), 1u) << done.err;
    ::usleep(200'000);
    const std::string end = simulator.stop();
    EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
    EXPECT_NE(end.find("; 0 calls that move"), std::string::npos) << end;
  }
}

TEST_F(AfmProgramsTest, AControllerInUseAndNoneAtAllAreRefused) {
  Simulator simulator;
  {
    ChildProcess first(serve(simulator.ports(), afm()));
    ASSERT_GT(port_of(first), 0);
    const Finished second = run_program(serve(simulator.ports(), afm()));
    EXPECT_EQ(second.exit_code, 2);
    EXPECT_NE(second.err.find("in use by another client"), std::string::npos) << second.err;
    EXPECT_EQ(lines_of(second.err).size(), 1u) << second.err;
    EXPECT_TRUE(first.running()) << "and the first one goes on";
    const pid_t guard = guard_of(first);
    first.signal(SIGTERM);
    EXPECT_TRUE(first.wait(kLong));
    EXPECT_TRUE(guard > 0 && ends(guard));
  }
  simulator.stop();
  const Finished none = run_program(serve(simulator.ports(), afm()));
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_NE(none.err.find("cannot connect"), std::string::npos) << none.err;
  const Finished twice = run_program(serve("6501,6501,6502,6503", afm()));
  EXPECT_EQ(twice.exit_code, 2);
  EXPECT_NE(twice.err.find("two roles"), std::string::npos) << twice.err;
}

TEST_F(AfmProgramsTest, FlagsThatDoNotGoTogether) {
  for (const auto& [flags, expected] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{}, "--scene is missing"},
           {{"--slave", "nanonis"}, "--controller is missing"},
           {{"--slave", "nanonis", "--controller", "127.0.0.1"}, "--afm is missing"},
           {{"--slave", "nanonis", "--scene", "x.toml"}, "--scene belongs to"},
           {{"--slave", "nanonis", "--controller", "127.0.0.1", "--afm", afm_file()},
            "without a deadman beside the controller the tip stays on the sample"},
           {{"--scene", "x.toml", "--afm", "y.toml"}, "belong to --slave nanonis"},
           {{"--scene", "x.toml", "--without-deadman"}, "belong to --slave nanonis"}}) {
    std::vector<std::string> command{kNve, "serve", "--listen", "127.0.0.1:0"};
    command.insert(command.end(), flags.begin(), flags.end());
    const Finished done = run_program(command);
    EXPECT_EQ(done.exit_code, 2);
    EXPECT_NE(done.err.find(expected), std::string::npos) << done.err;
  }
}

}  // namespace
}  // namespace telenano::programs

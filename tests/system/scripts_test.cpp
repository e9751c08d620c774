// The scripts of deploy/ and of the tests, as far as they run anywhere: what they would do, and what they
// refuse.
#include "tests/source_dir.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

const std::string kProject = TELENANO_SOURCE_DIR;

Finished script(const std::string& name, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {"/bin/bash", kProject + "/" + name});
  return run_program(arguments, {}, kLong);
}

void expect_refused(const std::string& name, const std::vector<std::string>& arguments,
                    const std::string& said, int exit_code = 2) {
  const Finished run = script(name, arguments);
  EXPECT_EQ(run.exit_code, exit_code) << run.err;
  EXPECT_EQ(lines_of(run.err).size(), 1u) << run.err;
  EXPECT_NE(run.err.find(said), std::string::npos) << run.err;
  EXPECT_EQ(run.out, "");
}

TEST(NetemScript, SaysItInTheWordsOfTc) {
  const auto words = [](const std::vector<std::string>& options) {
    std::vector<std::string> arguments{"apply", "eth9", "--dry-run"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    return script("deploy/netem.sh", arguments).out;
  };
  const std::string begin = "tc qdisc replace dev eth9 root netem limit 10000";
  EXPECT_EQ(words({}), begin + "\n");
  EXPECT_EQ(words({"--delay-ms", "20", "--jitter-ms", "2", "--any-order"}),
            begin + " delay 20ms 2ms distribution normal\n");
  // A rate keeps the order.
  EXPECT_EQ(words({"--delay-ms", "20", "--jitter-ms", "2"}),
            begin + " delay 20ms 2ms distribution normal rate 100gbit\n");
  // Into a burst with p, out of it with 1/4: p/(p + 1/4) = 5 %.
  EXPECT_EQ(words({"--loss", "0.05", "--burst", "4"}), begin + " loss gemodel 1.31578947% 25% 100% 0%\n");
  EXPECT_EQ(words({"--loss", "0.05", "--duplicate", "0.01", "--corrupt", "1e-3", "--rate-bit-s", "1e6"}),
            begin + " loss 5% duplicate 1% corrupt 0.1% rate 1000000bit\n");
}

TEST(NetemScript, RefusesInOneLine) {
  const std::string name = "deploy/netem.sh";
  expect_refused(name, {}, "nothing is asked for");
  expect_refused(name, {"mend", "eth9"}, "'mend' is unknown");
  expect_refused(name, {"apply"}, "no interface is named");
  expect_refused(name, {"apply", "eth9", "--loss", "5"}, "--loss is '5', expected a number from 0 to 1");
  expect_refused(name, {"apply", "eth9", "--loss", "nan"}, "--loss is 'nan'");
  expect_refused(name, {"apply", "eth9", "--jitter-ms", "3"}, "expected at most --delay-ms");
  expect_refused(name, {"apply", "eth9", "--reorder", "0.1"}, "--reorder needs --delay-ms");
  expect_refused(name, {"apply", "eth9", "--los", "0.1"}, "--los is unknown");
}

TEST(FuzzScript, RefusesInOneLine) {
  expect_refused("deploy/fuzz.sh", {"--no-install", "datagrams"}, "there is no target 'datagrams'");
  expect_refused("deploy/fuzz.sh", {"--no-install", "--runs", "1e6"}, "expected a whole number");
  expect_refused("deploy/fuzz.sh", {"--no-install", "--run", "1"}, "there is no option --run");
}

/// Which clang the scripts take, of those in a folder.
class NewestClang : public ProgramsTest {
 protected:
  void install(const std::string& name, const std::string& version) const {
    write(name, "#!/bin/bash\necho 'Debian clang version " + version + "'\n");
    std::filesystem::permissions(path(name), std::filesystem::perms::owner_all);
  }
  std::string found() const {
    return run_program(
               {"/bin/bash", "-c",
                ". " + kProject + "/deploy/lib.sh; PATH=" + path("") + "; newest_clang clang++ || echo none"},
               {}, kLong)
        .out;
  }
};

TEST_F(NewestClang, IsOfAnyVersionFromFourteenOn) {
  EXPECT_EQ(found(), "none\n");
  install("clang++-9", "9.0.1");
  install("clang++", "13.0.1");
  EXPECT_EQ(found(), "none\n");
  install("clang++-14", "14.0.6");
  EXPECT_EQ(found(), "clang++-14\n");
  install("clang++-19", "19.1.7 (3)");
  install("clang++-wrapper-99", "99.0.0");
  EXPECT_EQ(found(), "clang++-19\n");
  install("clang++", "19.1.7 (3)");
  EXPECT_EQ(found(), "clang++\n");
}

TEST(LintScript, RefusesInOneLine) {
  expect_refused("deploy/lint.sh", {"--no-install", "--formt"}, "there is no option --formt");
  expect_refused("deploy/lint.sh", {"--no-install", "nowhere.cpp"}, "there is no file nowhere.cpp");
  expect_refused("deploy/lint.sh", {"--no-install", "server.h"}, "a header is looked at with");
  expect_refused("deploy/lint.sh", {"--no-install", "--fix", kProject + "/tests/system/scripts_test.cpp"},
                 "name no files");
}

TEST(PackageScript, RefusesInOneLine) {
  expect_refused("deploy/package.sh", {"--no-install", "--onyl", "server"}, "there is no option --onyl");
  expect_refused("deploy/package.sh", {"--no-install", "--only"}, "expected server, station, lab or dev");
  expect_refused("deploy/package.sh", {"--no-install", "--only", "nve"}, "--only is 'nve'");
  expect_refused("deploy/package.sh", {"--no-install", "--out"}, "--out needs a folder");
}

TEST(VmScript, SaysWhyItCannot) {
  expect_refused("tests/system/vm.sh", {}, "no script is named");
  expect_refused("tests/system/vm.sh", {"/nowhere.sh"}, "there is no script /nowhere.sh");
  expect_refused("tests/system/vm.sh", {"--modules"}, "--modules needs a value");
  const Finished none =
      run_program({"/usr/bin/env", "TELENANO_VM_CACHE=/nowhere", "/bin/bash",
                   kProject + "/tests/system/vm.sh", kProject + "/tests/system/netem_vm.sh"},
                  {}, kLong);
  EXPECT_EQ(none.exit_code, 77) << "CTest's word for skipped";
  EXPECT_NE(none.err.find("--prepare"), std::string::npos) << none.err;
}

/// deploy/test.sh in a project of its own with these tests, each a line of shell that CTest runs, and nothing
/// to build.
class TestScript : public ProgramsTest {
 protected:
  Finished run(const std::vector<std::pair<std::string, std::string>>& tests) const {
    namespace fs = std::filesystem;
    for (const char* folder : {"deploy", "bin", "build/release"}) fs::create_directories(folder_ / folder);
    for (const char* name : {"deploy/test.sh", "deploy/lib.sh", "deploy/skipped.sh"})
      fs::copy_file(kProject + "/" + name, path(name), fs::copy_options::overwrite_existing);
    write("bin/cmake", "#!/bin/sh\n");
    fs::permissions(path("bin/cmake"), fs::perms::owner_all);
    std::string list;
    for (const auto& [name, shell] : tests) {
      write(name + ".sh", shell);
      list += "add_test(" + name + " /bin/sh " + path(name + ".sh") + ")\nset_tests_properties(" + name +
              " PROPERTIES SKIP_RETURN_CODE 77 SKIP_REGULAR_EXPRESSION \"SKIPPED\")\n";
    }
    write("build/release/CTestTestfile.cmake", list);
    return run_program({"/usr/bin/env", "PATH=" + path("bin") + ":" + std::getenv("PATH"), "/bin/bash",
                        path("deploy/test.sh"), "--no-install"},
                       {}, kLong);
  }
};

// The forms in which the tests say it: GoogleTest's, as its 1.12 prints it, vm.sh's and lint.sh's.
const std::string kGoogleTestSkips =
    "cat <<E\n[ RUN      ] A.B\n/x/a_test.cpp:12: Skipped\nno strace (apt install strace)\n\n"
    "[  SKIPPED ] A.B (0 ms)\n[  SKIPPED ] 1 test, listed below:\n[  SKIPPED ] A.B\nE\n";

TEST_F(TestScript, TellsAtItsEndHowManyWereSkippedAndWhy) {
  const Finished run = this->run({{"good", "exit 0"},
                                  {"a", kGoogleTestSkips},
                                  {"b", kGoogleTestSkips},
                                  {"vm", "echo before; echo 'vm: cannot run here: no kernel' >&2; exit 77"},
                                  {"lint", "echo 'skipped: no clang-format-14'; exit 77"},
                                  {"mute", "exit 77"}});
  EXPECT_EQ(run.exit_code, 0) << run.out << run.err;
  const std::string end =
      "\nSkipped: 5 of 6 tests\n"
      "  no strace (apt install strace): a, b\n"
      "  no kernel: vm\n"
      "  no clang-format-14: lint\n"
      "  no reason given: mute\n"
      "100% tests passed, 0 tests failed out of 6\n";
  EXPECT_TRUE(run.out.ends_with(end)) << run.out;
}

TEST_F(TestScript, KeepsTheExitCodeAndTheLastWordsOfCTest) {
  const Finished run = this->run({{"good", "exit 0"}, {"bad", "echo skipped: not so; exit 1"}});
  EXPECT_EQ(run.exit_code, 8) << "CTest's own for tests that failed";
  EXPECT_TRUE(run.out.ends_with("\nSkipped: 0 of 2 tests\n50% tests passed, 1 tests failed out of 2\n"))
      << run.out;
}

TEST(SkippedScript, RefusesInOneLine) {
  expect_refused("deploy/skipped.sh", {"--why"}, "there is no option --why");
  expect_refused("deploy/skipped.sh", {"/nowhere"}, "there is no file /nowhere/said.txt");
}

}  // namespace
}  // namespace telenano::programs

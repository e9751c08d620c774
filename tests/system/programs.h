#pragma once

#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/source_dir.h"
#include "tests/support/child_process.h"

/// What the tests of the real programs share: where they are, a folder to work in, a server to talk to.
namespace telenano::programs {

using support::ChildOptions;
using support::ChildProcess;
using support::Finished;
using support::run_program;
using Seconds = std::chrono::seconds;
using Milliseconds = std::chrono::milliseconds;

inline const std::string kNve = TELENANO_NVE;
inline const std::string kMaster = TELENANO_MASTER;
inline const std::string kLab = TELENANO_LAB;

/// Nothing here takes so long: only a program that hangs does.
constexpr Seconds kLong{60};

inline std::string scene_path(const std::string& name) {
  return std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml";
}

inline std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

inline std::string file_text(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

/// Threads of a process by what the kernel schedules them as: those with `priority` under SCHED_FIFO, and the
/// other real-time ones.
inline std::pair<int, int> realtime_threads(pid_t pid, int priority) {
  int with = 0, others = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/task")) {
    const std::string stat = file_text(task.path() / "stat");
    // proc(5): after the name in parentheses the 40th field is rt_priority, the 41st policy.
    std::istringstream fields(stat.substr(std::min(stat.size(), stat.rfind(')') + 1)));
    std::string field;
    for (int number = 3; number < 40; ++number) fields >> field;
    int rt_priority = 0, policy = 0;
    fields >> rt_priority >> policy;
    if (policy == SCHED_FIFO && rt_priority == priority) {
      ++with;
    } else if (rt_priority > 0) {
      ++others;
    }
  }
  return {with, others};
}

/// telenano-nve serve on loopback; any free port unless one is given.
class Server {
 public:
  explicit Server(const std::string& scene, int port = 0, std::vector<std::string> more = {}) {
    std::vector<std::string> command{kNve,  "serve",    "--scene",
                                     scene, "--listen", "127.0.0.1:" + std::to_string(port)};
    command.insert(command.end(), more.begin(), more.end());
    child_ = std::make_unique<ChildProcess>(command);
    const std::string before = " on 127.0.0.1:";
    EXPECT_TRUE(child_->wait_for_err(before, kLong)) << child_->err();
    // The line may still be on its way: the port ends where it ends.
    EXPECT_TRUE(child_->wait_for_err("\n", kLong));
    const std::string text = child_->err();
    const auto at = text.find(before);
    if (at != std::string::npos) port_ = std::atoi(text.c_str() + at + before.size());
    EXPECT_GT(port_, 0) << text;
  }
  int port() const { return port_; }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
  ChildProcess& child() { return *child_; }

  /// SIGTERM; then what it said.
  std::string stop() {
    child_->signal(SIGTERM);
    EXPECT_TRUE(child_->wait(kLong)) << "the server does not end";
    EXPECT_EQ(child_->exit_code(), 0) << child_->err() << "signal " << child_->ended_by();
    EXPECT_EQ(child_->out(), "");
    return child_->err();
  }

 private:
  std::unique_ptr<ChildProcess> child_;
  int port_ = 0;
};

/// A fresh folder for every test.
class ProgramsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_programs_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return path(name);
  }

  /// telenano-master run --quiet with a server.
  static std::vector<std::string> station(const Server& server, const std::vector<std::string>& more) {
    std::vector<std::string> command{kMaster, "run", "--quiet", "--server", server.address()};
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }

  std::filesystem::path folder_;
};

}  // namespace telenano::programs

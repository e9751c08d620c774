#pragma once

#include <signal.h>
#include <sys/types.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/source_dir.h"
#include "tests/system/programs.h"

/// What the tests of the real programs with an AFM share: telenano-afm-sim, telenano-nve serve --slave nanonis,
/// telenano-master run.
namespace telenano::programs {

inline const std::string kSim = TELENANO_AFM_SIM;

inline std::string afm_file() {
  return std::string(TELENANO_SOURCE_DIR) + "/deploy/afm.toml";
}

/// telenano-afm-sim on free ports.
class Simulator {
 public:
  explicit Simulator(std::vector<std::string> flags = {}) {
    std::vector<std::string> command{kSim, "--ports", "0,0,0,0"};
    command.insert(command.end(), flags.begin(), flags.end());
    child_ = std::make_unique<ChildProcess>(command);
    EXPECT_TRUE(child_->wait_for_err("\n", kLong)) << child_->err();
    const std::string text = child_->err();
    for (std::size_t at = text.find("127.0.0.1:"); at != std::string::npos;
         at = text.find("127.0.0.1:", at + 1))
      ports_.push_back(std::atoi(text.c_str() + at + 10));
    EXPECT_EQ(ports_.size(), 4u) << text;
    ports_.resize(4);
  }
  // A guard goes on until its controller has said that the tip is up, so for ever once that is gone.
  ~Simulator() {
    if (ports_.size() != 4) return;
    const std::string emergency = "127.0.0.1:" + std::to_string(ports_[3]);
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator("/proc", error)) {
      std::ifstream file(entry.path() / "cmdline");
      const std::string line{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
      if (line.find("afm-guard") != std::string::npos && line.find(emergency) != std::string::npos)
        ::kill(std::atoi(entry.path().filename().c_str()), SIGKILL);
    }
  }
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  std::string ports(const std::vector<int>& order = {0, 1, 2, 3}) const {
    std::string text;
    for (const int i : order) {
      if (!text.empty()) text += ',';
      text += std::to_string(ports_[static_cast<std::size_t>(i)]);
    }
    return text;
  }
  /// True as soon as it has.
  bool says(const std::string& text) { return child_->wait_for_err(text, kLong); }
  /// True as soon as the tip has been out and is up again so many times.
  bool withdrawn(int times) {
    for (int i = 0; i < 100 * kLong.count(); ++i) {
      if (static_cast<int>(peaks_nn().size()) >= times) return true;
      ::usleep(10'000);
    }
    return false;
  }
  /// The tip's greatest force, each time that it was out.
  std::vector<double> peaks_nn() {
    std::vector<double> peaks;
    const std::string before = "its greatest force was ", text = child_->err();
    for (auto at = text.find(before); at != std::string::npos; at = text.find(before, at + 1))
      peaks.push_back(std::atof(text.c_str() + at + before.size()));
    return peaks;
  }
  /// What it says at the end: whether the tip is up, the greatest force, how often SafeTip acted.
  std::string stop() {
    child_->signal(SIGTERM);
    EXPECT_TRUE(child_->wait(kLong));
    return child_->err();
  }

 private:
  std::unique_ptr<ChildProcess> child_;
  std::vector<int> ports_;
};

inline std::vector<std::string> serve(const std::string& ports, const std::string& afm, int port = 0) {
  return {kNve, "serve", "--listen", "127.0.0.1:" + std::to_string(port), "--slave", "nanonis",
          "--controller", "127.0.0.1", "--ports", ports, "--afm", afm, "--without-deadman",
          // Beside the rig's file, which is a test's own.
          "--afm-state", afm.substr(0, afm.rfind('/'))};
}

inline int port_of(ChildProcess& child) {
  const std::string before = " on 127.0.0.1:";
  EXPECT_TRUE(child.wait_for_err(before, kLong)) << child.err();
  const std::string text = child.err();
  const auto at = text.find(before);
  return at == std::string::npos ? 0 : std::atoi(text.c_str() + at + before.size());
}

/// The guard of a server that runs: its only child. 0: none.
inline pid_t guard_of(const ChildProcess& server) {
  const std::string pid = std::to_string(server.pid());
  std::ifstream children("/proc/" + pid + "/task/" + pid + "/children");
  pid_t guard = 0;
  children >> guard;
  return guard;
}

inline bool alive(pid_t pid) {
  std::string line;
  std::getline(std::ifstream("/proc/" + std::to_string(pid) + "/stat"), line);
  const auto name_end = line.rfind(") ");
  return name_end != std::string::npos && line[name_end + 2] != 'Z';
}

/// The guard goes on until the controller has said that the tip is up.
inline bool ends(pid_t guard) {
  for (int i = 0; i < 100 * kLong.count() && alive(guard); ++i) ::usleep(10'000);
  return !alive(guard);
}

class AfmProgramsTest : public ProgramsTest {
 protected:
  /// deploy/afm.toml with the patience that a machine with many programs needs: no real-time promise here.
  static std::string patient() {
    std::string text = file_text(afm_file());
    for (const auto& [from, to] :
         {std::pair{"link_loss_ms = 100.0", "link_loss_ms = 3000.0"},
          std::pair{"reply_timeout_ms = 100.0", "stale_force_ms = 3000.0\nreply_timeout_ms = 3000.0"}}) {
      const auto at = text.find(from);
      EXPECT_NE(at, std::string::npos) << from;
      text.replace(at, std::string(from).size(), to);
    }
    return text;
  }
  std::string afm() const { return write("patient.toml", patient()); }
  /// The same with one value changed.
  std::string changed(const std::string& key, const std::string& value) const {
    std::string text = patient();
    const auto at = text.find("\n" + key + " = ");
    EXPECT_NE(at, std::string::npos) << key;
    const auto from = at + key.size() + 4, to = text.find_first_of(" \n", from);
    text.replace(from, to - from, value);
    return write("afm.toml", text);
  }
};

}  // namespace telenano::programs

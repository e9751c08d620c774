#pragma once

#include <algorithm>
#include <cmath>
#include <fstream>

#include "telenano/common/recording/recording_reader.h"
#include "telenano/master/viewer/png.h"
#include "tests/source_dir.h"
#include "tests/system/programs.h"

/// The station's picture with the real programs, and a person at its window.
namespace telenano::programs {

inline const std::string kScan = std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf";

// What a person at the window does, who waits until something is seen, and presses a key again where nothing
// is. Standard error goes to err.txt, whose newest line tells how far the session is.
inline const std::string kPerson = R"sh(
await() { for i in $(seq 900); do eval "$1" && return; sleep 0.1; done; echo "no: $1"; }
press_until() {
  for n in $(seq 24); do
    xdotool key $1
    for i in $(seq 50); do eval "$2" && return; sleep 0.1; done
  done
  echo "no: $2"
}
# The window's title says what has been drawn.
see() { xdotool search --sync --name "$1" >/dev/null; }
# The number after a word of the newest line that tells how far the session is.
told() { awk -v word="$1" '/ nN .* mJ /{for (i = 1; i < NF; ++i) if ($i == word) value = $(i + 1)} END {print value}' err.txt; }
time_told() { awk '/ nN .* mJ /{value = $1} END {print value + 0}' err.txt; }
above() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a != "" && a + 0 > b + 0) }'; }
below() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a != "" && a + 0 < b + 0) }'; }
# N moves of the pointer by so many pixels down, as fast as a hand goes.
drag() { xdotool $(for i in $(seq $1); do echo mousemove_relative -- 0 $2 sleep 0.03; done); }
# Drags by $3 pixels a move from height $2 until $1; $4: it is held already. A tip that its server has withdrawn (it
# had heard nothing for a while) is farther from the sample than the mouse leads it at once, and a hand whose window
# draws nothing for a while is let go: whoever gets no further lets go too, and drags again from there.
lead() {
  for n in 1 2 3; do
    [ "$4" = held ] && [ $n = 1 ] || { xdotool mousemove 760 $2 mousedown 1; echo click; }
    drag 165 $3
    end=$((SECONDS + 6)); while [ $SECONDS -lt $end ]; do eval "$1" && return; sleep 0.1; done
    xdotool mouseup 1; sleep 1.5
  done
  echo "no: $1"
}
)sh";

class ViewerPrograms : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_viewer_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  static std::vector<std::string> without_display(std::vector<std::string> command) {
    command.insert(command.begin(), {"/usr/bin/env", "-u", "DISPLAY", "-u", "WAYLAND_DISPLAY"});
    return command;
  }
  Finished refused(std::vector<std::string> flags) {
    std::vector<std::string> command = {kMaster, "run", "--server", "127.0.0.1:9"};
    command.insert(command.end(), flags.begin(), flags.end());
    return run_program(without_display(command));
  }
  /// What a person at a window needs and this machine has not got, with what to do; empty: all is here.
  static std::string missing(std::initializer_list<const char*> more = {}) {
    std::vector<const char*> programs = {"/usr/bin/xvfb-run", "/usr/bin/xdotool"};
    programs.insert(programs.end(), more);
    for (const char* program : programs) {
      if (!std::filesystem::exists(program))
        return std::string("no ") + program +
               ": apt-get install xvfb xauth xdotool bsdutils x11-xserver-utils";
    }
    return {};
  }
  /// Runs a script of this folder before a screen of its own.
  Finished before_a_screen(std::chrono::milliseconds most, const std::string& script = "user.sh",
                           const std::string& screen = "-screen 0 1280x800x24") {
    return run_program({"/usr/bin/xvfb-run", "-a", "-s", screen, "/bin/bash", path(script)}, {}, most);
  }
  std::filesystem::path folder_;
};

}  // namespace telenano::programs

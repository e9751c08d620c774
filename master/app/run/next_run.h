#pragma once

#include <atomic>
#include <string>
#include <thread>
#include <vector>

namespace telenano::app {

/// The words of a command line for the same session once more: a recording gets a name that is free, unless
/// it is to be overwritten. `server_scene`: at this sample of the server; empty: at the same one.
std::vector<std::string> words_of_next_run(std::vector<std::string> words,
                                           const std::string& server_scene = "");

/// The same program once more in this one's place, with all that it was told: what a person asks for in a
/// window. A thread that was made before the picture became the program's background does it, since what is
/// started gives way as its starter does.
class NextRun {
 public:
  NextRun();
  /// Without begin(): nothing happens.
  ~NextRun();
  NextRun(const NextRun&) = delete;
  NextRun& operator=(const NextRun&) = delete;

  /// A person wants it, once this session is over.
  void ask(const std::string& server_scene = "") {
    asked_ = true;
    server_scene_ = server_scene;
  }
  bool asked() const noexcept { return asked_; }
  /// Comes back only if the program cannot be started; why, one line.
  std::string begin();

 private:
  enum class Wish : int { kNone, kBegin, kEnd };
  std::atomic<Wish> wish_{Wish::kNone};
  std::atomic<bool> failed_{false};
  bool asked_ = false;
  std::string server_scene_;
  std::vector<std::string> words_;
  std::string why_;
  std::jthread thread_;
};

}  // namespace telenano::app

#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace telenano::app {

/// This program once more, with other arguments, as a process of its own. What it prints is kept; nothing
/// waits for it but the end of this object.
class OwnProgram {
 public:
  /// `shown`: what it says on standard error is also said here. Throws RunError when it cannot be started.
  OwnProgram(const std::vector<std::string>& arguments, bool shown);
  /// Asks it to end (SIGTERM) if it still runs, and waits.
  ~OwnProgram();
  OwnProgram(const OwnProgram&) = delete;
  OwnProgram& operator=(const OwnProgram&) = delete;

  /// Takes what it has printed; true once it has ended.
  bool ended();
  void ask_to_end() const;
  /// Once it has ended; of one that a signal ended, 128 and its number, as a shell has it.
  int exit_code() const noexcept { return exit_code_; }
  const std::string& out() const noexcept { return out_; }
  const std::string& err() const noexcept { return err_; }

 private:
  void take();

  pid_t pid_ = -1;
  int out_fd_ = -1;
  int err_fd_ = -1;
  bool shown_ = false;
  bool ended_ = false;
  int exit_code_ = -1;
  std::string out_;
  std::string err_;
};

/// The last lines that a person needs of what a program said: at most `most`, without progress.
std::vector<std::string> last_lines(const std::string& text, std::size_t most);

}  // namespace telenano::app

#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace telenano::support {

struct ChildOptions {
  std::filesystem::path folder{};                 ///< working directory; empty: the caller's
  std::string out_file{};                         ///< standard output goes there instead, e.g. /dev/full
  std::optional<std::uint64_t> file_bytes_max{};  ///< RLIMIT_FSIZE: a full disk, with another number
};

/// A program under test: started by fork and exec without a shell, everything that it prints on standard
/// output and error is kept. Killed, if it still runs, when the object goes, and by the kernel when the test
/// dies. Start children and signal them from one thread.
class ChildProcess {
 public:
  /// Throws std::runtime_error when it cannot be started.
  explicit ChildProcess(const std::vector<std::string>& command, const ChildOptions& options = {});
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// True when it has ended within that time.
  bool wait(std::chrono::milliseconds timeout);
  /// True as soon as standard error holds `text`; false when the time is up or the program ends without it.
  bool wait_for_err(const std::string& text, std::chrono::milliseconds timeout);
  void signal(int number) const;
  /// Nobody reads its STDOUT_FILENO or STDERR_FILENO any more.
  void hang_up(int fd);
  pid_t pid() const noexcept { return pid_; }

  bool running();
  int exit_code() const { return exit_code_; }  ///< -1 while it runs, or when a signal ended it
  int ended_by() const { return ended_by_; }    ///< that signal, 0 otherwise
  std::string out() { return pump(), out_; }    ///< so far
  std::string err() { return pump(), err_; }

 private:
  void pump();  // takes over what the pipes hold
  void reap(bool block);

  pid_t pid_ = -1;
  int out_fd_ = -1;
  int err_fd_ = -1;
  std::string out_;
  std::string err_;
  int exit_code_ = -1;
  int ended_by_ = 0;
};

/// Runs a program to its end; kills it, and says so by ended_by() = SIGKILL, when the time is up.
struct Finished {
  int exit_code = -1;
  int ended_by = 0;
  std::string out;
  std::string err;
};
Finished run_program(const std::vector<std::string>& command, const ChildOptions& options = {},
                     std::chrono::milliseconds timeout = std::chrono::seconds(60));

}  // namespace telenano::support

#include "tests/support/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

namespace telenano::support {
namespace {

using Clock = std::chrono::steady_clock;

void drain(int& fd, std::string& into) {
  std::array<char, 65536> buffer;
  while (fd >= 0) {
    const ssize_t n = ::read(fd, buffer.data(), buffer.size());
    if (n > 0) {
      into.append(buffer.data(), static_cast<std::size_t>(n));
    } else if (n == 0 || (errno != EINTR && errno != EAGAIN)) {
      ::close(fd);
      fd = -1;
    } else if (errno == EAGAIN) {
      return;
    }
  }
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& command, const ChildOptions& options) {
  std::array<int, 2> out{};
  std::array<int, 2> err{};
  // Close-on-exec: a child must not hold the pipes of its siblings open.
  if (::pipe2(out.data(), O_CLOEXEC) != 0 || ::pipe2(err.data(), O_CLOEXEC) != 0) {
    throw std::runtime_error(std::string("no pipe: ") + std::strerror(errno));
  }
  // All memory is taken before fork: between fork and exec only plain system calls.
  std::vector<char*> argv;
  for (const std::string& argument : command) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const std::string folder = options.folder.string();
  const pid_t parent = ::getpid();
  pid_ = ::fork();
  if (pid_ == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(126);
    ::setpgid(0, 0);  // a group of its own, so that all it starts can be ended with it
    if (!folder.empty() && ::chdir(folder.c_str()) != 0) ::_exit(126);
    if (options.file_bytes_max) {
      const rlimit limit{*options.file_bytes_max, *options.file_bytes_max};
      if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) ::_exit(126);
    }
    const int null = ::open("/dev/null", O_RDONLY);
    ::dup2(null, STDIN_FILENO);
    ::dup2(options.out_file.empty() ? out[1] : ::open(options.out_file.c_str(), O_WRONLY), STDOUT_FILENO);
    ::dup2(err[1], STDERR_FILENO);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  ::close(out[1]);
  ::close(err[1]);
  out_fd_ = out[0];
  err_fd_ = err[0];
  if (pid_ < 0) throw std::runtime_error(std::string("cannot fork: ") + std::strerror(errno));
  for (const int fd : {out_fd_, err_fd_}) ::fcntl(fd, F_SETFL, O_NONBLOCK);
}

ChildProcess::~ChildProcess() {
  if (pid_ > 0) {
    ::kill(pid_, SIGKILL);
    reap(true);
  }
  for (const int fd : {out_fd_, err_fd_}) {
    if (fd >= 0) ::close(fd);
  }
}

void ChildProcess::pump() {
  drain(out_fd_, out_);
  drain(err_fd_, err_);
}

void ChildProcess::reap(bool block) {
  if (pid_ < 0) return;
  int status = 0;
  if (::waitpid(pid_, &status, block ? 0 : WNOHANG) != pid_) return;
  pid_ = -1;
  if (WIFEXITED(status)) exit_code_ = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) ended_by_ = WTERMSIG(status);
  pump();
}

bool ChildProcess::running() {
  pump();
  reap(false);
  return pid_ > 0;
}

bool ChildProcess::wait(std::chrono::milliseconds timeout) {
  const auto end = Clock::now() + timeout;
  while (running()) {
    if (Clock::now() >= end) return false;
    ::poll(nullptr, 0, 2);
  }
  return true;
}

bool ChildProcess::wait_for_err(const std::string& text, std::chrono::milliseconds timeout) {
  const auto end = Clock::now() + timeout;
  for (;;) {
    const bool alive = running();
    if (err_.find(text) != std::string::npos) return true;
    if (!alive || Clock::now() >= end) return false;
    ::poll(nullptr, 0, 2);
  }
}

void ChildProcess::signal(int number) const {
  if (pid_ > 0) ::kill(pid_, number);
}

void ChildProcess::hang_up(int fd) {
  int& end = fd == STDOUT_FILENO ? out_fd_ : err_fd_;
  if (end >= 0) ::close(end);
  end = -1;
}

Finished run_program(const std::vector<std::string>& command, const ChildOptions& options,
                     std::chrono::milliseconds timeout) {
  ChildProcess child(command, options);
  if (!child.wait(timeout)) {
    if (child.pid() > 0) ::kill(-child.pid(), SIGKILL);  // a shell's or xvfb-run's own children too
    child.wait(std::chrono::seconds(10));
  }
  return {child.exit_code(), child.ended_by(), child.out(), child.err()};
}

}  // namespace telenano::support

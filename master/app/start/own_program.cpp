#include "telenano/master/app/start/own_program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <sstream>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

// Of a session of hours the last words count.
constexpr std::size_t kKept = 64 * 1024;

void keep(std::string& text, const char* data, std::size_t size) {
  text.append(data, size);
  if (text.size() > 2 * kKept) text.erase(0, text.size() - kKept);
}

}  // namespace

OwnProgram::OwnProgram(const std::vector<std::string>& arguments, bool shown) : shown_(shown) {
  int out[2] = {-1, -1};
  int err[2] = {-1, -1};
  if (::pipe2(out, O_CLOEXEC) != 0)
    throw RunError(std::string("cannot make a pipe: ") + std::strerror(errno));
  if (::pipe2(err, O_CLOEXEC) != 0) {
    ::close(out[0]);
    ::close(out[1]);
    throw RunError(std::string("cannot make a pipe: ") + std::strerror(errno));
  }
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
  ::posix_spawn_file_actions_adddup2(&actions, err[1], STDERR_FILENO);
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  std::vector<std::string> words{"telenano-master"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> pointers;
  pointers.reserve(words.size() + 1);
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  const int error = ::posix_spawn(&pid_, "/proc/self/exe", &actions, nullptr, pointers.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(out[1]);
  ::close(err[1]);
  out_fd_ = out[0];
  err_fd_ = err[0];
  ::fcntl(out_fd_, F_SETFL, O_NONBLOCK);
  ::fcntl(err_fd_, F_SETFL, O_NONBLOCK);
  if (error != 0) {
    ::close(out_fd_);
    ::close(err_fd_);
    throw RunError(std::string("cannot start a session's program: ") + std::strerror(error));
  }
}

OwnProgram::~OwnProgram() {
  if (!ended_) {
    ask_to_end();
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
  }
  ::close(out_fd_);
  ::close(err_fd_);
}

void OwnProgram::ask_to_end() const {
  if (!ended_) ::kill(pid_, SIGTERM);
}

void OwnProgram::take() {
  std::array<char, 4096> buffer;
  for (ssize_t n = 0; (n = ::read(out_fd_, buffer.data(), buffer.size())) > 0;)
    keep(out_, buffer.data(), static_cast<std::size_t>(n));
  for (ssize_t n = 0; (n = ::read(err_fd_, buffer.data(), buffer.size())) > 0;) {
    keep(err_, buffer.data(), static_cast<std::size_t>(n));
    if (shown_) std::fwrite(buffer.data(), 1, static_cast<std::size_t>(n), stderr);
  }
}

bool OwnProgram::ended() {
  if (ended_) return true;
  take();
  int status = 0;
  if (::waitpid(pid_, &status, WNOHANG) != pid_) return false;
  ended_ = true;
  take();
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return true;
}

std::vector<std::string> last_lines(const std::string& text, std::size_t most) {
  // A summary is told from its first line on; before it stand the progress and the terms.
  const auto summary = text.rfind("summary of ");
  std::istringstream stream(summary == std::string::npos ? text : text.substr(summary));
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) {
    if (!line.empty()) lines.push_back(line);
  }
  if (lines.size() <= most) return lines;
  if (summary == std::string::npos) return {lines.end() - static_cast<std::ptrdiff_t>(most), lines.end()};
  // The head of a summary is what was felt; its last line may be why the session ended.
  std::vector<std::string> told(lines.begin(), lines.begin() + static_cast<std::ptrdiff_t>(most) - 1);
  told.push_back(lines.back());
  return told;
}

}  // namespace telenano::app

#include "telenano/common/recording/child_call.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <new>

#include "telenano/common/base/error.h"

namespace telenano::recording {
namespace {

constexpr int kWantedAgainMs = 50;

enum class Outcome : std::uint8_t { kDone, kUserError, kRunError };

bool send_all(int fd, const void* data, std::size_t size) noexcept {
  const char* at = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t n = ::send(fd, at, size, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

bool receive_all(int fd, void* data, std::size_t size) noexcept {
  char* at = static_cast<char*>(data);
  while (size > 0) {
    const ssize_t n = ::recv(fd, at, size, 0);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

bool send_text(int fd, std::string_view text) noexcept {
  const std::uint64_t size = text.size();
  return send_all(fd, &size, sizeof size) && send_all(fd, text.data(), text.size());
}

bool receive_text(int fd, std::string& text, std::size_t most = SIZE_MAX) {
  std::uint64_t size = 0;
  if (!receive_all(fd, &size, sizeof size) || size > most) return false;
  text.resize(size);
  return receive_all(fd, text.data(), text.size());
}

void limit(int resource, rlim_t soft, rlim_t hard) noexcept {
  const rlimit value{soft, hard};
  ::setrlimit(static_cast<__rlimit_resource>(resource), &value);
}

/// Bytes of this process's address space.
rlim_t size_now() noexcept {
  std::FILE* const file = std::fopen("/proc/self/statm", "re");
  if (file == nullptr) return 0;
  unsigned long pages = 0;
  const bool read = std::fscanf(file, "%lu", &pages) == 1;
  std::fclose(file);
  return read ? static_cast<rlim_t>(pages) * static_cast<rlim_t>(::sysconf(_SC_PAGESIZE)) : 0;
}

/// The child: answers until its parent hangs up. Never returns, so that nothing of the parent's is undone
/// twice.
[[noreturn]] void serve_until_hung_up(int fd, const std::string& subject, const ChildCall::Serve& serve,
                                      const ChildLimits& limits) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  limit(RLIMIT_CORE, 0, 0);
  const auto seconds = static_cast<rlim_t>(limits.time.count());
  limit(RLIMIT_CPU, seconds, seconds + 1);
  if (limits.memory_bytes > 0) {
    const rlim_t most = size_now() + static_cast<rlim_t>(limits.memory_bytes);
    limit(RLIMIT_AS, most, most);
    limit(RLIMIT_FSIZE, 0, 0);
    limit(RLIMIT_NOFILE, 0, 0);
    static_cast<void>(::setpriority(PRIO_PROCESS, 0, 10));  // beside a station's loop
  }
  for (const int number : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGXCPU}) ::signal(number, SIG_DFL);
  // Ctrl-C goes to the whole group: the parent decides.
  ::signal(SIGINT, SIG_IGN);
  std::string request;
  while (receive_text(fd, request)) {
    std::string answer;
    Outcome outcome = Outcome::kDone;
    try {
      answer = serve(request);
    } catch (const UserError& error) {
      outcome = Outcome::kUserError;
      answer = error.what();
    } catch (const RunError& error) {
      outcome = Outcome::kRunError;
      answer = error.what();
    } catch (const std::exception& error) {
      outcome = Outcome::kRunError;
      answer = subject + ": damaged: it names sizes that do not fit into memory (" + error.what() + ")";
    }
    if (!send_all(fd, &outcome, sizeof outcome) || !send_text(fd, answer)) break;
  }
  ::_exit(0);
}

}  // namespace

ChildCall::ChildCall(std::string subject, const Serve& serve, std::chrono::seconds time_limit)
    : ChildCall(std::move(subject), serve,
                ChildLimits{time_limit, 0, SIZE_MAX, "the HDF5 library", "take another copy of the file"}) {}

ChildCall::ChildCall(std::string subject, const Serve& serve, const ChildLimits& limits)
    : subject_(std::move(subject)), limits_(limits) {
  int ends[2] = {-1, -1};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw RunError(subject_ + ": cannot be read in a process of its own: " + std::strerror(errno));
  // What stands in a buffer would stand in the child's too, and be written twice by whatever ends it.
  std::fflush(stdout);
  pid_ = ::fork();
  if (pid_ == 0) {
    ::close(ends[0]);
    serve_until_hung_up(ends[1], subject_, serve, limits);
  }
  const int error = errno;
  ::close(ends[1]);
  fd_ = ends[0];
  const timeval patience{static_cast<time_t>(limits.time.count()), 0};
  ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  if (pid_ < 0) {
    ::close(fd_);
    throw RunError(subject_ + ": cannot be read in a process of its own: " + std::strerror(error));
  }
}

ChildCall::~ChildCall() {
  ::close(fd_);
  // It is waiting for a request, or has ended; killing spares waiting for one that is lost in a loop.
  if (pid_ > 0) {
    ::kill(pid_, SIGKILL);
    while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
}

std::string ChildCall::ask(std::string_view request, const StillWanted& still_wanted) {
  Outcome outcome{};
  std::string answer;
  errno = 0;
  if (!send_text(fd_, request)) ended();
  if (still_wanted) await_answer(still_wanted);
  errno = 0;
  if (!receive_all(fd_, &outcome, sizeof outcome) || !receive_text(fd_, answer, limits_.answer_bytes))
    ended();
  if (outcome == Outcome::kUserError) throw UserError(answer);
  if (outcome == Outcome::kRunError) throw RunError(answer);
  return answer;
}

void ChildCall::await_answer(const StillWanted& still_wanted) {
  pollfd answer{fd_, POLLIN, 0};
  // A process that is ended hangs up, which ends this too.
  while (::poll(&answer, 1, kWantedAgainMs) <= 0) {
    if (!still_wanted()) stop();
  }
}

void ChildCall::stop() noexcept {
  const std::lock_guard lock(reaping_);
  if (pid_ > 0) ::kill(pid_, SIGKILL);
}

void ChildCall::give_way() noexcept {
  constexpr int kLeast = 19;
  const std::lock_guard lock(reaping_);
  if (pid_ > 0) static_cast<void>(::setpriority(PRIO_PROCESS, static_cast<id_t>(pid_), kLeast));
}

bool ChildCall::is_over() noexcept {
  const std::lock_guard lock(reaping_);
  return pid_ < 0;
}

void ChildCall::ended() {
  const bool too_slow = errno == EAGAIN || errno == EWOULDBLOCK;  // else it has hung up
  int status = 0;
  const std::lock_guard lock(reaping_);
  if (pid_ > 0) {
    if (too_slow) ::kill(pid_, SIGKILL);
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
  }
  // What takes long need not be damaged.
  if (too_slow || (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU))
    throw RunError(subject_ + ": " + limits_.reader + " found no end over it in " +
                   std::to_string(limits_.time.count()) + " s; " + limits_.advice);
  std::string how = "ended early";
  if (WIFSIGNALED(status)) how = std::string("crashed (") + ::strsignal(WTERMSIG(status)) + ")";
  throw RunError(subject_ + ": damaged: " + limits_.reader + " " + how + " over it; " + limits_.advice);
}

}  // namespace telenano::recording

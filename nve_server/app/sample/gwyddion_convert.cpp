#include "telenano/nve_server/app/sample/gwyddion_convert.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/import/gwy_file.h"

namespace telenano::app {
namespace {

constexpr std::size_t kSaidMax = 65536;

class Fd {
 public:
  explicit Fd(int fd = -1) : fd_(fd) {}
  ~Fd() { close(); }
  Fd(const Fd&) = delete;
  Fd& operator=(const Fd&) = delete;
  int get() const noexcept { return fd_; }
  void close() noexcept {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }

 private:
  int fd_;
};

/// Ctrl-C and its kin wait until what was begun is cleaned up.
class HeldSignals {
 public:
  HeldSignals() {
    sigemptyset(&held_);
    for (const int number : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&held_, number);
    ::sigprocmask(SIG_BLOCK, &held_, &before_);
  }
  ~HeldSignals() { ::sigprocmask(SIG_SETMASK, &before_, nullptr); }
  HeldSignals(const HeldSignals&) = delete;
  HeldSignals& operator=(const HeldSignals&) = delete;
  const sigset_t& held() const noexcept { return held_; }
  const sigset_t& before() const noexcept { return before_; }

 private:
  sigset_t held_{};
  sigset_t before_{};
};

class OwnFolder {
 public:
  OwnFolder() {
    std::error_code error;
    path_ = (std::filesystem::temp_directory_path(error) / "telenano-import-XXXXXX").string();
    if (error || ::mkdtemp(path_.data()) == nullptr)
      throw RunError("no folder can be made for the conversion: " + std::string(std::strerror(errno)));
  }
  ~OwnFolder() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  OwnFolder(const OwnFolder&) = delete;
  OwnFolder& operator=(const OwnFolder&) = delete;
  const std::string& path() const noexcept { return path_; }

 private:
  std::string path_;
};

/// This program's, without a display, and with a home that has neither settings nor modules of the user.
std::vector<std::string> environment(const std::string& home) {
  std::vector<std::string> result{"HOME=" + home, "NO_AT_BRIDGE=1"};
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string text = *entry;
    const std::string name = text.substr(0, text.find('='));
    if (name != "HOME" && name != "NO_AT_BRIDGE" && name != "DISPLAY" && name != "WAYLAND_DISPLAY" &&
        !name.starts_with("XDG_"))
      result.push_back(text);
  }
  return result;
}

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> result;
  for (std::string& text : texts) result.push_back(text.data());
  result.push_back(nullptr);
  return result;
}

void limit(int resource, rlim_t most) noexcept {
  const rlimit value{most, most};
  ::setrlimit(static_cast<__rlimit_resource>(resource), &value);
}

struct Ended {
  int status = 0;
  bool late = false;
  bool told_to_end = false;
  std::string said;
};

/// In its own group, so that whatever it starts ends with it.
class Child {
 public:
  Child(std::vector<std::string> command, std::vector<std::string> variables, const sigset_t& mask,
        const ConvertLimits& limits) {
    int output[2] = {-1, -1};
    int failed[2] = {-1, -1};
    if (::pipe2(output, O_CLOEXEC) != 0) throw RunError(std::string("no pipe: ") + std::strerror(errno));
    said_fd_.emplace(output[0]);
    const Fd output_in(output[1]);
    if (::pipe2(failed, O_CLOEXEC) != 0) throw RunError(std::string("no pipe: ") + std::strerror(errno));
    const Fd failed_out(failed[0]);
    Fd failed_in(failed[1]);
    std::vector<char*> arguments = pointers(command);
    std::vector<char*> settings = pointers(variables);
    pid_ = ::fork();
    if (pid_ < 0) throw RunError(std::string("no process can be started: ") + std::strerror(errno));
    if (pid_ == 0) {
      ::setpgid(0, 0);
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::sigprocmask(SIG_SETMASK, &mask, nullptr);
      limit(RLIMIT_CORE, 0);
      limit(RLIMIT_FSIZE, static_cast<rlim_t>(limits.bytes_max));
      limit(RLIMIT_AS, rlim_t{4} << 30);
      const int nothing = ::open("/dev/null", O_RDWR);
      if (nothing >= 0 && ::dup2(nothing, 0) == 0 && ::dup2(output_in.get(), 1) == 1 &&
          ::dup2(output_in.get(), 2) == 2)
        ::execvpe(arguments[0], arguments.data(), settings.data());
      const int why = errno;
      static_cast<void>(!::write(failed_in.get(), &why, sizeof why));
      ::_exit(127);
    }
    ::setpgid(pid_, pid_);  // whichever of the two comes first
    failed_in.close();
    ssize_t n = 0;
    while ((n = ::read(failed_out.get(), &start_error_, sizeof start_error_)) < 0 && errno == EINTR) {
    }
    if (n != static_cast<ssize_t>(sizeof start_error_)) start_error_ = 0;
  }
  ~Child() { end(); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  int start_error() const noexcept { return start_error_; }

  Ended wait(const sigset_t& held, std::chrono::milliseconds time) {
    Ended ended;
    const Fd signals(::signalfd(-1, &held, SFD_CLOEXEC));
    // Not by glibc's function: the header of Debian 12 declares it for C only.
    const Fd process(static_cast<int>(::syscall(SYS_pidfd_open, pid_, 0)));
    if (signals.get() < 0 || process.get() < 0)
      throw RunError(std::string("a process cannot be waited for: ") + std::strerror(errno));
    const auto until = std::chrono::steady_clock::now() + time;
    pollfd events[3] = {{process.get(), POLLIN, 0}, {signals.get(), POLLIN, 0}, {said_fd_->get(), POLLIN, 0}};
    while (events[0].revents == 0 && !ended.late && !ended.told_to_end) {
      const auto left =
          std::chrono::ceil<std::chrono::milliseconds>(until - std::chrono::steady_clock::now()).count();
      const int n = ::poll(events, 3, static_cast<int>(std::max<std::int64_t>(left, 0)));
      if (n < 0 && errno != EINTR) throw RunError(std::string("poll: ") + std::strerror(errno));
      if (n <= 0) {
        for (pollfd& event : events) event.revents = 0;
        ended.late = n == 0;
        continue;
      }
      ended.told_to_end = events[1].revents != 0;  // left pending: delivered when all is cleaned up
      if (events[2].revents != 0 && !hear(ended.said)) events[2].fd = -1;
    }
    ::fcntl(said_fd_->get(), F_SETFL, O_NONBLOCK);
    while (hear(ended.said)) {
    }
    ended.status = end();
    return ended;
  }

 private:
  /// False: there is no more.
  bool hear(std::string& said) const {
    char block[4096];
    const ssize_t n = ::read(said_fd_->get(), block, sizeof block);
    if (n <= 0) return n < 0 && errno == EINTR;
    said.append(block, std::min(static_cast<std::size_t>(n), kSaidMax - std::min(said.size(), kSaidMax)));
    return true;
  }
  /// Kills what still runs; how it ended.
  int end() noexcept {
    if (pid_ <= 0) return status_;
    ::kill(-pid_, SIGKILL);
    while (::waitpid(pid_, &status_, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return status_;
  }

  pid_t pid_ = -1;
  int status_ = 0;
  int start_error_ = 0;
  std::optional<Fd> said_fd_;
};

/// Gwyddion's own words: what it says of the file, else the last that it said.
std::string reason(const std::string& said, const std::string& file) {
  std::string last;
  std::istringstream lines(said);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(file + ": ")) return import::printable(line.substr(file.size() + 2));
    if (!line.empty()) last = line;
  }
  return last.empty() ? "it does not say why" : import::printable(last);
}

}  // namespace

std::string convert_by_gwyddion(const std::string& path, const ConvertLimits& limits) {
  const std::string file = std::filesystem::absolute(path).string();  // never taken for a flag
  const HeldSignals signals;
  const OwnFolder folder;
  const std::string out = folder.path() + "/converted.gwy";
  Child child({limits.program, "--convert-to-gwy=" + out, file}, environment(folder.path()), signals.before(),
              limits);
  if (child.start_error() == ENOENT) {
    throw UserError(
        path + ": is neither .gwy nor .gsf, and " + limits.program +
        ", which reads other formats, is not installed: apt-get install gwyddion (or save it as .gwy "
        "on a computer that has Gwyddion)");
  }
  if (child.start_error() != 0)
    throw RunError(limits.program + " cannot be started: " + std::strerror(child.start_error()));
  const Ended ended = child.wait(signals.held(), limits.time);
  if (ended.told_to_end) throw RunError(path + ": stopped while Gwyddion was reading it");
  if (ended.late) {
    throw UserError(path + ": Gwyddion has not read it within " + std::to_string(limits.time.count() / 1000) +
                    " s: open it there and save it as .gwy");
  }
  if (WIFSIGNALED(ended.status)) {
    const bool full = WTERMSIG(ended.status) == SIGXFSZ;
    throw UserError(path + ": Gwyddion " +
                    (full ? "makes more of it than " + std::to_string(limits.bytes_max) + " bytes"
                          : "crashes on it (signal " + std::to_string(WTERMSIG(ended.status)) + ")"));
  }
  if (WEXITSTATUS(ended.status) != 0)
    throw UserError(path + ": Gwyddion cannot read it: " + reason(ended.said, file));
  std::ifstream converted(out, std::ios::binary);
  std::string bytes;
  if (converted) {
    std::error_code error;
    const auto size = std::filesystem::file_size(out, error);
    if (!error) bytes.resize(static_cast<std::size_t>(size));
    converted.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (static_cast<std::size_t>(converted.gcount()) != bytes.size()) bytes.clear();
  }
  if (bytes.empty()) throw UserError(path + ": Gwyddion cannot convert it: " + reason(ended.said, file));
  return bytes;
}

}  // namespace telenano::app

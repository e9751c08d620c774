#include "telenano/common/security/private_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>

#include "telenano/common/base/error.h"

namespace telenano::security {
namespace {

// A list of thousands of keys; more is not one.
constexpr std::size_t kMaxBytes = 1 << 20;

class File {
 public:
  File(const std::string& path, int flags, mode_t mode = 0)
      : fd_(::open(path.c_str(), flags | O_CLOEXEC, mode)) {}
  ~File() {
    if (fd_ >= 0) ::close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int fd() const noexcept { return fd_; }

 private:
  int fd_;
};

[[noreturn]] void fail(const std::string& path, const std::string& what, const std::string& why) {
  throw UserError(what + " " + path + ": " + why);
}

// On the open file, not on its name: what is checked is what is read.
void check(const File& file, const std::string& path, const std::string& what) {
  if (file.fd() < 0) fail(path, what, std::string("cannot be read: ") + std::strerror(errno));
  struct stat info {};
  if (::fstat(file.fd(), &info) != 0)
    fail(path, what, std::string("cannot be read: ") + std::strerror(errno));
  if (!S_ISREG(info.st_mode)) fail(path, what, "is not a plain file");
  if (info.st_uid != ::geteuid() && info.st_uid != 0) {
    fail(
        path, what,
        "holds a secret but belongs to another user; run: chown " + std::to_string(::geteuid()) + " " + path);
  }
  if ((info.st_mode & 077) != 0) {
    std::array<char, 8> mode{};
    std::snprintf(mode.data(), mode.size(), "%04o", static_cast<unsigned>(info.st_mode & 07777));
    fail(path, what,
         std::string("holds a secret but its mode ") + mode.data() + " lets others at it; run: chmod 600 " +
             path);
  }
}

void write_all(const File& file, const std::string& content, const std::string& path,
               const std::string& what) {
  std::size_t done = 0;
  while (done < content.size()) {
    const ssize_t n = ::write(file.fd(), content.data() + done, content.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) throw RunError(what + " " + path + ": cannot be written: " + std::strerror(errno));
    done += static_cast<std::size_t>(n);
  }
  if (::fsync(file.fd()) != 0)
    throw RunError(what + " " + path + ": cannot be written: " + std::strerror(errno));
}

}  // namespace

std::string read_private_file(const std::string& path, const std::string& what) {
  // Without O_NONBLOCK a named pipe in the file's place would hold the program up.
  const File file(path, O_RDONLY | O_NONBLOCK);
  check(file, path, what);
  std::string content;
  std::array<char, 4096> part;
  for (;;) {
    const ssize_t n = ::read(file.fd(), part.data(), part.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail(path, what, std::string("cannot be read: ") + std::strerror(errno));
    if (n == 0) break;
    content.append(part.data(), static_cast<std::size_t>(n));
    if (content.size() > kMaxBytes) fail(path, what, "is longer than 1 MiB; expected a file of keys");
  }
  ::explicit_bzero(part.data(), part.size());
  return content;
}

void require_private_file(const std::string& path, const std::string& what) {
  check(File(path, O_RDONLY | O_NONBLOCK), path, what);
}

void create_private_file(const std::string& path, const std::string& content, const std::string& what) {
  const File file(path, O_WRONLY | O_CREAT | O_EXCL, 0600);
  if (file.fd() < 0 && errno == EEXIST) fail(path, what, "exists already; choose another name or remove it");
  if (file.fd() < 0) fail(path, what, std::string("cannot be made: ") + std::strerror(errno));
  write_all(file, content, path, what);
}

void replace_private_file(const std::string& path, const std::string& content, const std::string& what) {
  const std::string beside = path + ".new";
  {
    const File file(beside, O_WRONLY | O_CREAT | O_EXCL, 0600);
    if (file.fd() < 0 && errno == EEXIST) {
      fail(path, what, "is being changed by another program; if there is none, remove " + beside);
    }
    if (file.fd() < 0) fail(beside, what, std::string("cannot be made: ") + std::strerror(errno));
    try {
      write_all(file, content, beside, what);
    } catch (...) {
      ::unlink(beside.c_str());
      throw;
    }
  }
  if (::rename(beside.c_str(), path.c_str()) != 0) {
    const int error = errno;
    ::unlink(beside.c_str());
    throw RunError(what + " " + path + ": cannot be written: " + std::strerror(error));
  }
  // The new name, too, must outlive a loss of power: else a revoked key would be back after it.
  const auto slash = path.rfind('/');
  const File folder(slash == std::string::npos ? "." : path.substr(0, slash + 1), O_RDONLY | O_DIRECTORY);
  if (folder.fd() < 0 || (::fsync(folder.fd()) != 0 && errno != EINVAL && errno != EROFS))
    throw RunError(what + " " + path + ": its folder cannot be written: " + std::strerror(errno));
}

PrivateFileLock::PrivateFileLock(const std::string& path, const std::string& what, int patience_ms) {
  const std::string name = path + ".lock";
  fd_ = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd_ < 0) fail(name, what, std::string("cannot be made: ") + std::strerror(errno));
  using Clock = std::chrono::steady_clock;
  const auto give_up = Clock::now() + std::chrono::milliseconds(patience_ms);
  while (::flock(fd_, LOCK_EX | LOCK_NB) != 0) {
    if (errno == EINTR) continue;
    const int error = errno;
    if (error == EWOULDBLOCK && Clock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      continue;
    }
    ::close(fd_);
    if (error == EWOULDBLOCK) fail(path, what, "is being changed by another program, which holds " + name);
    fail(name, what, std::string("cannot be locked: ") + std::strerror(error));
  }
}

PrivateFileLock::~PrivateFileLock() {
  if (fd_ >= 0) ::close(fd_);
}

}  // namespace telenano::security

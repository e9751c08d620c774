#include "telenano/master/scene/scene_cache.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <system_error>
#include <vector>

namespace telenano::scene_store {
namespace {

namespace fs = std::filesystem;

constexpr const char* kExtension = ".scene";

/// Closes what it holds.
class File {
 public:
  explicit File(int fd) noexcept : fd_(fd) {}
  ~File() {
    if (fd_ >= 0) ::close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int fd() const noexcept { return fd_; }
  bool is_open() const noexcept { return fd_ >= 0; }

 private:
  int fd_;
};

// With `program`: of what that one found in it.
std::string name_of(const Sha256& hash, const std::string& program = "") {
  return hex(hash) + (program.empty() ? "" : "-" + program) + kExtension;
}

std::string complaint(const fs::path& folder, const std::string& why) {
  return folder.string() + ": the scene is not kept: " + why;
}

/// The folder, if it is the user's own and nobody else's.
File open_folder(const fs::path& folder, std::string& why) {
  File opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  struct stat about {};
  if (!opened.is_open() || ::fstat(opened.fd(), &about) != 0) {
    why = std::strerror(errno);
    return File(-1);
  }
  if (about.st_uid != ::geteuid() || (about.st_mode & 0077) != 0) {
    why = "other users have access to the folder (chmod 700)";
    return File(-1);
  }
  return File(::dup(opened.fd()));
}

bool read_all(int fd, std::string& bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::read(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<std::size_t>(n);
  }
  return true;
}

bool write_all(int fd, const std::string& bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<std::size_t>(n);
  }
  return true;
}

/// The bytes of a file in the folder, of which `good` says whether they are what they should be; removed if
/// not.
template <class Good>
std::optional<std::string> read_checked(const fs::path& path, const std::string& name, const Good& good) {
  std::string why;
  const File folder = open_folder(path, why);
  if (!folder.is_open()) return std::nullopt;
  const File file(::openat(folder.fd(), name.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  struct stat about {};
  if (!file.is_open() || ::fstat(file.fd(), &about) != 0) return std::nullopt;
  if (!S_ISREG(about.st_mode) || about.st_uid != ::geteuid()) return std::nullopt;
  std::string bytes;
  bool read = about.st_size >= 0 && static_cast<std::uint64_t>(about.st_size) <= SceneCache::kBytesMax;
  if (read) {
    bytes.resize(static_cast<std::size_t>(about.st_size));
    read = read_all(file.fd(), bytes) && good(bytes);
  }
  if (!read) {
    ::unlinkat(folder.fd(), name.c_str(), 0);
    return std::nullopt;
  }
  ::futimens(file.fd(), nullptr);  // used now
  return bytes;
}

}  // namespace

fs::path SceneCache::users_folder() {
  const char* const cache = std::getenv("XDG_CACHE_HOME");
  if (cache != nullptr && fs::path(cache).is_absolute()) return fs::path(cache) / "telenano" / "scenes";
  const char* const home = std::getenv("HOME");
  if (home != nullptr && fs::path(home).is_absolute())
    return fs::path(home) / ".cache" / "telenano" / "scenes";
  return {};
}

std::optional<std::string> SceneCache::read(const Sha256& hash, std::uint64_t bytes) const {
  return read_checked(folder_, name_of(hash), [&](const std::string& bundle) {
    return bundle.size() == bytes && sha256(bundle) == hash;
  });
}

std::optional<std::string> SceneCache::read_finding(const Sha256& hash, const std::string& program) const {
  const auto sealed = [](const std::string& file) {
    Sha256 seal{};
    if (file.size() < seal.size()) return false;
    std::memcpy(seal.data(), file.data(), seal.size());
    return sha256(std::string_view(file).substr(seal.size())) == seal;
  };
  auto file = read_checked(folder_, name_of(hash, program), sealed);
  if (file) file->erase(0, Sha256{}.size());
  return file;
}

std::string SceneCache::keep_finding(const Sha256& hash, const std::string& program,
                                     const std::string& finding) const {
  const Sha256 seal = sha256(finding);
  return write(name_of(hash, program), std::string(seal.begin(), seal.end()) + finding);
}

std::string SceneCache::keep(const Sha256& hash, const std::string& bundle) const {
  return write(name_of(hash), bundle);
}

std::string SceneCache::write(const std::string& name, const std::string& bytes) const {
  if (folder_.empty()) return "neither XDG_CACHE_HOME nor HOME is set: the scene is not kept";
  if (bytes.size() > bytes_max_) return complaint(folder_, "it is too large");
  std::error_code failed;
  fs::create_directories(folder_.parent_path(), failed);
  if (::mkdir(folder_.c_str(), 0700) != 0 && errno != EEXIST) return complaint(folder_, std::strerror(errno));
  std::string why;
  const File folder = open_folder(folder_, why);
  if (!folder.is_open()) return complaint(folder_, why);
  make_room(bytes.size());
  const std::string beside = "." + name + "." + std::to_string(::getpid());
  ::unlinkat(folder.fd(), beside.c_str(), 0);
  {
    const File file(
        ::openat(folder.fd(), beside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
    if (!file.is_open()) return complaint(folder_, std::strerror(errno));
    if (!write_all(file.fd(), bytes) || ::fsync(file.fd()) != 0) {
      const int error = errno;
      ::unlinkat(folder.fd(), beside.c_str(), 0);
      return complaint(folder_, std::strerror(error));
    }
  }
  if (::renameat(folder.fd(), beside.c_str(), folder.fd(), name.c_str()) != 0) {
    const int error = errno;
    ::unlinkat(folder.fd(), beside.c_str(), 0);
    return complaint(folder_, std::strerror(error));
  }
  return "";
}

void SceneCache::make_room(std::uint64_t for_bytes) const {
  struct Kept {
    fs::file_time_type used;
    std::uint64_t bytes;
    fs::path path;
  };
  std::vector<Kept> all;
  std::uint64_t sum = for_bytes;
  std::error_code failed;
  for (fs::directory_iterator entry(folder_, failed), end; !failed && entry != end; entry.increment(failed)) {
    std::error_code unknown;
    const fs::path& path = entry->path();
    if (!fs::is_regular_file(fs::symlink_status(path, unknown))) continue;
    const bool ours = path.extension() == kExtension;
    // What a killed program has left beside has the name of its process behind it.
    const bool left_over = path.filename().string().front() == '.' &&
                           path.filename().string().find(kExtension) != std::string::npos;
    if (!ours && !left_over) continue;
    const std::uint64_t bytes = fs::file_size(path, unknown);
    const auto used = fs::last_write_time(path, unknown);
    if (unknown) continue;
    all.push_back({used, bytes, path});
    sum += bytes;
  }
  std::sort(all.begin(), all.end(), [](const Kept& a, const Kept& b) { return a.used < b.used; });
  for (const Kept& oldest : all) {
    if (sum <= bytes_max_) return;
    if (fs::remove(oldest.path, failed)) sum -= oldest.bytes;
  }
}

}  // namespace telenano::scene_store

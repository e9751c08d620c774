#include "telenano/nve_server/app/serve/tip_latch.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <system_error>

#include "telenano/common/base/error.h"
#include "telenano/common/security/private_file.h"

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

const std::string kWhat = "the latch of the AFM's tip";
const std::string kBefore = "afm-", kAfter = ".out";

std::string file_name(const std::string& controller) {
  std::string name = controller;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == ':' || c == '/' || c == '[' || c == ']'; }, '_');
  return kBefore + name + kAfter;
}

/// afm-HOST_PORT.out -> afm-HOST_PORT.approved-ID
std::string approval_of(const std::string& latch, const std::string& id) {
  return latch.substr(0, latch.size() - kAfter.size()) + ".approved-" + id;
}

std::string read_id(const std::string& path) {
  std::string id = security::read_private_file(path, kWhat);
  id.erase(std::find(id.begin(), id.end(), '\n'), id.end());
  const bool good = !id.empty() && std::all_of(id.begin(), id.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
  });
  if (!good)
    throw UserError(path +
                    ": this is no latch of an AFM's tip: check whether the tip is up, then remove the file");
  return id;
}

std::string fresh_id() {
  constexpr char kDigits[] = "0123456789abcdef";
  std::random_device random;
  std::string id;
  for (int i = 0; i < 16; ++i) id += kDigits[random() % 16];
  return id;
}

/// A server that runs has it.
bool in_use(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return false;
  const bool locked = ::flock(fd, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  ::close(fd);
  return locked;
}

/// A name that was removed is gone also after a power failure.
void sync_folder(const std::string& path) {
  const int fd = ::open(fs::path(path).parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
}

}  // namespace

TipLatch::TipLatch(const std::string& folder, const std::string& controller) {
  std::error_code error;
  if (!fs::is_directory(folder)) {
    fs::create_directories(folder, error);
    if (error)
      throw UserError("--afm-state: cannot make the folder " + folder + ": " + error.message() +
                      "; it keeps whether the tip may be out");
  }
  path_ = (fs::absolute(folder) / file_name(controller)).string();
  const std::string same_host = file_name(controller.substr(0, controller.rfind(':') + 1));
  const std::string before = same_host.substr(0, same_host.size() - kAfter.size());
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string path = (fs::absolute(folder) / entry.path().filename()).string();
    const std::string name = entry.path().filename().string();
    if (name.rfind(before, 0) != 0 || !name.ends_with(kAfter) || (path != path_ && in_use(path))) continue;
    left_.push_back({path, read_id(path)});
    if (path != path_) others_.push_back(path);
  }
  if (error)
    throw UserError("--afm-state: cannot read the folder " + folder + ": " + error.message() +
                    "; it keeps whether the tip may be out");
  take_approval();  // given while no server ran
}

TipLatch::~TipLatch() {
  if (lock_ >= 0) ::close(lock_);
}

void TipLatch::set() {
  security::replace_private_file(path_, fresh_id() + "\n", kWhat);
  set_ = true;
  if (lock_ >= 0) ::close(lock_);
  lock_ = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
  if (lock_ >= 0) ::flock(lock_, LOCK_EX | LOCK_NB);
  for (const std::string& other : others_) ::unlink(other.c_str());
  others_.clear();
  left_.clear();
  sync_folder(path_);
}

bool TipLatch::take_approval() {
  if (left_.empty()) return false;
  // Who was approved is not asked for again, also where another one is not yet.
  std::erase_if(left_, [](const Left& left) {
    if (::unlink(approval_of(left.path, left.id).c_str()) != 0) return false;
    sync_folder(left.path);
    return true;
  });
  return left_.empty();
}

void TipLatch::clear() {
  if (!set_) return;
  set_ = false;
  ::unlink(path_.c_str());
  sync_folder(path_);
}

std::string state_folder(const std::string& flag) {
  if (!flag.empty()) return flag;
  const auto of = [](const char* variable) {
    const char* const text = std::getenv(variable);
    return std::string(text != nullptr ? text : "");
  };
  // Of several that systemd may name, the first.
  if (const std::string given = of("STATE_DIRECTORY"); !given.empty())
    return given.substr(0, given.find(':'));
  if (const std::string home = of("XDG_STATE_HOME"); !home.empty()) return home + "/telenano";
  if (const std::string home = of("HOME"); !home.empty()) return home + "/.local/state/telenano";
  throw UserError("--afm-state is missing: expected a folder, as neither STATE_DIRECTORY nor HOME is set");
}

namespace {

/// The approval must be the server's own file. So an administrator becomes the server's user for it; anybody
/// else is told to.
void become_owner(const std::string& latch) {
  struct stat info {};
  if (::stat(latch.c_str(), &info) != 0 || info.st_uid == ::geteuid()) return;
  if (::geteuid() == 0 && ::setegid(info.st_gid) == 0 && ::seteuid(info.st_uid) == 0) return;
  throw UserError(latch + " belongs to another user: run this as root, or as that user (uid " +
                  std::to_string(info.st_uid) + ")");
}

}  // namespace

std::string approve_tip(const std::string& folder, const std::string& controller) {
  std::vector<std::string> latches;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind(kBefore, 0) == 0 && name.size() > kBefore.size() + kAfter.size() &&
        name.compare(name.size() - kAfter.size(), kAfter.size(), kAfter) == 0)
      latches.push_back(entry.path().string());
  }
  if (error && error != std::errc::no_such_file_or_directory)
    throw UserError("--afm-state " + folder + ": " + error.message());
  if (!controller.empty()) {
    const std::string wanted = file_name(controller);
    std::erase_if(latches, [&](const std::string& path) { return fs::path(path).filename() != wanted; });
  }
  if (latches.empty())
    throw UserError("nothing to approve in " + folder + (controller.empty() ? "" : " for " + controller) +
                    ": no server runs there, and none ended without withdrawing the tip");
  if (latches.size() > 1)
    throw UserError("more than one AFM in " + folder +
                    ": name one with --controller HOST:PORT (its emergency port)");
  become_owner(latches.front());
  const std::string file = approval_of(latches.front(), read_id(latches.front()));
  security::replace_private_file(file, "\n", "the approval");
  return latches.front();
}

}  // namespace telenano::app

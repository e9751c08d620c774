#include "telenano/master/viewer/whole_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "telenano/common/base/error.h"

namespace telenano::viewer {
namespace {

[[noreturn]] void cannot_write(const std::string& path, const std::string& what, int error) {
  throw RunError(path + ": " + what + " cannot be written: " + std::strerror(error) +
                 "; check the folder, its permissions and its free space");
}

}  // namespace

void write_whole_file(const std::string& path, std::string_view bytes, const std::string& what) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (fd < 0) cannot_write(path, what, errno);
  int error = 0;
  while (error == 0 && !bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n > 0) bytes.remove_prefix(static_cast<std::size_t>(n));
    if (n <= 0 && errno != EINTR) error = n == 0 ? EIO : errno;
  }
  if (::close(fd) != 0 && error == 0) error = errno;
  if (error == 0) return;
  // Half a file would be taken for a whole one; a device stays.
  std::error_code ignored;
  if (std::filesystem::is_regular_file(path, ignored)) std::filesystem::remove(path, ignored);
  cannot_write(path, what, error);
}

}  // namespace telenano::viewer

#include "telenano/nve_server/app/sample/user_files.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

[[noreturn]] void cannot_write(const std::string& path) {
  throw RunError(path + ": cannot be written: " + std::strerror(errno));
}

}  // namespace

std::string read_user_file(const std::string& path, const char* what, std::size_t mib_most) {
  const std::string expected = std::string(", expected ") + what;
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found)
    throw UserError(path + ": there is no such file");
  if (status.type() == std::filesystem::file_type::directory)
    throw UserError(path + ": is a folder" + expected);
  if (status.type() != std::filesystem::file_type::regular)
    throw UserError(path + ": is not a regular file" + expected);
  const auto size = std::filesystem::file_size(path, error);
  if (!error && size > mib_most << 20)
    throw UserError(path + ": has " + std::to_string(size) + " bytes, expected at most " +
                    std::to_string(mib_most) + " MiB");
  std::ifstream file(path, std::ios::binary);
  if (error || !file) throw UserError(path + ": cannot be read: " + std::strerror(errno));
  std::string bytes(static_cast<std::size_t>(size), '\0');
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(file.gcount()));
  return bytes;
}

void write_text(const std::string& path, const std::string& text) {
  const std::string beside = path + ".part";
  std::FILE* file = std::fopen(beside.c_str(), "we");
  if (file == nullptr) cannot_write(path);
  bool good = std::fwrite(text.data(), 1, text.size(), file) == text.size() && std::fflush(file) == 0 &&
              ::fsync(::fileno(file)) == 0;
  good = std::fclose(file) == 0 && good;
  if (good && ::rename(beside.c_str(), path.c_str()) == 0) return;
  const int why = errno;
  ::unlink(beside.c_str());
  errno = why;
  cannot_write(path);
}

}  // namespace telenano::app

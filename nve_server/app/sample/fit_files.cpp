#include "telenano/nve_server/app/sample/fit_files.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <system_error>

#include "telenano/common/base/error.h"

namespace telenano::app {
namespace {

constexpr std::size_t kFileBytesMax = std::size_t{1} << 28;

[[noreturn]] void cannot_write(const std::string& path) {
  throw RunError(path + ": cannot be written: " + std::strerror(errno));
}

}  // namespace

std::string number_text(double value, int digits) {
  std::ostringstream text;
  text.precision(digits);
  text << value;
  return text.str();
}

std::string read_curve_bytes(const std::string& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found)
    throw UserError(path + ": there is no such file");
  if (status.type() != std::filesystem::file_type::regular)
    throw UserError(path + ": is no regular file, expected a force curve");
  const auto size = std::filesystem::file_size(path, error);
  if (!error && size > kFileBytesMax)
    throw UserError(path + ": has " + std::to_string(size) + " bytes, expected at most 256 MiB");
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

void check_target(const std::string& path, const char* flag, const FitOptions& options) {
  if (path.empty()) return;
  std::error_code error;
  if (std::filesystem::is_directory(path, error))
    throw UserError(path + ": is a folder: choose a file with " + flag);
  if (std::filesystem::exists(std::filesystem::symlink_status(path, error))) {
    if (!options.force)
      throw UserError(path + ": is there already: --force replaces it, or choose another with " + flag);
    for (const std::string& curve : options.curves)
      if (std::filesystem::equivalent(path, curve, error))
        throw UserError(path + ": is a curve to fit: choose another file with " + flag);
  }
}

}  // namespace telenano::app

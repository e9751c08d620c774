#include "telenano/master/app/start/file_faults.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace telenano::app {
namespace {

std::string trouble_with(int error) {
  switch (error) {
    case ENAMETOOLONG:
      return "A name in this path is too long: at most 255 characters between two slashes";
    case EACCES:
      return "You may not look into the folder of this file: choose another, or ask its owner";
    case ENOTDIR:
      return "What stands before the last slash is no folder";
    default:
      return std::string("This file cannot be looked at: ") + std::strerror(error);
  }
}

}  // namespace

std::string read_fault(const std::string& path) {
  struct stat about {};
  if (::stat(path.c_str(), &about) != 0)
    return errno == ENOENT ? "There is no such file: correct its name" : trouble_with(errno);
  if (S_ISDIR(about.st_mode)) return "This is a folder: name a file in it";
  if (!S_ISREG(about.st_mode)) return "This is no plain file";
  if (::access(path.c_str(), R_OK) != 0)
    return "You may not read this file: choose another, or ask its owner";
  return "";
}

std::string recording_fault(const std::string& path) {
  struct stat about {};
  if (::stat(path.c_str(), &about) == 0)
    return S_ISDIR(about.st_mode) ? "This is a folder: name a file in it, such as session.h5"
                                  : "This file exists already: choose another name";
  if (errno != ENOENT) return trouble_with(errno);
  std::string folder = std::filesystem::path(path).parent_path().string();
  if (folder.empty()) folder = ".";
  if (::stat(folder.c_str(), &about) != 0)
    return errno == ENOENT ? "There is no such folder: make it first, or choose another"
                           : trouble_with(errno);
  if (::access(folder.c_str(), W_OK | X_OK) == 0) return "";
  return errno == EROFS ? "This folder is on a medium that cannot be written: choose another"
                        : "You may not write into this folder: choose another, or ask its owner";
}

}  // namespace telenano::app

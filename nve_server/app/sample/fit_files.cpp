#include "telenano/nve_server/app/sample/fit_files.h"

#include <filesystem>
#include <sstream>
#include <system_error>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/app/sample/user_files.h"

namespace telenano::app {

std::string number_text(double value, int digits) {
  std::ostringstream text;
  text.precision(digits);
  text << value;
  return text.str();
}

std::string read_curve_bytes(const std::string& path) {
  return read_user_file(path, "a force curve", 256);
}

void check_target(const std::string& path, const char* flag, const FitOptions& options) {
  if (path.empty()) return;
  std::error_code error;
  if (std::filesystem::is_directory(path, error))
    throw UserError(path + ": is a folder: choose a file with " + flag);
  if (std::filesystem::exists(std::filesystem::symlink_status(path, error))) {
    if (!options.force)
      throw UserError(path + ": already exists: --force replaces it, or choose another with " + flag);
    for (const std::string& curve : options.curves)
      if (std::filesystem::equivalent(path, curve, error))
        throw UserError(path + ": is one of the curves to fit: choose another file with " + flag);
  }
}

}  // namespace telenano::app

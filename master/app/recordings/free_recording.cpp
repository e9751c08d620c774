#include "telenano/master/app/recordings/free_recording.h"

#include <filesystem>
#include <system_error>

namespace telenano::app {

std::string free_recording(const std::string& wanted) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (wanted.empty() || !fs::exists(wanted, error)) return wanted;
  const fs::path path(wanted);
  std::string stem = path.stem().string();
  const auto dash = stem.rfind('-');
  if (dash != std::string::npos && dash + 1 < stem.size() &&
      stem.find_first_not_of("0123456789", dash + 1) == std::string::npos)
    stem.resize(dash);
  for (int i = 2;; ++i) {
    const fs::path name = path.parent_path() / (stem + "-" + std::to_string(i) + path.extension().string());
    if (!fs::exists(name, error)) return name.string();
  }
}

}  // namespace telenano::app

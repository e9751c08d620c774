#include "telenano/common/config/shared_files.h"

#include <algorithm>
#include <cstdlib>
#include <system_error>

#include "telenano/common/base/error.h"

namespace telenano::config {
namespace fs = std::filesystem;

fs::path shared_folder() {
  if (const char* set = std::getenv("TELENANO_SHARE"); set != nullptr && *set != '\0') return set;
  std::error_code failed;
  const fs::path program = fs::read_symlink("/proc/self/exe", failed);
  if (failed) return "/usr/share/telenano";
  return program.parent_path().parent_path() / "share" / "telenano";
}

std::vector<std::string> shared_names(const std::string& folder, const std::string& extension) {
  std::vector<std::string> names;
  std::error_code failed;
  for (const auto& entry : fs::directory_iterator(shared_folder() / folder, failed)) {
    if (entry.path().extension() == extension) names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

std::string find_shared(const std::string& text, const std::string& folder, const std::string& extension) {
  std::error_code failed;
  if (text.empty() || text.find('/') != std::string::npos || fs::exists(text, failed)) return text;
  const fs::path shelf = shared_folder() / folder;
  for (const std::string& name : {text, text + extension}) {
    if (fs::is_regular_file(shelf / name, failed)) return (shelf / name).lexically_normal().string();
  }
  std::string known;
  for (const std::string& name : shared_names(folder, extension)) known += (known.empty() ? "" : ", ") + name;
  throw UserError("there is no file '" + text + "' here, and " + shelf.lexically_normal().string() +
                  (known.empty() ? " has none (set TELENANO_SHARE to their folder)" : " has only: " + known));
}

}  // namespace telenano::config

#include "telenano/master/app/start/recent_servers.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <utility>

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

// A line each: server, tab, key file, and where it is known a tab and the scene's name.
constexpr const char* kFile = "servers";
constexpr std::size_t kLongest = 1024;

bool fits_a_line(const std::string& text) {
  return text.size() < kLongest && text.find_first_of("\t\n") == std::string::npos;
}

}  // namespace

std::string RecentServers::users_folder() {
  // The XDG specification: a relative path is to be ignored.
  const char* const state = std::getenv("XDG_STATE_HOME");
  if (state != nullptr && fs::path(state).is_absolute()) return (fs::path(state) / "telenano").string();
  const char* const home = std::getenv("HOME");
  if (home != nullptr && fs::path(home).is_absolute())
    return (fs::path(home) / ".local/state/telenano").string();
  return "";
}

RecentServers::RecentServers(const std::string& folder) : folder_(folder) {
  if (folder_.empty()) return;
  std::ifstream file(fs::path(folder_) / kFile);
  for (std::string line; list_.size() < kMost && std::getline(file, line);) {
    const auto tab = line.find('\t');
    if (tab == 0 || tab == std::string::npos || line.size() > 3 * kLongest) continue;
    const auto second = line.find('\t', tab + 1);
    RecentServer one{line.substr(0, tab), line.substr(tab + 1, second - tab - 1)};
    if (second != std::string::npos) one.scene = line.substr(second + 1);
    list_.push_back(std::move(one));
  }
}

void RecentServers::note(RecentServer server) {
  if (server.server.empty() || !fits_a_line(server.server) || !fits_a_line(server.key)) return;
  if (!fits_a_line(server.scene)) server.scene.clear();
  std::erase_if(list_, [&](const RecentServer& one) { return one.server == server.server; });
  list_.insert(list_.begin(), std::move(server));
  if (list_.size() > kMost) list_.resize(kMost);
  write();
}

void RecentServers::write() const {
  if (folder_.empty()) return;
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) return;
  // Whole or not at all: another window may read it.
  const fs::path file = fs::path(folder_) / kFile;
  const fs::path fresh = file.string() + ".new";
  {
    std::ofstream text(fresh, std::ios::trunc);
    for (const RecentServer& one : list_)
      text << one.server << '\t' << one.key << (one.scene.empty() ? "" : "\t") << one.scene << '\n';
    text.close();
    if (!text) return;
  }
  fs::rename(fresh, file, error);
}

}  // namespace telenano::app

#include "telenano/master/app/start/recent_servers.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

// A line each: server, tab, key file.
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
    if (tab == 0 || tab == std::string::npos || line.size() > 2 * kLongest) continue;
    list_.push_back({line.substr(0, tab), line.substr(tab + 1)});
  }
}

void RecentServers::note(const RecentServer& server) {
  if (server.server.empty() || !fits_a_line(server.server) || !fits_a_line(server.key)) return;
  std::erase_if(list_, [&](const RecentServer& one) { return one.server == server.server; });
  list_.insert(list_.begin(), server);
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
    for (const RecentServer& one : list_) text << one.server << '\t' << one.key << '\n';
    text.close();
    if (!text) return;
  }
  fs::rename(fresh, file, error);
}

}  // namespace telenano::app

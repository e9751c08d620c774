#include "telenano/master/app/start/recent_servers.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

// A line each: server, key file, scene's name, identity's file, server's key, with tabs between; what is empty at
// its end is left out, but for the tab behind the server.
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
    if (tab == 0 || tab == std::string::npos || line.size() > 5 * kLongest) continue;
    RecentServer one{line.substr(0, tab), ""};
    std::istringstream rest(line.substr(tab + 1));
    for (std::string* const field : {&one.key, &one.scene, &one.identity, &one.server_key})
      std::getline(rest, *field, '\t');
    list_.push_back(std::move(one));
  }
}

void RecentServers::note(RecentServer server) {
  if (server.server.empty() || !fits_a_line(server.server) || !fits_a_line(server.key) ||
      !fits_a_line(server.identity) || !fits_a_line(server.server_key))
    return;
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
    for (const RecentServer& one : list_) {
      std::string line =
          one.server + '\t' + one.key + '\t' + one.scene + '\t' + one.identity + '\t' + one.server_key;
      while (line.back() == '\t') line.pop_back();
      if (line.size() == one.server.size()) line += '\t';
      text << line << '\n';
    }
    text.close();
    if (!text) return;
  }
  fs::rename(fresh, file, error);
}

}  // namespace telenano::app

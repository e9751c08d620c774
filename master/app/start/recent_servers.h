#pragma once

#include <string>
#include <vector>

namespace telenano::app {

/// A server that has answered, the keys it was asked with, and the scene it had then.
struct RecentServer {
  std::string server;
  std::string key;
  std::string scene{};       ///< empty: not known
  std::string identity{};    ///< file of the station's own key pair, and
  std::string server_key{};  ///< what the server showed then
};

/// Servers that have answered lately, newest first, kept for the start screen in one small file.
class RecentServers {
 public:
  static constexpr std::size_t kMost = 6;

  /// $XDG_STATE_HOME/telenano, else ~/.local/state/telenano; empty where neither is an absolute path.
  static std::string users_folder();

  /// Empty folder: nothing is kept. A file that cannot be read is an empty list.
  explicit RecentServers(const std::string& folder);

  const std::vector<RecentServer>& list() const noexcept { return list_; }
  /// To the front. What cannot be written is forgotten with the program: it is worth no error.
  void note(RecentServer server);

 private:
  void write() const;

  std::string folder_;
  std::vector<RecentServer> list_;
};

}  // namespace telenano::app

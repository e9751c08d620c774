#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "telenano/common/security/dtls_server.h"

namespace telenano::app {

/// Looks once a second, from a thread of its own, whether the list of keys has changed or one of them has
/// expired (by the machine's calendar), and gives the server what is in force: a key that is revoked or
/// expires ends its sessions while the server runs. A list that cannot be read changes
/// nothing; `warn` is told, once, as of each key's end and seven days before it.
class KeyWatcher {
 public:
  KeyWatcher(std::string path, std::vector<security::DtlsServer*> servers,
             std::function<void(const std::string&)> warn, std::function<void(const std::string&)> inform);
  ~KeyWatcher();
  KeyWatcher(const KeyWatcher&) = delete;
  KeyWatcher& operator=(const KeyWatcher&) = delete;

  /// Reads the list now, changed or not, and says so. From any thread.
  void reload();

 private:
  void run();
  void read(bool say);
  void warn_of_ends(const security::KeyList& list, std::int64_t now_s);

  std::string path_;
  std::vector<security::DtlsServer*> servers_;
  std::function<void(const std::string&)> warn_;
  std::function<void(const std::string&)> inform_;
  std::string seen_;  // what tells one state of the file from another
  std::optional<std::int64_t> next_expiry_s_;
  std::set<std::tuple<std::string, std::int64_t, bool>> told_;  // name, end, whether it was over
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app

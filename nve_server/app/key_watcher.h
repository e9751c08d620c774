#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/security/dtls_server.h"

namespace telenano::app {

/// Looks once a second, from a thread of its own, whether the list of keys has changed, and gives the server
/// the new one (each of its workers): a revoked key ends its sessions while the server runs. A list that
/// cannot be read changes nothing; `warn` is told, once.
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

  std::string path_;
  std::vector<security::DtlsServer*> servers_;
  std::function<void(const std::string&)> warn_;
  std::function<void(const std::string&)> inform_;
  std::string seen_;  // what tells one state of the file from another
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app

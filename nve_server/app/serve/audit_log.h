#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "telenano/common/rt/clock.h"
#include "telenano/common/security/grant_names.h"
#include "telenano/nve_server/server/audit.h"

namespace telenano::app {

/// What is said once, when the server has begun.
struct AuditStart {
  std::string scene;
  std::string address;
  bool encrypted = false;
  bool shared_tip = false;
};

/// Writes what the loops leave in their queues to a file: JSON lines (RFC 8259, one object a line), one event
/// a line, each with time (UTC), event and, where there is one, session, key, rights and address. No secret
/// is ever in it. Written within 100 ms, from a thread of its own, and synchronised with the disk; a file
/// that cannot be written is told once, and how many events are missing is written as soon as it can be
/// again. The file is only appended to, and opened anew by reopen(), so that logrotate may move it away.
class AuditLog {
 public:
  /// `key_list` and `grant_names`: to call keys and local users by their names; empty: there are none. The queues
  /// must outlive this. Throws UserError, one line, where the file cannot be opened.
  AuditLog(std::string path, std::vector<server::AuditQueue*> queues, std::string key_list,
           std::shared_ptr<const security::GrantNames> grant_names, const rt::Clock& clock,
           std::function<void(const std::string&)> warn);
  /// Writes what is left, and that the server stopped.
  ~AuditLog();
  AuditLog(const AuditLog&) = delete;
  AuditLog& operator=(const AuditLog&) = delete;

  void start(const AuditStart& start);
  /// From any thread.
  void reopen();

 private:
  void run();
  void open();
  void drain();
  void write(const std::string& lines);
  std::string line_of(const server::AuditEvent& event);
  std::string name_of(std::uint64_t identity);
  void read_names();

  std::string path_;
  std::vector<server::AuditQueue*> queues_;
  std::string key_list_;
  std::shared_ptr<const security::GrantNames> grant_names_;
  const rt::Clock& clock_;
  std::function<void(const std::string&)> warn_;
  std::map<std::uint64_t, std::string> names_;  // of identities
  std::uint64_t lost_ = 0;                      // already written down
  std::uint64_t unwritten_ = 0;                 // events that the file would not take
  bool warned_ = false;
  int file_ = -1;
  std::mutex mutex_;  // of all above, after the construction
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace telenano::app

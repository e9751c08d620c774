#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "telenano/nve_server/server/checkpoint.h"
#include "telenano/nve_server/server/server.h"
#include "telenano/nve_server/server/worker_mail.h"

namespace telenano::app {

/// Keeps checkpoints of sessions in a folder, so that a server that comes after this one, or another one that
/// shares the folder, takes them up. At most one server has a session:
///
///   FOLDER/XX/HASH.HOLDER   a session; HASH of its token, XX its first two digits; HOLDER: who has it, 0: nobody
///   FOLDER/HOLDER.lock      locked (flock) as long as that server lives; the kernel ends that with its process
///   FOLDER/XX/HASH.ended    nobody may have it any more, whatever copy of it comes back
///
/// Taking up is one rename to the own name, which one of several takers does. It is allowed where nobody has
/// the session, or the holder's lock can be had: then that server is dead. A holder writes beside its file and
/// exchanges the two, which fails where the file is gone: then another server has the session, and this one
/// lets it go. What is older than a silent session may become is not taken up, so that an old copy is worth
/// nothing; of several the newest is taken, and the others go.
///
/// The loops hand over bytes (server::CheckpointQueue) and ask by mail; files are touched by a thread of this
/// object alone. Nothing is brought to the disk by force: a server that is killed leaves whole files, a machine
/// that loses its power may not. A file that is not whole is said in a line and left alone.
class CheckpointKeeper {
 public:
  struct Config {
    std::string folder;
    server::CheckpointOf of;
    std::function<std::unique_ptr<slave::Slave>()> make_slave;
    std::int64_t resume_ms = 30'000;  ///< as old as one may be; files that nobody can take up are removed
    std::function<void(const std::string&)> warn;
    std::function<void(const std::string&)> info;
    /// Set: this server takes no session up any more, only gives its own away; null: it always does.
    const std::atomic<bool>* drain = nullptr;
  };

  /// Throws UserError, one line: not a folder, or not this user's alone.
  static void require_folder(const std::string& folder);

  /// Of a slave of the scene; UserError where it gives no state away.
  CheckpointKeeper(Config config, server::WorkerMail& mail);
  /// After the loops: what they said last is written. Then the lock goes.
  ~CheckpointKeeper();
  CheckpointKeeper(const CheckpointKeeper&) = delete;
  CheckpointKeeper& operator=(const CheckpointKeeper&) = delete;

  /// One a worker, in their order; before start().
  server::CheckpointQueue& add_queue();
  void start();

 private:
  struct Held {
    std::uint64_t number = 0;
    bool written = false;
    bool lost = false;  ///< to another server: what is still said of it is not written
  };
  struct Found {
    std::filesystem::path path;
    std::string holder;
  };
  void run();
  void on_note(server::CheckpointQueue& queue, const server::CheckpointNote& note);
  void answer_some();
  void answer(const server::HandoffMessage& question);
  void tell_taken_up(bool now);
  void wait_beyond(std::uint32_t seen);
  std::vector<Found> files_of(const std::string& hash) const;
  std::unique_ptr<server::SessionState> take_up(std::uint64_t token, std::uint64_t owner);
  bool write(const server::CheckpointNote& note, std::span<const std::uint8_t> payload, Held& held);
  void lost(const server::CheckpointNote& note);
  void let_go(std::uint64_t token);
  void end(std::uint64_t token);
  void clean();
  std::filesystem::path file_of(const std::string& hash, const std::string& suffix) const;
  bool lock_of_dead(const std::string& holder, int& fd) const;
  void warn_once(const std::string& key, const std::string& text);

  Config config_;
  server::WorkerMail& mail_;
  std::size_t bytes_;
  std::string self_;
  int lock_ = -1;
  std::vector<std::unique_ptr<server::CheckpointQueue>> queues_;
  std::map<std::uint64_t, Held> held_;  // by token
  std::set<std::string> warned_;
  std::uint64_t cleaned_ms_ = 0;
  std::optional<server::HandoffMessage> waiting_;  // a question
  // Not told yet, and when the last line of it was.
  std::size_t taken_up_ = 0;
  std::int64_t oldest_ms_ = 0;
  std::chrono::steady_clock::time_point told_at_{};
  std::atomic<bool> done_{false};
  std::thread thread_;
};

}  // namespace telenano::app

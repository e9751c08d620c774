#include "telenano/nve_server/app/key_watcher.h"

#include <sys/stat.h>

#include <chrono>
#include <exception>
#include <utility>

#include "telenano/common/security/key_list.h"

namespace telenano::app {
namespace {

constexpr std::chrono::seconds kPeriod{1};

std::string state_of(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return "gone";
  return std::to_string(info.st_ino) + " " + std::to_string(info.st_size) + " " +
         std::to_string(info.st_mode) + " " + std::to_string(info.st_mtim.tv_sec) + "." +
         std::to_string(info.st_mtim.tv_nsec);
}

}  // namespace

KeyWatcher::KeyWatcher(std::string path, std::vector<security::DtlsServer*> servers,
                       std::function<void(const std::string&)> warn,
                       std::function<void(const std::string&)> inform)
    : path_(std::move(path)),
      servers_(std::move(servers)),
      warn_(std::move(warn)),
      inform_(std::move(inform)),
      thread_([this] { run(); }) {}

KeyWatcher::~KeyWatcher() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void KeyWatcher::reload() {
  const std::lock_guard lock(mutex_);
  seen_ = state_of(path_);
  read(true);
}

void KeyWatcher::read(bool say) {
  try {
    const security::KeyList list = security::load_key_list(path_);
    const std::size_t entries = list.keys.size() + list.certificates.size();
    for (security::DtlsServer* const server : servers_) server->offer_keys(list);
    if (say) inform_("keys read again: " + std::to_string(entries) + " entries");
  } catch (const std::exception& error) {
    warn_(std::string(error.what()) + "; the keys known so far stay valid");
  }
}

void KeyWatcher::run() {
  std::unique_lock lock(mutex_);
  do {
    // The first look gives the list once more: it may have changed since the server was made.
    std::string state = state_of(path_);
    if (state == seen_) continue;
    const bool first = seen_.empty();
    seen_ = std::move(state);
    read(!first);
  } while (!wake_.wait_for(lock, kPeriod, [this] { return done_; }));
}

}  // namespace telenano::app

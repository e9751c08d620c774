#include "telenano/nve_server/app/serve/key_watcher.h"

#include <sys/stat.h>

#include <chrono>
#include <exception>
#include <utility>

#include "telenano/common/base/utc_time.h"
#include "telenano/common/security/key_list.h"

namespace telenano::app {
namespace {

constexpr std::chrono::seconds kWatchPeriod{1};

std::string state_of(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return "gone";
  return std::to_string(info.st_ino) + " " + std::to_string(info.st_size) + " " +
         std::to_string(info.st_mode) + " " + std::to_string(info.st_mtim.tv_sec) + "." +
         std::to_string(info.st_mtim.tv_nsec);
}

constexpr std::int64_t kWarnBefore_s = 7 * 86400;

std::int64_t unix_now_s() {
  using std::chrono::seconds;
  return std::chrono::floor<seconds>(std::chrono::system_clock::now()).time_since_epoch().count();
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
    const security::KeyList all = security::load_key_list(path_);
    const std::int64_t now_s = unix_now_s();
    const security::KeyList list = all.in_force(now_s);
    next_expiry_s_ = all.next_expiry_s(now_s);
    warn_of_ends(all, now_s);
    const std::size_t entries = list.keys.size() + list.certificates.size() + list.public_keys.size();
    for (security::DtlsServer* const server : servers_) server->offer_keys(list);
    if (say) inform_("keys read again: " + std::to_string(entries) + " entries");
  } catch (const std::exception& error) {
    warn_(std::string(error.what()) + "; the keys known so far stay valid");
  }
}

/// Once for each end: of what has expired since the last look, and of what will within kWarnBefore_s.
void KeyWatcher::warn_of_ends(const security::KeyList& list, std::int64_t now_s) {
  const auto look = [&](const std::string& name, std::optional<std::int64_t> expires_s,
                        const char* follows = "rotate makes the key that replaces it") {
    if (!expires_s || *expires_s - now_s > kWarnBefore_s) return;
    const bool over = *expires_s <= now_s;
    if (!told_.insert({name, *expires_s, over}).second) return;
    warn_("'" + name + "' " + (over ? "has expired: it opens no sessions since " : "expires at ") +
          utc_text(*expires_s) + "; telenano-nve keys " + follows);
  };
  for (const security::KeyEntry& key : list.keys) look(key.identity, key.expires_s);
  for (const security::PublicKeyEntry& entry : list.public_keys)
    look(entry.identity, entry.expires_s, "keys add with --overlap-days adds the station's next public key");
  for (const security::CertificateEntry& entry : list.certificates)
    look(entry.name.empty() ? entry.fingerprint : entry.name, entry.expires_s);
}

void KeyWatcher::run() {
  std::unique_lock lock(mutex_);
  do {
    // The first look gives the list once more: it may have changed since the server was made.
    std::string state = state_of(path_);
    const bool expired = next_expiry_s_ && unix_now_s() >= *next_expiry_s_;
    if (state == seen_ && !expired) continue;
    const bool first = seen_.empty();
    seen_ = std::move(state);
    read(!first && !expired);
  } while (!wake_.wait_for(lock, kWatchPeriod, [this] { return done_; }));
}

}  // namespace telenano::app

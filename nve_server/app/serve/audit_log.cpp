#include "telenano/nve_server/app/serve/audit_log.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/base/version.h"
#include "telenano/common/link/fault_names.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/signals_blocked.h"
#include "telenano/common/security/key_list.h"

namespace telenano::app {
namespace {

using Kind = server::AuditEvent::Kind;
// Members in the order in which they are given: a person reads the file, too.
using Json = nlohmann::ordered_json;

constexpr std::chrono::milliseconds kPeriod{100};

const char* name_of_kind(Kind kind) noexcept {
  switch (kind) {
    case Kind::kOpened:
      return "session opened";
    case Kind::kResumed:
      return "session resumed";
    case Kind::kMoved:
      return "session moved";
    case Kind::kRefused:
      return "session refused";
    case Kind::kEnded:
      return "session ended";
    case Kind::kTimedOut:
      return "session silent";
    case Kind::kForgotten:
      return "session forgotten";
    case Kind::kTipTaken:
      return "tip taken";
    case Kind::kTipLeft:
      return "tip left";
    case Kind::kSwitched:
      return "scene switched";
    case Kind::kFault:
      return "fault";
  }
  return "unknown";
}

const char* refusal_name(std::uint32_t reason) noexcept {
  switch (static_cast<link::RefuseReason>(reason)) {
    case link::RefuseReason::kVersion:
      return "protocol version";
    case link::RefuseReason::kFull:
      return "no room";
    case link::RefuseReason::kRate:
      return "rate";
    case link::RefuseReason::kShuttingDown:
      return "server stops";
    case link::RefuseReason::kScene:
      return "no such scene";
  }
  return "unknown";
}

const char* end_name(std::uint32_t reason) noexcept {
  switch (static_cast<link::ByeReason>(reason)) {
    case link::ByeReason::kDone:
      return "done";
    case link::ByeReason::kIdle:
      return "idle";
    case link::ByeReason::kShuttingDown:
      return "server stops";
    case link::ByeReason::kStopped:
      return "stopped";
    case link::ByeReason::kUnknownSession:
      return "unknown session";
  }
  return "unknown";
}

/// "2026-11-22T21:05:03.125Z", RFC 3339.
std::string time_text(std::chrono::system_clock::time_point at) {
  const auto since = std::chrono::duration_cast<std::chrono::milliseconds>(at.time_since_epoch()).count();
  const time_t seconds = static_cast<time_t>(since / 1000);
  tm parts{};
  ::gmtime_r(&seconds, &parts);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z", parts.tm_year + 1900, parts.tm_mon + 1,
                     parts.tm_mday, parts.tm_hour, parts.tm_min, parts.tm_sec, since % 1000);
}

std::string line_now(Json rest, const char* event) {
  Json line{{"time", time_text(std::chrono::system_clock::now())}, {"event", event}};
  line.update(rest);
  return line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace

AuditLog::AuditLog(std::string path, std::vector<server::AuditQueue*> queues, std::string key_list,
                   std::shared_ptr<const security::GrantNames> grant_names, const rt::Clock& clock,
                   std::function<void(const std::string&)> warn)
    : path_(std::move(path)),
      queues_(std::move(queues)),
      key_list_(std::move(key_list)),
      grant_names_(std::move(grant_names)),
      clock_(clock),
      warn_(std::move(warn)) {
  open();
  if (file_ < 0)
    throw UserError(
        fmt::format("--audit {}: {}; give a file that can be appended to", path_, std::strerror(errno)));
  const rt::SignalsBlocked blocked;
  thread_ = std::thread([this] { run(); });
}

AuditLog::~AuditLog() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  thread_.join();
  drain();
  write(line_now(Json::object(), "server stopped"));
  if (file_ >= 0) ::close(file_);
}

void AuditLog::start(const AuditStart& start) {
  const std::lock_guard lock(mutex_);
  write(line_now({{"version", kVersion},
                  {"scene", start.scene},
                  {"listen", start.address},
                  {"encrypted", start.encrypted},
                  {"shared_tip", start.shared_tip}},
                 "server started"));
}

void AuditLog::reopen() {
  const std::lock_guard lock(mutex_);
  drain();
  const int old = std::exchange(file_, -1);
  open();
  if (file_ < 0) {
    warn_(fmt::format("--audit {}: {}; going on with the file as it was", path_, std::strerror(errno)));
    file_ = old;
  } else if (old >= 0) {
    ::close(old);
  }
}

void AuditLog::open() {
  // A pipe that nobody reads must not hold the server up. Who reads the file learns who uses the instrument,
  // and when: not everybody.
  file_ = ::open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NONBLOCK,
                 S_IRUSR | S_IWUSR | S_IRGRP);
}

void AuditLog::run() {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, kPeriod, [this] { return done_; })) drain();
}

void AuditLog::drain() {
  std::vector<server::AuditEvent> events;
  server::AuditEvent event;
  std::uint64_t lost = 0;
  for (server::AuditQueue* const queue : queues_) {
    while (queue->pop(event)) events.push_back(event);
    lost += queue->dropped();
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const auto& a, const auto& b) { return a.at_ns < b.at_ns; });
  std::string lines;
  for (const server::AuditEvent& e : events) lines += line_of(e);
  if (lost > lost_) lines += line_now({{"count", lost - lost_}}, "events lost");
  lost_ = lost;
  if (lines.empty()) return;
  if (unwritten_ > 0) lines = line_now({{"count", unwritten_}}, "events not written") + lines;
  unwritten_ += events.size();  // until they are
  write(lines);
}

/// Whole lines: what a full disk took only a part of is taken back.
void AuditLog::write(const std::string& lines) {
  if (file_ < 0) return;
  struct stat before {};
  const bool known = ::fstat(file_, &before) == 0;
  const ssize_t n = ::write(file_, lines.data(), lines.size());
  if (n == static_cast<ssize_t>(lines.size())) {
    ::fdatasync(file_);
    unwritten_ = 0;
    warned_ = false;
    return;
  }
  const std::string why = n < 0 ? std::strerror(errno) : "no space left";
  // Whether that succeeds is all the same: a half line is no object, and a reader passes over it.
  if (n > 0 && known && S_ISREG(before.st_mode)) static_cast<void>(::ftruncate(file_, before.st_size) == 0);
  if (!std::exchange(warned_, true))
    warn_(fmt::format("--audit {}: {}; serving without, events are counted until it can be written again",
                      path_, why));
}

std::string AuditLog::line_of(const server::AuditEvent& event) {
  const std::int64_t ago_ns = clock_.now_ns() - event.at_ns;
  Json line{{"time", time_text(std::chrono::system_clock::now() - std::chrono::nanoseconds(ago_ns))},
            {"event", name_of_kind(event.kind)}};
  if (event.session != 0) line["session"] = event.session;
  if (event.identity != 0) line["key"] = name_of(event.identity);
  line["rights"] = std::string(net::name(event.rights));
  line["address"] = net::to_string(event.address);
  if (event.kind == Kind::kRefused) line["reason"] = refusal_name(event.reason);
  if (event.kind == Kind::kEnded) line["reason"] = end_name(event.reason);
  if (event.kind == Kind::kFault) {
    Json faults = Json::array();
    for (std::size_t bit = 0; bit < link::kFaultNames.size(); ++bit)
      if ((event.faults >> bit & 1u) != 0) faults.push_back(link::kFaultNames[bit]);
    line["faults"] = faults;
  }
  // A certificate's name may hold anything.
  return line.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

/// A key that has come since the list was read is looked up anew; one that has gone keeps its name.
std::string AuditLog::name_of(std::uint64_t identity) {
  auto found = names_.find(identity);
  if (found == names_.end()) {
    read_names();
    found = names_.find(identity);
  }
  if (found != names_.end()) return found->second;
  const std::string granted = grant_names_ ? grant_names_->name_of(identity) : "";
  if (granted.empty()) return fmt::format("unknown {:016x}", identity);
  names_[identity] = granted;
  return granted;
}

void AuditLog::read_names() {
  if (key_list_.empty()) return;
  try {
    const security::KeyList list = security::load_key_list(key_list_);
    for (const security::KeyEntry& key : list.keys)
      names_[security::identity_number('k', key.identity)] = key.identity;
    for (const security::PublicKeyEntry& entry : list.public_keys)
      names_[security::identity_number('p', entry.identity)] = entry.identity;
    for (const security::CertificateEntry& entry : list.certificates) {
      const std::string& name = entry.name.empty() ? entry.fingerprint : entry.name;
      names_[security::identity_number('c', name)] = name;
    }
  } catch (const std::exception&) {  // whoever watches the list tells of it
  }
}

}  // namespace telenano::app

#include "telenano/nve_server/app/serve/checkpoint_keeper.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/link/siphash.h"

namespace telenano::app {
namespace {

namespace fs = std::filesystem;

// Public: a token has 64 random bits, and the folder is this user's alone.
constexpr link::SipKey kNameKey{0x746b6e616d65736f, 0x6e616e6f74656c65};
const std::string kNobody = "0000000000000000";
constexpr std::uint64_t kCleanEveryMs = 60'000;
constexpr std::size_t kHashDigits = 16;
constexpr std::chrono::seconds kTellEvery{1};

std::string digits(std::uint64_t number) {
  char text[kHashDigits + 1];
  std::snprintf(text, sizeof text, "%016" PRIx64, number);
  return text;
}

std::string hash_of(std::uint64_t token) {
  return digits(link::siphash_words(kNameKey, {&token, 1}));
}

bool is_holder(const std::string& text) {
  return text.size() == kHashDigits && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

std::uint64_t now_ms() {
  using namespace std::chrono;
  return static_cast<std::uint64_t>(
      duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count());
}

/// Plain files of this user only, and never longer than `most`: empty where there is none.
std::vector<std::uint8_t> read_file(const fs::path& path, std::size_t most) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0) return {};
  struct stat about {};
  std::vector<std::uint8_t> bytes;
  if (::fstat(fd, &about) == 0 && S_ISREG(about.st_mode) && about.st_uid == ::geteuid() &&
      static_cast<std::uint64_t>(about.st_size) <= most) {
    bytes.resize(static_cast<std::size_t>(about.st_size));
    std::size_t have = 0;
    while (have < bytes.size()) {
      const ssize_t n = ::read(fd, bytes.data() + have, bytes.size() - have);
      if (n <= 0) break;
      have += static_cast<std::size_t>(n);
    }
    bytes.resize(have);
  }
  ::close(fd);
  return bytes;
}

bool write_all(int fd, std::span<iovec> parts) {
  while (!parts.empty()) {
    const ssize_t n = ::writev(fd, parts.data(), static_cast<int>(parts.size()));
    if (n <= 0) return false;
    auto left = static_cast<std::size_t>(n);
    while (!parts.empty() && left >= parts[0].iov_len) {
      left -= parts[0].iov_len;
      parts = parts.subspan(1);
    }
    if (parts.empty()) break;
    parts[0].iov_base = static_cast<std::uint8_t*>(parts[0].iov_base) + left;
    parts[0].iov_len -= left;
  }
  return true;
}

/// A new file. Its folder is made where there is none yet: asked for each time, it would cost a call a state.
int open_new(const fs::path& path) {
  constexpr int kFlags = O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW;
  const int fd = ::open(path.c_str(), kFlags, 0600);
  if (fd >= 0 || errno != ENOENT) return fd;
  ::mkdir(path.parent_path().c_str(), 0700);
  return ::open(path.c_str(), kFlags, 0600);
}

}  // namespace

void CheckpointKeeper::require_folder(const std::string& folder) {
  struct stat about {};
  if (::stat(folder.c_str(), &about) != 0 || !S_ISDIR(about.st_mode))
    throw UserError("--checkpoint " + folder + ": is not a folder");
  if (about.st_uid != ::geteuid() || (about.st_mode & 077) != 0)
    throw UserError(
        "--checkpoint " + folder +
        ": only this user may have access to it, because its contents can resume sessions: chmod 700 " +
        folder);
  if (::access(folder.c_str(), W_OK | X_OK) != 0)
    throw UserError("--checkpoint " + folder + ": cannot be written to");
}

CheckpointKeeper::CheckpointKeeper(Config config, server::WorkerMail& mail)
    : config_(std::move(config)), mail_(mail) {
  require_folder(config_.folder);
  const auto slave = config_.make_slave();
  if (config_.of.physics == 0 || !slave || slave->state_hash() == 0)
    throw UserError("--checkpoint: this slave cannot save its state; omit --checkpoint");
  bytes_ = server::kCheckpointBytes + slave->snapshot_bytes_max();
  std::random_device device;
  self_ = digits((std::uint64_t{device()} << 32) | device() | 1);
  // Locked before it has its name: who finds it unlocked may believe its server dead.
  const fs::path lock = fs::path(config_.folder) / (self_ + ".lock");
  const fs::path beside = lock.string() + ".part";
  lock_ = ::open(beside.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (lock_ < 0 || ::flock(lock_, LOCK_EX | LOCK_NB) != 0 || ::rename(beside.c_str(), lock.c_str()) != 0) {
    const int error = errno;
    if (lock_ >= 0) ::close(lock_);
    throw UserError("--checkpoint " + lock.string() + ": cannot be locked: " + std::strerror(error));
  }
}

CheckpointKeeper::~CheckpointKeeper() {
  if (thread_.joinable()) {
    done_ = true;
    mail_.bell().ring();
    thread_.join();
  }
  // What is still held is anybody's from now on.
  ::unlink((fs::path(config_.folder) / (self_ + ".lock")).c_str());
  ::close(lock_);
}

server::CheckpointQueue& CheckpointKeeper::add_queue() {
  queues_.push_back(std::make_unique<server::CheckpointQueue>(bytes_, mail_.bell()));
  return *queues_.back();
}

void CheckpointKeeper::start() {
  thread_ = std::thread([this] { run(); });
}

fs::path CheckpointKeeper::file_of(const std::string& hash, const std::string& suffix) const {
  return fs::path(config_.folder) / hash.substr(0, 2) / (hash + "." + suffix);
}

void CheckpointKeeper::warn_once(const std::string& key, const std::string& text) {
  constexpr std::size_t kMost = 1000;
  if (warned_.size() >= kMost) warned_.clear();
  if (warned_.insert(key).second) config_.warn("checkpoints: " + text);
}

void CheckpointKeeper::run() {
  try {
    clean();
  } catch (const std::exception& error) {
    config_.warn(std::string("checkpoints: ") + error.what());
  }
  for (;;) {
    const std::uint32_t seen = mail_.bell().rings();
    const bool last = done_.load(std::memory_order_acquire);
    for (const auto& queue : queues_) {
      server::CheckpointNote note;
      while (queue->fetch(note)) {
        on_note(*queue, note);
        queue->done(note);
        answer_some();
      }
    }
    answer_some();
    tell_taken_up(last);
    if (last) return;
    try {
      if (now_ms() - cleaned_ms_ >= kCleanEveryMs) clean();
    } catch (const std::exception& error) {
      warn_once("clean", error.what());
    }
    wait_beyond(seen);
  }
}

/// A question waits for no states of others, but for every note by which its worker, or one that it has heard of,
/// let a session go: that may be the one that is asked for. A few at a time, so that states are written too.
void CheckpointKeeper::answer_some() {
  constexpr int kAtOnce = 8;
  for (int i = 0; i < kAtOnce; ++i) {
    server::HandoffMessage question;
    if (!waiting_ && mail_.fetch(mail_.workers(), question)) waiting_ = question;
    if (!waiting_ || std::any_of(queues_.begin(), queues_.end(), [](const auto& q) { return q->lets_go(); }))
      return;
    answer(*waiting_);
    waiting_.reset();
  }
  mail_.bell().ring();  // there may be more
}

/// The first is told at once, of those that follow close behind a line a second.
void CheckpointKeeper::tell_taken_up(bool now) {
  if (taken_up_ == 0 || (!now && std::chrono::steady_clock::now() - told_at_ < kTellEvery)) return;
  told_at_ = std::chrono::steady_clock::now();
  const std::string age = std::to_string(oldest_ms_) + " ms old";
  config_.info(taken_up_ == 1
                   ? "took up a session of another server, " + age
                   : "took up " + std::to_string(taken_up_) + " sessions of another server, at most " + age);
  taken_up_ = 0;
  oldest_ms_ = 0;
}

void CheckpointKeeper::wait_beyond(std::uint32_t seen) {
  // A bell cannot be waited for with a limit; a line is due soon.
  while (taken_up_ != 0 && mail_.bell().rings() == seen &&
         std::chrono::steady_clock::now() - told_at_ < kTellEvery)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  if (taken_up_ == 0) mail_.bell().wait_beyond(seen);
}

void CheckpointKeeper::on_note(server::CheckpointQueue& queue, const server::CheckpointNote& note) {
  using Kind = server::CheckpointNote::Kind;
  const bool has_bytes = note.kind == Kind::kState || note.kind == Kind::kHandOut;
  try {
    Held& held = held_[note.token];
    // Of a session that has gone from one worker to another, the queues may be read in the other order.
    const bool newest = note.number > held.number;
    if (newest) held.number = note.number;
    if (has_bytes && newest && !held.lost) {
      const auto buffer = queue.buffer(note.buffer);
      const bool written = write(note, std::span<const std::uint8_t>(buffer).first(note.size), held);
      if (written && note.kind == Kind::kHandOut) let_go(note.token);
    } else if (note.kind == Kind::kGiveBack) {
      let_go(note.token);
    } else if (note.kind == Kind::kEnded) {
      end(note.token);
    }
  } catch (const std::exception& error) {
    warn_once("note", error.what());
  }
  if (has_bytes) queue.give_back(note.buffer);
}

bool CheckpointKeeper::write(const server::CheckpointNote& note, std::span<const std::uint8_t> payload,
                             Held& held) {
  const std::string hash = hash_of(note.token);
  const fs::path place = file_of(hash, self_);
  const fs::path beside = file_of(hash, self_ + ".part");
  std::array<std::uint8_t, 40> before{};
  std::array<std::uint8_t, 8> after{};
  server::seal({now_ms(), note.number}, payload, before, after);
  // writev() only reads.
  std::array<iovec, 3> parts{iovec{before.data(), before.size()},
                             iovec{const_cast<std::uint8_t*>(payload.data()), payload.size()},
                             iovec{after.data(), after.size()}};
  const int fd = open_new(beside);
  bool good = fd >= 0 && write_all(fd, parts);
  int error = errno;
  if (fd >= 0) good = ::close(fd) == 0 && good;
  if (good && !held.written) {
    good = ::rename(beside.c_str(), place.c_str()) == 0;
    error = errno;
  } else if (good) {
    good = ::renameat2(AT_FDCWD, beside.c_str(), AT_FDCWD, place.c_str(), RENAME_EXCHANGE) == 0;
    error = errno;
    if (!good &&
        (error == EINVAL || error == ENOSYS)) {  // a file system that cannot: a moment may lie between
      good = ::access(place.c_str(), F_OK) == 0 && ::rename(beside.c_str(), place.c_str()) == 0;
      error = errno;
    }
    if (!good && error == ENOENT) {
      ::unlink(beside.c_str());
      lost(note);
      return false;
    }
  }
  if (held.written || !good) ::unlink(beside.c_str());
  if (!good) {
    warn_once("write", place.string() + ": cannot be written: " + std::strerror(error));
    return false;
  }
  held.written = true;
  return true;
}

/// Another server has taken the session up, which believed this one dead; it must not be here too.
void CheckpointKeeper::lost(const server::CheckpointNote& note) {
  warn_once("lost", file_of(hash_of(note.token), self_).string() +
                        ": is gone: another server has taken the session over, so it ends here");
  held_[note.token].lost = true;
  server::HandoffMessage message;
  message.kind = server::HandoffMessage::Kind::kTaken;
  message.from = static_cast<std::uint32_t>(mail_.workers());
  message.token = note.token;
  message.owner = note.owner;
  for (std::size_t worker = 0; worker < mail_.workers(); ++worker) mail_.post(worker, message);
}

void CheckpointKeeper::let_go(std::uint64_t token) {
  const std::string hash = hash_of(token);
  ::rename(file_of(hash, self_).c_str(), file_of(hash, kNobody).c_str());
  held_.erase(token);
}

/// First the sign that it is over, then the file: killed in between there is at most too much of it.
void CheckpointKeeper::end(std::uint64_t token) {
  const auto held = held_.find(token);
  if (held == held_.end()) return;
  const bool written = held->second.written && !held->second.lost;
  held_.erase(held);
  if (!written) return;
  const std::string hash = hash_of(token);
  const int fd = ::open(file_of(hash, "ended").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd >= 0) ::close(fd);
  ::unlink(file_of(hash, self_).c_str());
}

/// True: that server is dead; `fd` holds its lock, or is -1 where there is none any more.
bool CheckpointKeeper::lock_of_dead(const std::string& holder, int& fd) const {
  fd = ::open((fs::path(config_.folder) / (holder + ".lock")).c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW);
  if (fd < 0) return errno == ENOENT;
  if (::flock(fd, LOCK_EX | LOCK_NB) == 0) return true;
  ::close(fd);
  fd = -1;
  return false;
}

void CheckpointKeeper::answer(const server::HandoffMessage& question) {
  server::HandoffMessage message;
  message.kind = server::HandoffMessage::Kind::kNotHere;
  message.from = static_cast<std::uint32_t>(mail_.workers());
  message.ticket = question.ticket;
  std::unique_ptr<server::SessionState> state;
  try {
    state = take_up(question.token, question.owner);
  } catch (const std::exception& error) {
    warn_once("take", error.what());
  }
  if (state) {
    message.kind = server::HandoffMessage::Kind::kState;
    message.state = state.get();
  }
  if (mail_.post(question.from, message)) {
    state.release();  // NOLINT(bugprone-unused-return-value): the worker's now
  } else if (state) {
    let_go(question.token);
  }
}

/// All files of a session, whoever has it. The folder holds those of many others: nothing is made of their names.
std::vector<CheckpointKeeper::Found> CheckpointKeeper::files_of(const std::string& hash) const {
  std::vector<Found> all;
  const fs::path room = file_of(hash, "").parent_path();
  const std::unique_ptr<DIR, int (*)(DIR*)> open(::opendir(room.c_str()), &::closedir);
  if (!open) return all;
  const std::string begin = hash + ".";
  while (const dirent* const entry = ::readdir(open.get())) {
    const std::string_view name = entry->d_name;
    if (name.size() != 2 * kHashDigits + 1 || !name.starts_with(begin)) continue;
    const std::string holder(name.substr(begin.size()));
    if (is_holder(holder)) all.push_back({room / name, holder});
  }
  return all;
}

std::unique_ptr<server::SessionState> CheckpointKeeper::take_up(std::uint64_t token, std::uint64_t owner) {
  // Who drains is about to end: the session would move twice.
  if (config_.drain != nullptr && config_.drain->load(std::memory_order_relaxed)) return nullptr;
  const std::string hash = hash_of(token);
  std::error_code none;
  const auto own = held_.find(token);
  if ((own != held_.end() && !own->second.lost) || fs::exists(file_of(hash, "ended"), none)) return nullptr;
  const std::vector<Found> all = files_of(hash);
  // All holders must be dead, and stay so: their locks are kept until the file has its new name.
  struct Locks {
    std::vector<int> fds;
    ~Locks() {
      for (const int fd : fds) ::close(fd);
    }
  } locks;
  for (const Found& found : all) {
    if (found.holder == kNobody) continue;
    int fd = -1;
    if (!lock_of_dead(found.holder, fd)) return nullptr;
    if (fd >= 0) locks.fds.push_back(fd);
  }
  const Found* newest = nullptr;
  server::CheckpointEnvelope newest_envelope;
  std::vector<std::uint8_t> newest_file;
  for (const Found& found : all) {
    std::vector<std::uint8_t> file = read_file(found.path, bytes_ + server::kEnvelopeBytes);
    server::CheckpointEnvelope envelope;
    if (server::unseal(file, envelope).empty()) {
      warn_once(found.path.string(), found.path.string() + ": is not a complete checkpoint of this scene");
      continue;
    }
    if (newest != nullptr && envelope.number <= newest_envelope.number) continue;
    newest = &found;
    newest_envelope = envelope;
    newest_file = std::move(file);
  }
  if (newest == nullptr) return nullptr;
  const auto age_ms = static_cast<std::int64_t>(now_ms() - newest_envelope.written_ms);
  if (std::abs(age_ms) > config_.resume_ms) return nullptr;
  const std::span<const std::uint8_t> payload = server::unseal(newest_file, newest_envelope);
  server::CheckpointHead head;
  // Somebody else's is left alone, and nothing is said of it to who asks.
  if (!server::read_checkpoint_head(payload, head) || head.token != token || head.owner != owner)
    return nullptr;
  if (head.of.scene_hash != config_.of.scene_hash || head.of.physics != config_.of.physics) {
    warn_once(hash, newest->path.string() +
                        ": belongs to another scene or physics version: its station starts a new session");
    return nullptr;
  }
  auto state = server::read_checkpoint(config_.of, payload, config_.make_slave());
  if (!state) {
    warn_once(newest->path.string(), newest->path.string() + ": is not a state of this scene");
    return nullptr;
  }
  // Here it is decided who has it.
  if (::rename(newest->path.c_str(), file_of(hash, self_).c_str()) != 0) return nullptr;
  for (const Found& found : all)
    if (&found != newest) ::unlink(found.path.c_str());
  held_[token] = {newest_envelope.number, true, false};
  state->record.checkpoints = newest_envelope.number;
  ++taken_up_;
  oldest_ms_ = std::max(oldest_ms_, age_ms);
  return state;
}

/// Removes what nobody can take up any more: sessions and signs that are too old, locks of dead servers that
/// have no sessions.
void CheckpointKeeper::clean() {
  cleaned_ms_ = now_ms();
  const auto too_old = fs::file_time_type::clock::now() - std::chrono::milliseconds(config_.resume_ms) -
                       std::chrono::minutes(1);
  std::set<std::string> holders;
  std::vector<fs::path> locks;
  for (const auto& entry : fs::directory_iterator(config_.folder)) {
    const std::string name = entry.path().filename().string();
    if (name.ends_with(".lock") && is_holder(name.substr(0, kHashDigits))) locks.push_back(entry.path());
    if (name.size() != 2 || !entry.is_directory()) continue;
    for (const auto& file : fs::directory_iterator(entry.path())) {
      const std::string of = file.path().filename().string();
      if (of.size() <= kHashDigits + 1 || !is_holder(of.substr(0, kHashDigits))) continue;
      const std::string holder = of.substr(kHashDigits + 1, kHashDigits);
      std::error_code gone;
      const auto written = fs::last_write_time(file.path(), gone);
      if (gone) continue;
      int fd = -1;
      if (written < too_old &&
          (!is_holder(holder) || holder == kNobody || (holder != self_ && lock_of_dead(holder, fd)))) {
        ::unlink(file.path().c_str());
        if (fd >= 0) ::close(fd);
      } else {
        holders.insert(holder);
      }
    }
  }
  for (const fs::path& lock : locks) {
    const std::string holder = lock.filename().string().substr(0, kHashDigits);
    int fd = -1;
    if (holder == self_ || holders.contains(holder) || !lock_of_dead(holder, fd)) continue;
    ::unlink(lock.c_str());
    if (fd >= 0) ::close(fd);
  }
}

}  // namespace telenano::app

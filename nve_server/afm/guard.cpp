#include "telenano/nve_server/afm/guard.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <sstream>
#include <string_view>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/net/tcp.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/nve_server/afm/afm_units.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

extern char** environ;

namespace telenano::afm {
namespace {

constexpr std::int64_t kRetryNs = 20 * kMs;
constexpr std::int64_t kSlowRetryNs = 500 * kMs;  // to a controller that has long not been there
constexpr std::int64_t kLongNs = 60'000 * kMs;
constexpr std::int64_t kLimitsReplyNs = 50 * kMs;  // the withdrawal does not wait longer for the limits
constexpr std::int64_t kReplyNs = 3000 * kMs;      // to a withdrawal that waits until it is done
// The start-up checks ask the emergency connection this often; the heart beat begins before anything moves.
constexpr int kCheckRequests = 3;
constexpr std::int64_t kAgainNs = 100 * kMs;  // before the next withdrawal
constexpr double kSameHeightM = 1e-9;
constexpr std::int64_t kBeatNs = 100 * kMs;        // between two heartbeats to the deadman
constexpr std::int64_t kUnansweredNs = 500 * kMs;  // then the connection is made anew
constexpr std::int64_t kMeetNs = 2000 * kMs;
constexpr std::int64_t kNoticesNs = 2000 * kMs;  // a guard that its server is gone, on a busy machine
constexpr std::string_view kOrder = "telenano-afm-guard 1";
constexpr std::size_t kMostOrder = 4096;
constexpr std::string_view kGoodbye = "Telenano.Goodbye";

/// A name that only one process has at a time, and that goes with it.
class OneName {
 public:
  explicit OneName(const std::string& text) {
    address_.sun_family = AF_UNIX;
    // Abstract: a zero, then the name; no file that could be left behind.
    const std::size_t n = std::min(text.size(), sizeof(address_.sun_path) - 1);
    text.copy(address_.sun_path + 1, n);
    size_ = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + n);
  }
  ~OneName() { release(); }
  OneName(const OneName&) = delete;
  OneName& operator=(const OneName&) = delete;
  /// False where another process has it.
  bool take() {
    if (handle_ >= 0) return true;
    handle_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (::bind(handle_, reinterpret_cast<const sockaddr*>(&address_), size_) == 0 || errno != EADDRINUSE)
      return true;
    release();
    return false;
  }
  void release() {
    if (handle_ >= 0) ::close(handle_);
    handle_ = -1;
  }

 private:
  sockaddr_un address_{};
  socklen_t size_ = 0;
  int handle_ = -1;
};

std::string name_of_living(const std::string& emergency) {
  return "telenano-afm-guard lives " + emergency;
}
std::string name_of_withdrawing(const std::string& emergency) {
  return "telenano-afm-guard " + emergency;
}

class Guard {
 public:
  Guard(int handle, const net::Address& emergency, int silence_ms, const std::optional<DeadmanKey>& key)
      : handle_(handle),
        emergency_(emergency),
        silence_ns_(silence_ms * kMs),
        lives_(name_of_living(net::to_string(emergency))),
        withdraws_alone_(name_of_withdrawing(net::to_string(emergency))) {
    lives_.take();
    if (key) deadman_.emplace(*key, fresh_nonce());
  }

  int run() {
    heard_ns_ = clock_.now_ns();
    for (;;) {
      const std::int64_t now = clock_.now_ns();
      connect(now);
      if (never_ && !tcp_.open()) return 3;
      if (!met(now)) {
        // The server met it a moment ago. What it asks waits.
        if (now > heard_ns_ + kMeetNs || !read_controller(now)) return 3;
        beat(now);
        pollfd entry{tcp_.handle(), POLLIN, 0};
        ::poll(&entry, 1, 10);
        continue;
      }
      if (server_ && !read_server(now)) {
        if (passed_on_ <= kCheckRequests) return 0;  // refused in the checks: nothing has moved
        server_ = false;
        withdraws_alone_.take();
        begin(now);
      }
      if (!read_controller(now) && never_) return 3;
      if (server_ && !withdraws_ && armed_ && now > heard_ns_ + silence_ns_) {
        armed_ = false;  // until it is heard again
        begin(now);
      }
      if (withdraws_) withdraw(now);
      beat(now);
      if (!server_ && !withdraws_ && told_the_deadman(now)) return 0;
      pollfd entries[] = {{server_ ? handle_ : -1, POLLIN, 0}, {tcp_.handle(), POLLIN, 0}};
      ::poll(entries, 2, 10);
    }
  }

 private:
  enum class Step : std::uint8_t { kLimitsOn, kFloor, kUp, kHeight };

  void connect(std::int64_t now) {
    if (connecting_) {
      if (tcp_.connecting()) {
        if (now > retry_ns_ + 2000 * kMs) drop(now);
        return;
      }
      connecting_ = false;
      beat_ns_ = now;
      if (!tcp_.open()) drop(now);
      return;
    }
    if (tcp_.open() || now < retry_ns_) return;
    retry_ns_ = now;
    if (never_) {
      try {
        tcp_ = net::TcpStream::connect(emergency_, 2000 * kMs);
        beat_ns_ = clock_.now_ns();
      } catch (const RunError&) {
      }
      return;
    }
    tcp_ = net::TcpStream::begin_connect(emergency_);
    connecting_ = true;
    asked_ns_ = 0;
  }
  /// Until the deadman has answered for the first time, nothing goes through.
  bool met(std::int64_t now) noexcept {
    if (met_ || (deadman_ && deadman_->answers() == 0)) return met_;
    met_ = true;
    heard_ns_ = now;
    return true;
  }
  /// Is there somebody who withdraws the tip if need be? The server, by what it was last heard; or this
  /// guard, as long as it gets on; or nobody needs to, since it is up.
  bool watched(std::int64_t now) const noexcept {
    if (server_ && now <= heard_ns_ + silence_ns_) return true;
    if (withdraws_) return now <= begun_ns_ + kOwnWithdrawalMs * kMs;
    return up_ns_ > heard_ns_ || !server_;
  }
  void beat(std::int64_t now) {
    if (!deadman_ || connecting_ || !tcp_.open()) return;
    if (!deadman_->greeted() || deadman_->waiting()) {
      if (now > beat_ns_ + kUnansweredNs) drop(now);
      return;
    }
    if (deadman_->answers() > 0 && now < beat_ns_ + kBeatNs) return;
    beat_ns_ = now;
    // Without a sign of life, too: whoever proves the key may withdraw.
    const bool done = !server_ && !withdraws_;
    const bool quiet = passed_on_ <= kCheckRequests || !watched(now);
    write_frame(deadman_->beat(done    ? DeadmanBeat::kDone
                               : quiet ? DeadmanBeat::kQuiet
                                       : DeadmanBeat::kWatch),
                now);
  }
  /// That the tip is up and stays up; for as long as a deadman may need to find that it was not told.
  bool told_the_deadman(std::int64_t now) noexcept {
    if (!deadman_ || (deadman_->answers() > 0 && deadman_->answered_beat() == DeadmanBeat::kDone))
      return true;
    return now > up_ns_ + 2 * kUnansweredNs;
  }
  void drop(std::int64_t now) {
    tcp_.close();
    connecting_ = false;
    controller_.clear();
    if (deadman_) deadman_->restart();
    retry_ns_ = now + (withdraws_ && now > begun_ns_ + kLongNs ? kSlowRetryNs : kRetryNs);
    asked_ns_ = 0;
    was_up_ = false;
    step_ = Step::kUp;  // the limits had their chance
  }
  bool write(const nanonis::Bytes& bytes, std::int64_t now) {
    if (connecting_ || !tcp_.open() || (deadman_ && deadman_->answers() == 0)) return false;
    return write_frame(bytes, now);
  }
  bool write_frame(const nanonis::Bytes& bytes, std::int64_t now) {
    std::size_t n = 0;
    if (tcp_.write(bytes, n) == net::TcpStream::Status::kOk && n == bytes.size()) return true;
    drop(now);
    return false;
  }
  /// False when the server is gone.
  bool read_server(std::int64_t now) {
    std::array<std::uint8_t, 4096> buffer;
    for (;;) {
      const ssize_t n = ::recv(handle_, buffer.data(), buffer.size(), MSG_DONTWAIT);
      if (n == 0) return false;
      if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
      heard_ns_ = now;
      requests_.feed(std::span(buffer).first(static_cast<std::size_t>(n)));
      nanonis::Header header;
      std::span<const std::uint8_t> body;
      while (requests_.next(header, body) == nanonis::FrameReader::Status::kFrame) {
        if (header.name == kGoodbye) {
          given_back_ = true;
          continue;
        }
        const nanonis::Command* command = nanonis::find_command(header.name);
        nanonis::Call call;
        if (command != nullptr && nanonis::decode_call(*command, body, call))
          write(nanonis::encode_call(call), now);
        ++passed_on_;
      }
      // In the checks the other ports may take their time: nothing moves, and a withdrawal would disturb them.
      armed_ = passed_on_ > kCheckRequests;
    }
  }
  /// False when the connection is closed.
  bool read_controller(std::int64_t now) {
    if (connecting_ || !tcp_.open()) return true;
    std::array<std::uint8_t, 4096> buffer;
    for (;;) {
      std::size_t n = 0;
      const auto status = tcp_.read(buffer, n);
      if (status == net::TcpStream::Status::kWouldBlock) return true;
      if (status == net::TcpStream::Status::kClosed) {
        drop(now);
        return false;
      }
      never_ = false;
      if (server_ && !deadman_) ::send(handle_, buffer.data(), n, MSG_NOSIGNAL | MSG_DONTWAIT);
      controller_.feed(std::span(buffer).first(n));
      nanonis::Header header;
      std::span<const std::uint8_t> body;
      for (;;) {
        const auto next = controller_.next(header, body);
        if (next == nanonis::FrameReader::Status::kNeedMore) break;
        if (next == nanonis::FrameReader::Status::kBroken) {
          drop(now);
          return true;
        }
        if (deadman_ && deadman_->feed(header, body)) {
          if (!deadman_->broken()) continue;
          drop(now);
          return true;
        }
        if (deadman_ && server_) pass_back(header, body);
        if (passed_on_ <= kCheckRequests) overhear(header, body);
        if (withdraws_ && asked_ns_ != 0) hear(header, body, now);
      }
    }
  }
  void pass_back(const nanonis::Header& header, std::span<const std::uint8_t> body) const {
    nanonis::Bytes bytes(nanonis::kHeaderBytes, 0);
    std::copy(header.name.begin(), header.name.end(), bytes.begin());
    for (std::size_t i = 0; i < 4; ++i)
      bytes[nanonis::kNameBytes + i] = static_cast<std::uint8_t>(body.size() >> (24 - 8 * i));
    bytes.insert(bytes.end(), body.begin(), body.end());
    ::send(handle_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  }
  void begin(std::int64_t now) {
    withdraws_ = true;
    was_up_ = false;
    step_ = first_step();
    said_not_up_ = false;
    say_ns_ = now;
    begun_ns_ = now;
    asked_ns_ = 0;
    next_ns_ = now;
  }
  /// Withdraw, waiting for its end, then the height: again and again. A withdrawal that timed out, or was not
  /// carried out, has answered too, and a request of the server's that comes late brings the tip down: up is a
  /// tip that two withdrawals in a row have left at its place.
  void withdraw(std::int64_t now) {
    if (now > say_ns_ + kReplyNs) {
      say_ns_ = now + kSayNotUpNs;
      tell("the controller has not said yet that the tip is up; going on until it has");
    }
    if (asked_ns_ != 0) {
      if ((step_ == Step::kLimitsOn || step_ == Step::kFloor) && now > asked_ns_ + kLimitsReplyNs) {
        step_ = Step::kUp;  // at once: what is late is heard and passed over
      } else {
        if (now > asked_ns_ + kReplyNs) drop(now);
        return;
      }
    }
    if (now < next_ns_) return;
    if (!write(nanonis::encode_call(step_call()), now)) return;
    asked_ns_ = now;
  }
  nanonis::Call step_call() const {
    switch (step_) {
      case Step::kLimitsOn:
        return {nanonis::CommandId::kLimitsEnabledSet, {1}};
      case Step::kFloor:
        return {nanonis::CommandId::kLimitsSet, {floor_high_m_, floor_low_m_}};
      case Step::kUp:
        return {nanonis::CommandId::kWithdraw, {1, 2000}};
      default:
        return {nanonis::CommandId::kZPosGet, {}};
    }
  }
  Step first_step() const noexcept { return place_known() && !given_back_ ? Step::kLimitsOn : Step::kUp; }
  bool place_known() const noexcept { return range_m_ > 0 && top_known_; }
  /// As far up as it stood withdrawn at the start. Where that is not known no height is up.
  bool at_place(double height_m) const noexcept {
    return place_known() &&
           (top_m_ > 0 ? height_m : -height_m) >= std::fabs(top_m_) - kUpPart * range_m_ - 1e-9 * kUpSlack_nm;
  }
  /// In the checks: where the withdrawn tip stands, and the whole range. The end that it is near is "up".
  void overhear(const nanonis::Header& header, std::span<const std::uint8_t> body) {
    for (const auto id : {nanonis::CommandId::kZPosGet, nanonis::CommandId::kPiezoRangeGet}) {
      const nanonis::Command& command = nanonis::command(id);
      nanonis::Answer answer;
      if (header.name != command.name || !nanonis::decode_answer(command, body, answer) || answer.error != 0)
        continue;
      if (id == nanonis::CommandId::kZPosGet) {
        top_m_ = answer.numbers[0];
        top_known_ = true;
      } else {
        range_m_ = answer.numbers[2];
      }
    }
    // A withdrawal may end lower than where the tip stood, by the same reckoning as the server's.
    const double end_m = 0.5 * range_m_, up_m = std::min(std::fabs(top_m_), 0.9 * end_m) - kSameHeightM;
    floor_high_m_ = top_m_ > 0 ? end_m : -up_m;
    floor_low_m_ = top_m_ > 0 ? up_m : -end_m;
  }
  /// A whole reply while withdrawing. One to the server's last requests may still come between.
  void hear(const nanonis::Header& header, std::span<const std::uint8_t> body, std::int64_t now) {
    const nanonis::Command& asked = nanonis::command(step_call().id);
    nanonis::Answer answer;
    if (header.name != asked.name || !nanonis::decode_answer(asked, body, answer)) return;
    asked_ns_ = 0;
    const bool done = answer.error == 0;
    if (step_ == Step::kLimitsOn || step_ == Step::kFloor) {
      step_ = step_ == Step::kLimitsOn ? Step::kFloor : Step::kUp;  // whether it takes them or not
      return;
    }
    if (!done) next_ns_ = now + kAgainNs;
    if (step_ == Step::kUp) {
      if (done) step_ = Step::kHeight;
      return;
    }
    step_ = first_step();
    if (!done) return;
    next_ns_ = now + kAgainNs;
    const double height_m = answer.numbers[0];
    if (!at_place(height_m)) {
      was_up_ = false;
      return say_not_up(height_m, now);
    }
    if (was_up_ && std::fabs(height_m - height_m_) < kSameHeightM) {
      withdraws_ = false;
      up_ns_ = now;
      if (!server_ || said_not_up_) tell(text("the tip is withdrawn, at Z = %.1f nm", 1e9 * height_m));
    }
    was_up_ = true;
    height_m_ = height_m;
  }
  void say_not_up(double height_m, std::int64_t now) {
    if (said_not_up_ && now < say_ns_) return;
    said_not_up_ = true;
    say_ns_ = now + kSayNotUpNs;
    tell(text("the tip is NOT up: Z = %.1f nm, ", 1e9 * height_m) +
         (place_known() ? text("up is %.1f nm", 1e9 * top_m_) : "and where up is was not heard") +
         "; withdrawing it again; press Withdraw at the controller");
  }
  /// Where nobody reads it, it goes on without.
  static void tell(const std::string& line) {
    pollfd entry{STDERR_FILENO, POLLOUT, 0};
    if (::poll(&entry, 1, 0) > 0) std::fprintf(stderr, "telenano-nve: afm-guard: %s\n", line.c_str());
  }

  rt::SteadyClock clock_;
  int handle_;
  net::Address emergency_;
  std::int64_t silence_ns_;
  OneName lives_;  // from its start to its end, if no other guard of this controller has it
  OneName withdraws_alone_;
  std::optional<DeadmanLink> deadman_;
  bool met_ = false;
  std::int64_t beat_ns_ = 0;  // when the last beat was sent, or the connection made
  std::int64_t up_ns_ = 0;    // when this guard's last withdrawal had ended
  net::TcpStream tcp_;
  nanonis::FrameReader requests_;
  nanonis::FrameReader controller_;
  bool connecting_ = false;
  bool never_ = true;  // no answer yet
  bool server_ = true;
  bool armed_ = false;
  int passed_on_ = 0;  // requests
  bool given_back_ = false;
  bool top_known_ = false;
  double top_m_ = 0, range_m_ = 0, floor_high_m_ = 0, floor_low_m_ = 0;
  bool withdraws_ = false;
  Step step_ = Step::kUp;
  bool was_up_ = false;  // a withdrawal has left it at its place, at height_m_
  double height_m_ = 0;
  bool said_not_up_ = false;
  std::int64_t say_ns_ = 0;  // when to say again that it is not up
  std::int64_t heard_ns_ = 0;
  std::int64_t begun_ns_ = 0;
  std::int64_t asked_ns_ = 0;
  std::int64_t next_ns_ = 0;
  std::int64_t retry_ns_ = 0;
};

}  // namespace

int run_guard(int handle, const net::Address& emergency, int silence_ms,
              const std::optional<DeadmanKey>& key) {
  struct sigaction ignore {};
  ignore.sa_handler = SIG_IGN;
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGPIPE, SIGQUIT, SIGABRT})
    ::sigaction(number, &ignore, nullptr);
  ::setsid();
  return Guard(handle, emergency, silence_ms, key).run();
}

void await_last_guard(const std::string& emergency, const std::atomic<bool>& stop,
                      const std::function<void(const std::string&)>& news) {
  OneName lives(name_of_living(emergency));
  OneName withdraws_alone(name_of_withdrawing(emergency));
  const rt::SteadyClock clock;
  std::int64_t notices_until_ns = clock.now_ns() + kNoticesNs;
  bool told = false;
  while (!stop.load(std::memory_order_relaxed)) {
    const bool withdraws = !withdraws_alone.take();
    if (withdraws && !std::exchange(told, true))
      news("waiting for the guard of the last run, which is still withdrawing the tip");
    // One that lives and does not withdraw may just not have noticed yet that its server is gone; or its
    // server is another one that still runs, which the controller will tell.
    if (withdraws) notices_until_ns = clock.now_ns() + kNoticesNs;
    if (!withdraws && (lives.take() || clock.now_ns() > notices_until_ns)) return;
    if (!withdraws) withdraws_alone.release();
    const timespec nap{0, static_cast<long>(20 * kMs)};
    ::nanosleep(&nap, nullptr);
  }
}

nanonis::Bytes goodbye() {
  nanonis::Bytes frame(nanonis::kHeaderBytes, 0);
  std::copy(kGoodbye.begin(), kGoodbye.end(), frame.begin());
  return frame;
}

int call_guard(const std::string& socket, const GuardOrder& order) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (socket.empty() || socket.size() >= sizeof address.sun_path)
    throw RunError("the guard's socket '" + socket + "': expected a path of at most 107 characters");
  socket.copy(address.sun_path, socket.size());
  const int handle = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  // One line each, then an empty one.
  const std::string text = std::string(kOrder) + "\n" + order.emergency + "\n" +
                           std::to_string(order.silence_ms) + "\n" + "key " + order.key_file + "\n\n";
  if (handle >= 0 && ::connect(handle, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
      ::send(handle, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size()))
    return handle;
  const std::string why = std::strerror(errno);
  if (handle >= 0) ::close(handle);
  throw RunError("no guard at " + socket + ": " + why +
                 "; is telenano-nve-afm-guard.socket started? (TELENANO_AFM_GUARD names it)");
}

std::optional<GuardOrder> read_guard_order(int handle) {
  const rt::SteadyClock clock;
  const std::int64_t end_ns = clock.now_ns() + kMeetNs;
  std::string text;
  // Byte by byte: what follows is the server's first request.
  while (!text.ends_with("\n\n")) {
    if (text.size() > kMostOrder) return std::nullopt;
    const std::int64_t left_ms = (end_ns - clock.now_ns()) / kMs;
    pollfd entry{handle, POLLIN, 0};
    if (left_ms <= 0 || ::poll(&entry, 1, static_cast<int>(left_ms)) == 0) return std::nullopt;
    char c = 0;
    const ssize_t n = ::recv(handle, &c, 1, MSG_DONTWAIT);
    if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) return std::nullopt;
    if (n > 0) text += c;
  }
  std::istringstream lines(text);
  std::string title, silence, key;
  GuardOrder order;
  std::getline(lines, title);
  std::getline(lines, order.emergency);
  std::getline(lines, silence);
  std::getline(lines, key);
  const auto [last, error] =
      std::from_chars(silence.data(), silence.data() + silence.size(), order.silence_ms);
  if (title != kOrder || order.emergency.empty() || error != std::errc{} ||
      last != silence.data() + silence.size() || order.silence_ms <= 0 || !key.starts_with("key "))
    return std::nullopt;
  order.key_file = key.substr(4);
  return order;
}

int start_guard(const std::string& emergency, int silence_ms, const std::string& key_file) {
  int ends[2] = {-1, -1};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw RunError(std::string("cannot make a stream to the guard: ") + std::strerror(errno));
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, ends[1], STDIN_FILENO);
  // The guard may outlive the server by minutes: with the server's sockets in its hands, the next server
  // would find its own port in use.
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  std::string program = "telenano-nve", command = "afm-guard", flag = "--emergency", address = emergency,
              silence = "--silence-ms", time = std::to_string(silence_ms);
  std::string key_flag = "--deadman-key", key = key_file;
  char* arguments[] = {program.data(),
                       command.data(),
                       flag.data(),
                       address.data(),
                       silence.data(),
                       time.data(),
                       key.empty() ? nullptr : key_flag.data(),
                       key.data(),
                       nullptr};
  pid_t pid = -1;
  const int error = ::posix_spawn(&pid, "/proc/self/exe", &actions, nullptr, arguments, environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(ends[1]);
  if (error != 0) {
    ::close(ends[0]);
    throw RunError(std::string("cannot start the guard: ") + std::strerror(error));
  }
  return ends[0];
}

}  // namespace telenano::afm

#include "nve_server/afm/guard.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "common/base/error.h"
#include "common/net/tcp.h"
#include "common/rt/steady_clock.h"
#include "nve_server/nanonis/frame_reader.h"

extern char** environ;

namespace telenano::afm {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kRetryNs = 20 * kMs;
constexpr std::int64_t kReplyNs = 3000 * kMs;  // to a withdrawal that waits until it is done
// The start-up checks ask the emergency connection once; the heart beat begins before anything moves.
constexpr int kCheckRequests = 1;
constexpr std::int64_t kAgainNs = 100 * kMs;  // before the second withdrawal

class Guard {
 public:
  Guard(int handle, const net::Address& emergency, int silence_ms)
      : handle_(handle), emergency_(emergency), silence_ns_(silence_ms * kMs) {}

  int run() {
    heard_ns_ = clock_.now_ns();
    for (;;) {
      const std::int64_t now = clock_.now_ns();
      connect(now);
      if (never_ && !tcp_.open()) return 3;
      if (server_ && !read_server(now)) {
        if (passed_on_ <= kCheckRequests) return 0;  // refused in the checks: nothing has moved
        server_ = false;
        begin(now);
      }
      if (!read_controller(now) && never_) return 3;
      if (server_ && left_ == 0 && armed_ && now > heard_ns_ + silence_ns_) {
        armed_ = false;  // until it is heard again
        begin(now);
      }
      if (left_ > 0) withdraw(now);
      if (!server_ && left_ == 0) return 0;
      if (!server_ && now > begun_ns_ + kGuardGiveUpS * 1000 * kMs) return 1;
      pollfd entries[] = {{server_ ? handle_ : -1, POLLIN, 0}, {tcp_.handle(), POLLIN, 0}};
      ::poll(entries, 2, 10);
    }
  }

 private:
  void connect(std::int64_t now) {
    if (connecting_) {
      if (tcp_.connecting()) {
        if (now > retry_ns_ + 2000 * kMs) drop(now);
        return;
      }
      connecting_ = false;
      if (!tcp_.open()) drop(now);
      return;
    }
    if (tcp_.open() || now < retry_ns_) return;
    if (never_) {
      try {
        tcp_ = net::TcpStream::connect(emergency_, 2000 * kMs);
      } catch (const RunError&) {
      }
      return;
    }
    tcp_ = net::TcpStream::begin_connect(emergency_);
    connecting_ = true;
    asked_ns_ = 0;
  }
  void drop(std::int64_t now) {
    tcp_.close();
    connecting_ = false;
    controller_.clear();
    retry_ns_ = now + kRetryNs;
    asked_ns_ = 0;
  }
  bool write(const nanonis::Bytes& bytes, std::int64_t now) {
    std::size_t n = 0;
    if (connecting_ || !tcp_.open()) return false;
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
      armed_ = true;
      requests_.feed(std::span(buffer).first(static_cast<std::size_t>(n)));
      nanonis::Header header;
      std::span<const std::uint8_t> body;
      while (requests_.next(header, body) == nanonis::FrameReader::Status::kFrame) {
        const nanonis::Command* command = nanonis::find_command(header.name);
        nanonis::Call call;
        if (command != nullptr && nanonis::decode_call(*command, body, call))
          write(nanonis::encode_call(call), now);
        ++passed_on_;
      }
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
      if (server_) ::send(handle_, buffer.data(), n, MSG_NOSIGNAL | MSG_DONTWAIT);
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
        const nanonis::Command& up = nanonis::command(nanonis::CommandId::kWithdraw);
        nanonis::Answer answer;
        if (left_ > 0 && asked_ns_ != 0 && header.name == up.name &&
            nanonis::decode_answer(up, body, answer) && answer.error == 0) {
          --left_;
          asked_ns_ = 0;
          next_ns_ = now + kAgainNs;
        }
      }
    }
  }
  void begin(std::int64_t now) {
    left_ = 2;
    begun_ns_ = now;
    asked_ns_ = 0;
    next_ns_ = now;
  }
  void withdraw(std::int64_t now) {
    if (asked_ns_ != 0) {
      if (now > asked_ns_ + kReplyNs) drop(now);
      return;
    }
    if (now < next_ns_) return;
    if (!write(nanonis::encode_call({nanonis::CommandId::kWithdraw, {1, 2000}}), now)) return;
    asked_ns_ = now;
  }

  rt::SteadyClock clock_;
  int handle_;
  net::Address emergency_;
  std::int64_t silence_ns_;
  net::TcpStream tcp_;
  nanonis::FrameReader requests_;
  nanonis::FrameReader controller_;
  bool connecting_ = false;
  bool never_ = true;  // no answer yet
  bool server_ = true;
  bool armed_ = false;
  int passed_on_ = 0;  // requests
  int left_ = 0;       // withdrawals still to be done
  std::int64_t heard_ns_ = 0;
  std::int64_t begun_ns_ = 0;
  std::int64_t asked_ns_ = 0;
  std::int64_t next_ns_ = 0;
  std::int64_t retry_ns_ = 0;
};

}  // namespace

int run_guard(int handle, const net::Address& emergency, int silence_ms) {
  struct sigaction ignore {};
  ignore.sa_handler = SIG_IGN;
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) ::sigaction(number, &ignore, nullptr);
  ::setsid();
  return Guard(handle, emergency, silence_ms).run();
}

int start_guard(const std::string& emergency, int silence_ms) {
  int ends[2] = {-1, -1};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw RunError(std::string("cannot make a stream to the guard: ") + std::strerror(errno));
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, ends[1], STDIN_FILENO);
  std::string program = "telenano-nve", command = "afm-guard", flag = "--emergency", address = emergency,
              silence = "--silence-ms", time = std::to_string(silence_ms);
  char* arguments[] = {program.data(), command.data(), flag.data(), address.data(),
                       silence.data(), time.data(),    nullptr};
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

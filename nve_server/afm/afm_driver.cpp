#include "telenano/nve_server/afm/afm_driver.h"

#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <utility>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/nve_server/afm/afm_adapters.h"
#include "telenano/nve_server/afm/guard.h"

namespace telenano::afm {
namespace {

constexpr std::int64_t kReconnectNs = 20'000'000;
constexpr std::int64_t kConnectNs = 2'000'000'000;
constexpr std::int64_t kAskNs = 200'000'000;
constexpr std::int64_t kTurnNs = 500'000;
constexpr std::int64_t kIdleTurnNs = 5'000'000;  // with the tip up, until somebody wants it

void nap(std::int64_t ns) {
  const timespec time{static_cast<time_t>(ns / 1'000'000'000), static_cast<long>(ns % 1'000'000'000)};
  ::nanosleep(&time, nullptr);
}

}  // namespace

AfmDriver::AfmDriver(const AfmConfig& config, const DriverOptions& options,
                     std::shared_ptr<AfmExchange> exchange, const rt::Clock& clock,
                     std::function<void(const std::string&)> news)
    : logic_(config, make_adapter(options.adapter, config)),
      options_(options),
      exchange_(std::move(exchange)),
      clock_(clock),
      news_(std::move(news)) {
  if (!options_.approved) logic_.await_approval();
}

bool AfmDriver::end() {
  stop_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) thread_.join();
  const Phase phase = logic_.state().phase;
  return phase == Phase::kChecking || phase == Phase::kRefused || phase == Phase::kWithdrawn;
}

AfmDriver::~AfmDriver() {
  end();
  if (options_.emergency_handle >= 0) ::close(options_.emergency_handle);  // the guard withdraws once more
}

void AfmDriver::start(const std::atomic<bool>& stop) {
  for (std::size_t i = 0; i < options_.ports.size(); ++i) {
    const Role role = static_cast<Role>(i);
    try {
      streams_[i].tcp = net::TcpStream::connect(options_.ports[i], kConnectNs);
    } catch (const RunError& error) {
      throw UserError("port of " + std::string(name(role)) + ": " + error.what() +
                      "; expected an AFM controller there (--controller, --ports)");
    }
    logic_.connected(role, clock_.now_ns());
  }
  emergency_open_ = true;
  logic_.connected(Role::kEmergency, clock_.now_ns());
  thread_ = std::thread([this] { run(); });
  for (;;) {
    const Phase phase = phase_.load(std::memory_order_acquire);
    if (phase == Phase::kFollowing || awaits_.load(std::memory_order_acquire) ||
        stop.load(std::memory_order_relaxed))
      return;
    if (refused_.load(std::memory_order_acquire) || phase == Phase::kWithdrawn) break;
    nap(5'000'000);
  }
  // The thread still looks after the tip; what it says is settled.
  stop_.store(true, std::memory_order_relaxed);
  thread_.join();
  throw UserError(!logic_.refusal().empty()
                      ? logic_.refusal()
                      : "the approach failed, the tip was withdrawn: " +
                            std::string(name(logic_.state().cause)) + " (" + logic_.news() + ")");
}

int AfmDriver::handle(Role role) const noexcept {
  if (role == Role::kEmergency) return emergency_open_ ? options_.emergency_handle : -1;
  return streams_[static_cast<std::size_t>(role)].tcp.handle();
}

void AfmDriver::close(Role role, std::int64_t now_ns) {
  Stream& s = streams_[static_cast<std::size_t>(role)];
  s.tcp.close();
  s.connecting = false;
  logic_.port().reset(role);
  s.reconnect_ns = now_ns + kReconnectNs;
}

void AfmDriver::connect(Role role, std::int64_t now_ns) {
  Stream& s = streams_[static_cast<std::size_t>(role)];
  if (role == Role::kEmergency) {
    // The guard keeps its connection itself; after a silence it is asked anew.
    if (s.reconnect_ns != 0 && now_ns >= s.reconnect_ns && emergency_open_) {
      s.reconnect_ns = 0;
      logic_.connected(role, now_ns);
    }
    return;
  }
  if (s.connecting) {
    if (s.tcp.connecting()) {
      if (now_ns > s.reconnect_ns + kConnectNs) close(role, now_ns);
      return;
    }
    s.connecting = false;
    if (s.tcp.open()) {
      logic_.connected(role, now_ns);
    } else {
      close(role, now_ns);
    }
    return;
  }
  if (s.tcp.open() || now_ns < s.reconnect_ns) return;
  s.tcp = net::TcpStream::begin_connect(options_.ports[static_cast<std::size_t>(role)]);
  s.connecting = true;
}

bool AfmDriver::receive(Role role, std::int64_t now_ns) {
  Stream& s = streams_[static_cast<std::size_t>(role)];
  std::array<std::uint8_t, 8192> buffer;
  bool closed = false;
  for (;;) {
    if (role == Role::kEmergency) {
      const ssize_t n = ::recv(options_.emergency_handle, buffer.data(), buffer.size(), MSG_DONTWAIT);
      if (n > 0) {
        logic_.port().feed(role, std::span(buffer).first(static_cast<std::size_t>(n)));
        continue;
      }
      closed = n == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
      break;
    }
    std::size_t n = 0;
    const auto status = s.tcp.read(buffer, n);
    if (status == net::TcpStream::Status::kOk) {
      logic_.port().feed(role, std::span(buffer).first(n));
      continue;
    }
    closed = status == net::TcpStream::Status::kClosed;
    break;
  }
  bool any = false;
  for (;;) {
    AfmReading reading;
    const AfmPort::Next next = logic_.port().next(role, reading);
    if (next == AfmPort::Next::kNeedMore) break;
    if (next == AfmPort::Next::kBroken) {
      close(role, now_ns);
      logic_.lost(role, Loss::kGarbage, now_ns);
      return true;
    }
    logic_.answered(role, reading, now_ns);
    any = true;
  }
  if (closed) {
    if (role == Role::kEmergency) emergency_open_ = false;
    close(role, now_ns);
    logic_.lost(role, Loss::kClosed, now_ns);
  }
  return any;
}

void AfmDriver::send(Role role, std::span<const std::uint8_t> bytes, std::int64_t now_ns) {
  std::size_t n = 0;
  bool sent = false;
  if (role == Role::kEmergency) {
    sent = ::send(options_.emergency_handle, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT) ==
           static_cast<ssize_t>(bytes.size());
  } else {
    sent = streams_[static_cast<std::size_t>(role)].tcp.write(bytes, n) == net::TcpStream::Status::kOk &&
           n == bytes.size();
  }
  if (sent) {
    logic_.sent(role, clock_.now_ns());
    return;
  }
  // A request of a hundred bytes that the socket does not take: the other end has long not read.
  close(role, now_ns);
  logic_.lost(role, Loss::kClosed, now_ns);
}

void AfmDriver::turn(std::int64_t now_ns) {
  // What has come is taken in before time goes on: a thread that was kept waiting itself would find that the
  // controller did not answer in time, with the answer in its socket.
  for (std::size_t i = 0; i < kRoles; ++i) {
    const Role role = static_cast<Role>(i);
    connect(role, now_ns);
    if (handle(role) >= 0 && !streams_[i].connecting) receive(role, now_ns);
  }
  exchange_->load_wish(wish_);
  if (logic_.awaits_approval() && options_.take_approval && now_ns >= approval_asked_ns_ + kAskNs) {
    approval_asked_ns_ = now_ns;
    if (options_.take_approval()) logic_.approve(now_ns);
  }
  logic_.tick(now_ns, wish_);
  if (options_.before_approach && approaching(logic_.state().phase)) {
    try {
      std::exchange(options_.before_approach, nullptr)();
    } catch (const std::exception& error) {  // also a full disk
      logic_.forbid(error.what(), now_ns);
    }
  }
  // Emergency first: a withdrawal goes before all else, and its heart beat before the first motion.
  for (std::size_t k = 0; k < kRoles; ++k) {
    const std::size_t i = (k + kRoles - 1) % kRoles;
    const Role role = static_cast<Role>(i);
    if (logic_.take_close(role)) close(role, now_ns);
    if (handle(role) < 0 || streams_[i].connecting) continue;
    AfmCommand command;
    if (logic_.next(role, now_ns, command)) send(role, logic_.port().encode(role, command), now_ns);
  }
  exchange_->store_state(logic_.state());
  if (logic_.news_count() != told_) {
    told_ = logic_.news_count();
    news_(logic_.news());
  }
  if (!logic_.refusal().empty() &&
      (logic_.state().phase == Phase::kRefused || logic_.state().phase == Phase::kWithdrawn))
    refused_.store(true, std::memory_order_release);
  awaits_.store(logic_.awaits_approval(), std::memory_order_release);
  phase_.store(logic_.state().phase, std::memory_order_release);
}

void AfmDriver::sleep(std::int64_t ns) {
  std::array<pollfd, kRoles> entries{};
  for (std::size_t i = 0; i < kRoles; ++i) {
    entries[i].fd = streams_[i].connecting ? -1 : handle(static_cast<Role>(i));
    entries[i].events = POLLIN;
  }
  const timespec time{0, static_cast<long>(ns)};
  ::ppoll(entries.data(), entries.size(), &time, nullptr);
}

void AfmDriver::run() {
  if (options_.realtime_priority > 0) {
    rt::RealtimeConfig realtime;
    realtime.priority = options_.realtime_priority;
    news_("the controller's thread: " + rt::enter_realtime(realtime).text);
  }
  std::int64_t exit_ns = 0;
  for (;;) {
    const std::int64_t now_ns = clock_.now_ns();
    turn(now_ns);
    if (stop_.load(std::memory_order_relaxed)) {
      const Phase phase = logic_.state().phase;
      if (exit_ns == 0) {
        exit_ns = now_ns + static_cast<std::int64_t>(kExitS * 1e9);
        logic_.withdraw(Cause::kExit, now_ns);
      } else if (logic_.finished() || phase == Phase::kChecking || now_ns > exit_ns) {
        if (logic_.finished()) send(Role::kEmergency, goodbye(), now_ns);
        return;
      }
    }
    const bool idle = logic_.state().phase == Phase::kWithdrawn && !stop_.load(std::memory_order_relaxed);
    sleep(idle ? kIdleTurnNs : kTurnNs);
  }
}

}  // namespace telenano::afm

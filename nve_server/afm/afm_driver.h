#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <thread>

#include "telenano/common/net/tcp.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/afm/afm_logic.h"

namespace telenano::afm {

struct DriverOptions {
  std::string adapter = "nanonis";    ///< the kind of controller, as afm_adapters.h names it
  std::array<net::Address, 3> ports;  ///< motion, reads, data
  int emergency_handle = -1;          ///< a stream to the guard, which has the fourth connection; taken over
  /// Where false, the tip stays up after the checks until an operator wants to engage, or take_approval()
  /// says that one has approved (asked now and then, from the controller's thread).
  bool approved = true;
  std::function<bool()> take_approval = nullptr;
  /// Once, before anything moves; from that thread. Where it throws, nothing does.
  std::function<void()> before_approach = nullptr;
  int realtime_priority = 0;  ///< SCHED_FIFO of the thread, 1..99; 0 = ordinary scheduling
};

/// The thread that has the connections: moves bytes between the logic and the controller, reconnects, and
/// exchanges with the server's loop. One line for each thing that happens goes to `news`, from that thread.
class AfmDriver {
 public:
  AfmDriver(const AfmConfig& config, const DriverOptions& options, std::shared_ptr<AfmExchange> exchange,
            const rt::Clock& clock, std::function<void(const std::string&)> news);
  /// Withdraws, and waits for it as long as kExitS.
  ~AfmDriver();

  /// Withdraws, gives the controller its settings back, and waits for it as long as kExitS. True when the tip
  /// is known to be up, or has never moved.
  bool end();

  /// Connects, checks and approaches; returns when the tip waits above the surface, or stays up until it is
  /// approved, or `stop` is set. Throws
  /// UserError, one line, for whatever does not fit: then nothing has moved, or the tip is withdrawn.
  void start(const std::atomic<bool>& stop);

  static constexpr double kExitS = 3;

 private:
  struct Stream {
    net::TcpStream tcp;
    bool connecting = false;
    std::int64_t reconnect_ns = 0;
  };
  void run();
  void turn(std::int64_t now_ns);
  void close(Role role, std::int64_t now_ns);
  void connect(Role role, std::int64_t now_ns);
  bool receive(Role role, std::int64_t now_ns);
  void send(Role role, std::span<const std::uint8_t> bytes, std::int64_t now_ns);
  void sleep(std::int64_t ns);
  int handle(Role role) const noexcept;

  AfmLogic logic_;
  DriverOptions options_;
  std::shared_ptr<AfmExchange> exchange_;
  const rt::Clock& clock_;
  std::function<void(const std::string&)> news_;
  std::array<Stream, kRoles> streams_;
  bool emergency_open_ = false;
  PortTarget wish_;
  std::uint64_t told_ = 0;
  std::int64_t approval_asked_ns_ = 0;
  std::atomic<bool> stop_{false};
  std::atomic<Phase> phase_{Phase::kChecking};
  std::atomic<bool> refused_{false};
  std::atomic<bool> awaits_{false};
  std::thread thread_;
};

}  // namespace telenano::afm

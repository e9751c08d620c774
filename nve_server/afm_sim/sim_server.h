#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/net/tcp.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/afm_sim/sim_controller.h"
#include "telenano/nve_server/afm_sim/sim_faults.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::afm_sim {

struct SimServerOptions {
  std::vector<net::Address> ports;  ///< one client each; a second one is closed at once
  std::vector<Fault> faults;        ///< planned
  std::string control_file;         ///< a fault written into it happens then; empty: none
};

/// The simulated controller on TCP. One thread: it alone touches the controller, in the order in which
/// requests come; each connection is answered in the order of its requests, the next one begun when the last
/// one is answered.
class SimServer {
 public:
  SimServer(const SimServerOptions& options, const SimController& controller, const rt::Clock& clock);

  /// Serves until `stop`.
  void run(const std::atomic<bool>& stop);
  const SimController& controller() const noexcept { return controller_; }
  std::vector<net::Address> local() const;
  std::uint64_t calls() const noexcept { return calls_; }
  /// The tip's greatest force since the start.
  double greatest_nn() const noexcept { return std::max(greatest_nn_, controller_.tip().peak_force_nn()); }

 private:
  struct Port {
    std::optional<net::TcpListener> listener;
    net::TcpStream stream;
    nanonis::FrameReader reader;
    std::optional<SimController::Pending> pending;
    std::string unknown;  ///< name of a command that is none, to be answered with an error
    bool wants_reply = false;
    nanonis::Bytes out;
    bool garbage = false;
  };

  std::int64_t now_ns() const noexcept { return clock_.now_ns() - begin_ns_; }
  static constexpr std::int64_t kLookNs = 20'000'000;
  static constexpr std::int64_t kRestNs = 500'000'000;  ///< also the longest that `stop` may wait
  bool nobody_and_nothing() const noexcept;
  void apply(const Fault& fault);
  void look_at_control_file();
  void look_at_tip();
  void accept(Port& port);
  static void hear(Port& port);
  static void forget_client(Port& port);
  void serve(Port& port, int index);
  void answer(Port& port, std::int64_t now_ns);
  void wait(std::int64_t most_ns);

  SimServerOptions options_;
  SimController controller_;
  const rt::Clock& clock_;
  std::int64_t begin_ns_;
  std::deque<Port> ports_;
  std::size_t next_fault_ = 0;
  std::int64_t silent_until_ns_ = 0;
  std::int64_t slow_until_ns_ = 0;
  std::int64_t slow_ns_ = 0;
  std::int64_t control_looked_ns_ = 0;
  std::int64_t control_stamp_ns_ = 0;
  Random random_{7};
  std::uint64_t calls_ = 0;
  bool tip_out_ = false;
  double greatest_nn_ = 0;  // up to when the tip was last withdrawn
};

}  // namespace telenano::afm_sim

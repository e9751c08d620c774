#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/step_log.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/server/server.h"
#include "tests/studies/replay/recorded_session.h"

namespace telenano::studies {

/// The station's clock as it was when the recording was made: it shows what it is set to.
class RecordedClock final : public rt::Clock {
 public:
  std::int64_t now_ns() const noexcept override { return now_ns_; }
  void set(std::int64_t now_ns) noexcept { now_ns_ = now_ns; }

 private:
  std::int64_t now_ns_ = 0;
};

/// The network as it was: a command reaches the server if the slave had stepped by it, and its reply comes
/// back in the ticks in which it did.
class ScriptedWire final : public net::Datagram {
 public:
  ScriptedWire(server::Server& server, RecordedClock& clock, StepOrder order)
      : server_(server), clock_(clock), order_(std::move(order)) {}

  /// For the handshake everything comes and is answered at once; commands go by the script.
  void open_to_all(bool open) noexcept { open_ = open; }
  /// The answer to a command; null: the slave did not step by it.
  const std::vector<std::uint8_t>* reply_to(std::uint64_t command) const;
  /// What came in the tick that is next.
  void begin_tick(std::int64_t now_ns, std::span<const recording::DatagramRow> rows) {
    clock_.set(now_ns);
    rows_ = rows;
  }

  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override;

  std::int64_t steps() const noexcept { return steps_; }
  /// The tick is over, and this was its step: what was sent in it gets to the server.
  void end_tick(std::uint64_t number, const link::LoggedStep& step);
  /// What a reply that came had said of the log, where steps are logged: the last one that the slave had
  /// made. By that command it makes them up to there, and no more. Which datagram brought a step, how often
  /// it was sent again, and whether a datagram or the server's own look at its log made it, depends on
  /// microseconds that no recording holds, and the slave's state does not. So every command brings what is
  /// made, as much as fits, and the server's ring keeps it until its turn.
  void expect_executed(std::uint64_t command, std::uint64_t executed) { executed_[command] = executed; }
  /// The first command at which the server had made other steps by then; 0: none.
  std::uint64_t other_steps_at() const noexcept { return other_steps_at_; }
  const net::Address& address() const noexcept { return address_; }

 private:
  void deliver(std::span<const std::uint8_t> bytes, std::int64_t now_ns);
  std::uint64_t executed_by(std::uint64_t command) const noexcept;
  std::size_t with_steps(std::uint64_t last, std::span<std::uint8_t> out) noexcept;

  server::Server& server_;
  RecordedClock& clock_;
  StepOrder order_;
  net::Address address_{.port = 1};
  link::Codec codec_;
  link::Incoming incoming_;
  bool open_ = true;
  std::map<std::uint64_t, std::uint64_t> executed_;  ///< by the command answered
  std::uint64_t other_steps_at_ = 0;
  std::map<std::uint64_t, link::LoggedStep> made_;  ///< by the station, and not yet at the server
  std::uint64_t brought_ = 0;                       ///< the server has the steps up to here
  std::uint64_t last_executed_ = 0;
  std::vector<std::pair<std::int64_t, std::vector<std::uint8_t>>> waits_for_steps_;  ///< sent in this tick
  std::int64_t steps_ = 0;
  std::span<const recording::DatagramRow> rows_;
  std::deque<std::vector<std::uint8_t>> waiting_;               ///< while open to all
  std::map<std::uint64_t, std::vector<std::uint8_t>> replies_;  ///< by the command answered
};

}  // namespace telenano::studies

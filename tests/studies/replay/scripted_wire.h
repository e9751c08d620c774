#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/step_log.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/server/server.h"
#include "tests/studies/replay/other_holders.h"
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

/// What a reply that came had said of the log, where steps are logged.
struct ToldLog {
  link::StepReport report;
  /// It is known that twin and server parted over this reply, and not for a break that was declared.
  bool parts = false;
  /// Another session held the shared tip, or nobody.
  bool observes = false;
  double energy_in_aj = 0;  ///< that this session had put into the port by then, and got back
  double energy_out_aj = 0;
};

/// Of one session.
struct Script {
  StepOrder order{};
  std::map<std::uint64_t, ToldLog> told{};  ///< by the command answered; of the replies that came
  bool shares_tip = false;
};

/// The network as it was: a command reaches the server if the slave had stepped by it, and its reply comes
/// back in the ticks in which it did.
///
/// *Breaks of the log.* Where the server had declared one (an outage, a stop), it had left out steps that
/// nobody knows, or withdrawn the tip by its own clock: from there on the replayed slave is not the recorded
/// one. The replies then say what the recording says, until the server's state that the station took up: the
/// replayed slave takes it up too, and all is computed anew from there.
///
/// *A shared tip.* The replayed server has one session, which holds the tip throughout. While another one held the
/// recorded tip the replies say so, and what the recording says of the rest; that holding's marks, and those that
/// were taken back, are in the state that the twin took up when it had the tip again.
class ScriptedWire final : public net::Datagram {
 public:
  /// `new_hash`: of the state of a slave that nobody has moved yet.
  ScriptedWire(server::Server& server, RecordedClock& clock, Script script, std::uint64_t new_hash = 0)
      : server_(&server), clock_(clock), script_(std::move(script)), others_(new_hash) {}

  /// For the handshake everything comes and is answered at once; commands go by the script.
  void open_to_all(bool open) noexcept { open_ = open; }
  /// The answer to a command; null: the slave did not step by it.
  const std::vector<std::uint8_t>* reply_to(std::uint64_t command) const;
  /// What came in the tick that is next, of which `recorded` is the row (null: nothing is told by it).
  void begin_tick(std::int64_t now_ns, std::span<const recording::DatagramRow> rows,
                  const recording::Sample* recorded = nullptr) {
    clock_.set(now_ns);
    rows_ = rows;
    recorded_ = recorded;
    if (recorded != nullptr) tick_ = recorded->tick;
    told_in_tick_ = false;
  }

  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override;

  std::int64_t steps() const noexcept { return steps_; }
  /// The tick is over, and this was its step: what was sent in it gets to the server.
  void end_tick(std::uint64_t number, const link::LoggedStep& step);
  /// What a reply that came had said of the log: the last step that the slave had made. By that command it
  /// makes them up to there, and no more. Which datagram brought a step, how often it was sent again, and
  /// whether a datagram or the server's own look at its log made it, depends on microseconds that no recording
  /// holds, and the slave's state does not. So each step is there when it is made, however many at once.
  void expect_executed(std::uint64_t command, std::uint64_t executed) {
    script_.told[command].report.executed = executed;
  }
  /// The server's states that the station took in, by when it had each whole.
  void set_states(const std::vector<RecordedState>* states) noexcept { states_ = states; }
  /// The pieces of them, in the order in which they came.
  void set_pieces(std::span<const recording::StatePieceRow> pieces) noexcept { pieces_ = pieces; }
  /// The first command at which the server had made other steps by then; 0: none.
  std::uint64_t other_steps_at() const noexcept { return other_steps_at_; }
  /// The slave is not the recorded one at present.
  bool apart() const noexcept { return apart_; }
  /// In this tick a reply came that says what the recording says.
  bool told_in_tick() const noexcept { return told_in_tick_; }
  const net::Address& address() const noexcept { return address_; }

  /// The session is resumed in the tick that is next: what the Welcome says of the log is `report`, so the
  /// slave had made its steps up to there.
  void end_session(const link::StepReport& report, std::int64_t now_ns);
  /// The session goes on with a new slave, of another server.
  void use(server::Server& server) noexcept;
  /// From the Welcome of the tick that is next on, which `answer` is; it says what the recording says where
  /// the slave is not the recorded one.
  void begin_session(Script script, std::span<const std::uint8_t> answer, const link::StepReport& report);

 private:
  void deliver(std::span<const std::uint8_t> bytes, std::int64_t now_ns);
  std::uint64_t executed_by(std::uint64_t command) const noexcept;
  void bring_up_to(std::uint64_t last, std::uint64_t session_id, std::int64_t now_ns) noexcept;
  bool take_up_state(std::uint64_t session_id, const link::StepReport& report) noexcept;
  void part(const link::StepReport& report) noexcept;
  std::vector<std::uint8_t> as_told(const std::vector<std::uint8_t>& reply, std::uint64_t command);
  std::vector<std::uint8_t> next_piece();

  server::Server* server_;
  RecordedClock& clock_;
  Script script_;
  Script next_script_;  ///< from the Welcome on
  net::Address address_{.port = 1};
  link::Codec codec_;
  link::Incoming incoming_;
  bool open_ = true;
  std::uint64_t other_steps_at_ = 0;
  std::map<std::uint64_t, link::LoggedStep> made_;  ///< by the station
  std::uint64_t brought_ = 0;                       ///< the server has the steps up to here
  std::uint64_t last_executed_ = 0;
  std::optional<std::uint64_t> taken_up_at_;  ///< the last step of the state that was taken up last
  std::uint32_t breaks_ = 0;                  ///< declared by then, as recorded
  bool apart_ = false;
  OtherHolders others_;
  std::int64_t apart_since_ = 0;  ///< tick
  bool told_in_tick_ = false;
  std::uint64_t session_id_ = 0;
  std::vector<std::pair<std::int64_t, std::vector<std::uint8_t>>> waits_for_steps_;  ///< sent in this tick
  std::int64_t steps_ = 0;
  std::span<const recording::DatagramRow> rows_;
  std::int64_t tick_ = 0;
  const recording::Sample* recorded_ = nullptr;
  const std::vector<RecordedState>* states_ = nullptr;
  std::span<const recording::StatePieceRow> pieces_;
  std::vector<std::uint8_t> welcome_;
  std::deque<std::vector<std::uint8_t>> waiting_;               ///< while open to all
  std::map<std::uint64_t, std::vector<std::uint8_t>> replies_;  ///< by the command answered
  std::set<std::uint64_t> tells_;                               ///< of those: they say what was recorded
};

}  // namespace telenano::studies

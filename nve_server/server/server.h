#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/drop_cause.h"
#include "telenano/common/link/server_handshake.h"
#include "telenano/common/link/session_table.h"
#include "telenano/common/link/token_bucket.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/server/audit.h"
#include "telenano/nve_server/server/load_estimate.h"
#include "telenano/nve_server/server/opening_budget.h"
#include "telenano/nve_server/server/port_account.h"
#include "telenano/nve_server/server/port_control.h"
#include "telenano/nve_server/server/served_scene.h"
#include "telenano/nve_server/server/server_config.h"
#include "telenano/nve_server/server/server_counters.h"
#include "telenano/nve_server/server/service_times.h"
#include "telenano/nve_server/server/session_port.h"
#include "telenano/nve_server/server/tip_holder.h"
#include "telenano/nve_server/server/work_budget.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::server {

/// The server without its socket: datagrams and times go in, answers come out. The same object serves real
/// UDP and whole sessions in virtual time.
///
/// An established exchange is: scan, decode, find the session, check address, epoch and sequence, step the
/// slave by the time between the commands, encode. It neither allocates, throws, waits nor logs. Every
/// datagram that is not used is counted under one cause.
class Server {
 public:
  /// Throws UserError for a scene that cannot be shared so, RunError if it
  /// makes no slave.
  Server(const ServerConfig& config, ServedScene scene);
  /// Several, at least one, all with hashes of their own: a session begins in the first, and its station may have
  /// another. Throws UserError with a shared tip too.
  Server(const ServerConfig& config, std::vector<ServedScene> scenes);

  /// Returns the bytes of the answer to `from` in `out` (512 needed), 0 = none; to an address that has not
  /// been proven never more than came in. With `clock` the reply carries the time taken here as hold time;
  /// without, it counts as none. `standing`: what the channel of this datagram vouches for; a command that
  /// may not operate is answered, but moves nothing. `superseded`: a newer one of the same sender waits, and
  /// the server is behind: a command is answered, and its motion is left to that one, unless it says other
  /// flags than the last.
  std::size_t on_datagram(std::span<const std::uint8_t> bytes, const net::Address& from, std::int64_t now_ns,
                          std::span<std::uint8_t> out, const rt::Clock* clock = nullptr,
                          const net::Standing& standing = {}, bool superseded = false) noexcept;

  /// ServerConfig::steps_at_once from the next datagram on; 0: logged steps wait. For who replays a session,
  /// and knows what each datagram had executed.
  void set_steps_at_once(std::size_t most) noexcept { config_.steps_at_once = most; }
  /// Likewise (server_replay.cpp): steps of this session that have come, however many, without a datagram;
  void bring_steps(std::uint64_t session_id, const link::StepBatch& steps, std::int64_t now_ns,
                   std::uint32_t hold = 0) noexcept;
  /// the shared tip is this session's, if nobody has it;
  void hold_tip(std::uint64_t session_id, std::int64_t now_ns) noexcept;
  /// up to `most` of them are made now;
  void make_steps(std::uint64_t session_id, std::size_t most, std::int64_t now_ns) noexcept;
  /// the slave is in this state (slave::Slave::save), after the steps of `log`, of which `last` is the last
  /// one (null: not known), `others`: of a shared tip that another session has moved last. False: it is no such
  /// state; then the slave is as a new one;
  bool take_up(std::uint64_t session_id, std::span<const std::uint8_t> state, const link::StepReport& log,
               const link::LoggedStep* last, bool others = false) noexcept;
  /// this session's part of a shared tip's account, which no state holds.
  void set_account(std::uint64_t session_id, double in_aj, double out_aj) noexcept;

  /// So many commands were answered in so much processor time of the loop.
  void note_load(std::int64_t taken_ns, std::uint64_t exchanges) noexcept { load_.note(taken_ns, exchanges); }
  const LoadEstimate& load() const noexcept { return load_; }

  /// Executes logged steps that waited, of one session, as far as it may now. True: look at the sockets and
  /// call it again; false: none may be made at present.
  bool catch_up(std::int64_t now_ns) noexcept;
  /// Time-outs: retracts the slaves of silent sessions, forgets old ones. Call it every few milliseconds.
  void poll(std::int64_t now_ns) noexcept;

  /// A slave may move without commands: poll() is to be called each tick.
  bool retracts() const noexcept { return table_.occupied() > table_.active() || withdrawing_; }

  /// Shutting down: from now on Hellos are refused, and commands answered by a Bye; call until it returns 0,
  /// sending each Bye to `to`. poll() goes on retracting.
  std::size_t next_bye(std::int64_t now_ns, std::span<std::uint8_t> out, net::Address& to) noexcept;
  /// No slave is on its way up.
  bool at_rest() const noexcept;

  const link::DropCounters& drops() const noexcept { return drops_; }
  const ServerCounters& counters() const noexcept { return counters_; }
  const link::SessionTable& sessions() const noexcept { return table_; }
  const TipHolder& tip_holder() const noexcept { return holder_; }  ///< of Share::kOneTip
  /// Of the commands for which there was a clock.
  const ServiceTimes& service_times() const noexcept { return service_; }

 private:
  std::size_t drop(link::DropCause cause) noexcept;
  std::size_t logging_slot(std::uint64_t session_id) noexcept;
  void charge_opening(OpeningBudget& party, std::int64_t begin_ns) noexcept;
  OpeningBudget& party_opening(const net::Address& from, const net::Standing& standing) noexcept;
  std::size_t on_hello(const link::Hello& hello, const net::Address& from, std::int64_t now_ns,
                       std::span<std::uint8_t> out, const net::Standing& standing) noexcept;
  link::HelloVerdict judge(const link::Hello& hello, const net::Address& from, std::int64_t now_ns,
                           const net::Standing& standing) noexcept;
  void open(std::size_t slot) noexcept;
  void resume(std::size_t slot) noexcept;
  AuditEvent audit_event(AuditEvent::Kind kind, std::size_t slot, std::int64_t now_ns) const noexcept;
  void audit(AuditEvent::Kind kind, std::size_t slot, std::int64_t now_ns, std::uint32_t reason = 0) noexcept;
  void audit_refusal(link::RefuseReason reason, const net::Address& from, const net::Standing& standing,
                     std::int64_t now_ns) noexcept;
  void audit_faults(std::size_t slot, std::uint32_t faults, std::int64_t now_ns) noexcept;
  void audit_holder(std::size_t before, std::int64_t now_ns) noexcept;
  std::uint64_t party_of(const net::Address& from, std::uint64_t owner) const noexcept;
  std::size_t on_command(const link::Command& command, const net::Address& from, std::int64_t now_ns,
                         std::span<std::uint8_t> out, const rt::Clock* clock) noexcept;
  std::size_t on_scene_request(const link::SceneRequest& request, const net::Address& from,
                               std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;
  void on_bye(const link::Bye& bye, const net::Address& from, std::int64_t now_ns) noexcept;
  std::size_t welcome(std::size_t slot, std::uint64_t nonce, std::span<std::uint8_t> out) noexcept;
  bool shared() const noexcept { return config_.share == Share::kOneTip; }
  Tip& tip_of(std::size_t slot) noexcept { return tips_[shared() ? 0 : slot]; }
  /// In this scene. False: there is no slave; what was there is gone.
  bool make_tip(std::size_t slot, std::size_t scene, std::int64_t now_ns) noexcept;
  std::size_t on_scene_list_request(const link::SceneListRequest& request, const net::Address& from,
                                    std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;
  std::size_t on_scene_switch(const link::SceneSwitch& wish, const net::Address& from, std::int64_t now_ns,
                              std::span<std::uint8_t> out) noexcept;
  /// False: the other scene has no slave now, and nothing has changed.
  bool switch_scene(std::size_t slot, std::size_t scene, std::uint64_t nonce, std::int64_t now_ns) noexcept;
  /// Why a request beside the commands is not this session's; kNone: it is.
  link::DropCause why_not_own(std::size_t slot, const net::Address& from,
                              std::uint64_t feature) const noexcept;
  void note_address(std::size_t slot, const net::Address& from, std::int64_t now_ns) noexcept;
  std::size_t on_unusable_command(const link::Command& command, link::DropCause cause, std::size_t slot,
                                  std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;
  void share_tip(std::size_t slot, const link::Command& command, std::int64_t now_ns) noexcept;
  bool is_anchored(std::size_t slot, std::uint32_t hold) const noexcept;
  void begin_holding(std::size_t slot) noexcept;
  /// Steps the tip of `slot` by one command, and by those before it that it repeats.
  void move_tip(std::size_t slot, const link::Command& command, const link::RecentCommands& recent,
                std::int64_t now_ns) noexcept;
  /// Returns the work that it was; about `work_most` at most.
  double move_tip_once(std::size_t slot, const link::Command& command, double spacing_s, bool may_operate,
                       double work_most) noexcept;
  struct PartyWork {
    std::uint64_t party = 0;
    std::int64_t used_ns = INT64_MIN;
    WorkBudget work;
  };
  PartyWork& party_work(std::size_t slot) noexcept;
  bool within_rate(std::size_t slot, const net::Address& from, std::int64_t now_ns) noexcept;
  void begin_rate(std::size_t slot) noexcept;
  double active_hz() const noexcept;
  /// The wish to take marks back, if this command has one; the fault bits of its reply.
  std::uint32_t undo(std::size_t slot, const link::Command& command) noexcept;
  double work_left(std::size_t slot, std::int64_t now_ns) noexcept;
  void take_work(std::size_t slot, double work) noexcept;
  std::size_t on_snapshot_request(const link::SnapshotRequest& request, const net::Address& from,
                                  std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;
  void begin_log(std::size_t slot) noexcept;
  link::StepReport step_report(std::size_t slot) noexcept;
  void run_log(std::size_t slot, std::size_t most, std::int64_t now_ns) noexcept;
  void move_by_log(std::size_t slot, const link::Command& command, std::int64_t now_ns) noexcept;
  void take_overtaken_steps(std::size_t slot, const link::Command& command, std::int64_t now_ns) noexcept;
  void end(std::size_t slot, link::ByeReason reason, std::int64_t now_ns) noexcept;
  void leave_tip(std::size_t slot, std::int64_t now_ns) noexcept;
  void forget(std::size_t slot, std::int64_t now_ns) noexcept;
  void withdraw_shared_tip(std::int64_t now_ns) noexcept;
  void retract(Tip& tip, PortControl* control, std::int64_t now_ns) noexcept;

  /// Pieces of a scene, and of a slave's state, that a session may have at once.
  static constexpr double kPiecesBurst = 64;

  ServerConfig config_;
  /// A scene, and what its first slave has shown of it.
  struct Offered {
    ServedScene scene;
    std::unique_ptr<slave::Slave> spare;  ///< that slave: who comes first does not wait
    slave::SlaveLimits limits;
    std::uint64_t feature_bits = 0;
  };
  static std::vector<Offered> offered(const ServerConfig& config, std::vector<ServedScene> scenes);
  const Offered& scene_of(std::size_t slot) const noexcept { return scenes_[records_[slot].scene]; }

  std::vector<Offered> scenes_;  ///< at least one; a session begins in the first
  link::SessionTable table_;
  link::ServerHandshake handshake_;
  link::Codec codec_;
  link::Incoming incoming_;
  std::vector<Tip> tips_;  ///< one a slot, or the one that all share
  std::vector<SessionRecord> records_;
  std::vector<PartyWork> parties_;   ///< more than there can be sessions: who is in use is never forgotten
  std::vector<std::size_t> behind_;  ///< slots whose log has steps that wait for their turn, each once
  std::vector<char> is_behind_;      ///< by slot: it is there
  std::size_t next_behind_ = 0;      ///< whose turn it is there
  std::size_t active_parties_ = 0;   ///< that have commanded within a second
  TipHolder holder_;
  bool withdrawing_ = false;  ///< the shared tip
  LoadEstimate load_;
  OpeningBudget openings_;
  std::vector<OpeningBudget> party_openings_;  ///< of the party whose number falls there
  const rt::Clock* clock_ = nullptr;           ///< of the datagram at hand; may be null
  bool shutting_down_ = false;
  net::Standing standing_;        ///< of the datagram at hand
  std::int64_t now_ns_ = 0;       ///< its time, or that of poll()
  bool superseded_ = false;       ///< it is
  std::uint32_t last_flags_ = 0;  ///< of the last step of a log that was executed
  link::TokenBucket scene_chunks_;
  link::SceneChunk chunk_;
  link::DropCounters drops_;
  ServerCounters counters_;
  ServiceTimes service_;
};

}  // namespace telenano::server

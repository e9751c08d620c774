#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/drop_cause.h"
#include "telenano/common/link/link_quality.h"
#include "telenano/common/link/link_stats.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/received_energy.h"
#include "telenano/common/link/recent_commands.h"
#include "telenano/common/link/sequence_window.h"
#include "telenano/common/link/snapshot.h"
#include "telenano/common/link/step_log.h"

namespace telenano::link {

struct ClientConfig {
  std::uint32_t rate_hz = 1000;
  std::uint32_t version_min = kProtocolVersion;
  std::uint32_t version_max = kProtocolVersion;
  std::uint64_t feature_bits = kKnownFeatures;  ///< asked for; less than all is for tests of old peers
  std::uint64_t nonce_seed = 1;                 ///< random in a program, fixed in a test
  std::uint64_t resume_token = 0;               ///< of an earlier run; 0 = none
  std::int64_t hello_first_ns =
      100'000'000;  ///< wait for an answer before the second Hello; doubles each time
  std::int64_t hello_last_ns = 1'000'000'000;  ///< up to this
  /// With a command unanswered and no new reply for this long (or, if longer, for twice what the link's round
  /// trips explain) the server counts as lost and the session is resumed. While the station itself stands
  /// still there is nothing to answer: that is not the server's silence.
  std::int64_t silence_ns = 200'000'000;
  /// Commands that each datagram repeats, at most 4; 0: none, and the feature is not asked for.
  std::size_t redundancy = 0;
  /// Steps that are kept until the server has executed them (step_log.h); 0: the log is not asked for.
  std::size_t step_ring = 0;
  /// Largest state of the slave that may be fetched; 0: none.
  std::size_t snapshot_bytes = 0;
};

/// idle → hello_sent → challenged → established ⇄ lost → …; closed and refused are final until start().
enum class ClientState : std::uint8_t {
  kIdle,
  kHelloSent,
  kChallenged,
  kEstablished,
  kLost,
  kClosed,
  kRefused
};

const char* name(ClientState state) noexcept;

/// What became of the last switch_scene().
enum class SceneSwitching : std::uint8_t {
  kNone,
  kAsked,    ///< and not answered yet
  kDone,     ///< the newest Welcome is the other scene's
  kRefused,  ///< refuse() says why
};

enum class ClientEvent : std::uint8_t {
  kNone,
  kDropped,
  kReply,
  kChallenge,
  kWelcome,
  kRefused,
  kBye,
  kPiece,
  kSceneChunk,     ///< in incoming(): of the scene that the newest Welcome offers, of its right size
  kSceneEntry,     ///< in incoming(): a line of the server's list of scenes
  kSwitchRefused,  ///< in refuse(): the server stays at the scene
};

/// The station's end of a session, sans-IO: datagrams and times go in, datagrams come out, in every tick:
///
///   while (socket has a datagram)              session.on_datagram(bytes, now_ns);
///   if (n = session.poll(now_ns, out))         send(out.first(n));          // handshake, at most one a call
///   if (n = session.make_command(c, now, out)) send(out.first(n));          // 0 while there is no session
///
/// A silent, restarted or replaced server needs no help: the session goes to kLost, says Hello with its
/// resume token, and comes back to kEstablished, in the same epoch if the slave is still the same one.
/// Nothing allocates after construction, nothing throws.
class ClientSession {
 public:
  explicit ClientSession(const ClientConfig& config);

  void start(std::int64_t now_ns) noexcept;
  /// Says Hello from now on, as after the server's silence; the session that there is goes on meanwhile.
  void resume(std::int64_t now_ns) noexcept;
  /// What the handshake has to send now: bytes written to `out` (512 needed), 0 = nothing.
  std::size_t poll(std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;
  ClientEvent on_datagram(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept;
  /// The caller sets flags, velocity, position, its running energy totals (which may not go down) and, for a
  /// method that needs it, `control`, with running totals likewise; the session sets the rest, and encodes.
  /// On return `command` is what was sent: totals and the wave's sum count from this session's Welcome, and
  /// `control` is empty where the feature was not agreed.
  std::size_t make_command(Command& command, std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;
  /// From now on a datagram repeats at most so many commands, and never more than the config's redundancy.
  void repeat_at_most(std::size_t commands) noexcept { repeats_ = commands; }
  /// Is there a log of steps in this session? Then nothing but steps moves the slave.
  bool logs_steps() const noexcept { return (features() & kFeatureStepLog) != 0; }
  /// Number that the next step gets.
  std::uint64_t next_step() const noexcept { return steps_.next(); }
  /// A step of this tick, to be sent with the next command.
  void add_step(const LoggedStep& step) noexcept { steps_.add(step); }
  /// Do steps ask for a datagram, whatever the pace?
  bool steps_are_urgent(std::int64_t now_ns) noexcept { return steps_.urgent(now_ns, step_wait_ns()); }
  const StepSender& steps() const noexcept { return steps_; }
  /// Begins to fetch the slave's state as it is when the server hears of it.
  void ask_snapshot() noexcept { snapshot_.start(); }
  void drop_snapshot() noexcept { snapshot_.stop(); }
  void set_snapshot_pace(double per_s) noexcept { snapshot_.set_pace(per_s); }
  /// How large it may be, where that is known only once there is a session; before the first step. Allocates.
  void make_room_for_snapshot(std::size_t bytes_max) { snapshot_ = SnapshotFetch(bytes_max); }
  const SnapshotFetch& snapshot() const noexcept { return snapshot_; }
  /// The next request for it; 0: none now.
  std::size_t make_snapshot_request(std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;

  /// Asks for a piece of the scene that the newest Welcome offers; 0 while there is no session, or no such
  /// piece. Asking is no sign of life: commands go on beside it.
  std::size_t make_scene_request(std::uint32_t chunk, std::span<std::uint8_t> out) noexcept;
  /// Asks for a line of the server's list of scenes; 0 while there is no session, or the server has one scene.
  std::size_t make_scene_list_request(std::uint32_t index, std::span<std::uint8_t> out) noexcept;
  /// Asks for another scene from now on, by poll(), until there is an answer: a Welcome of exactly that scene, with
  /// another slave in a new epoch, or a refusal. What is on its way to the slave before moves nothing any more. False:
  /// there is no session, or the server has one scene.
  bool switch_scene(std::uint64_t scene_hash, std::int64_t now_ns) noexcept;
  /// Asks no more. If it has been done nevertheless, the session is found lost, and is resumed at that scene.
  void forget_switch() noexcept {
    switch_nonce_ = 0;
    switching_ = SceneSwitching::kNone;
  }
  SceneSwitching scene_switching() const noexcept { return switching_; }
  /// Ends the session (state kClosed). Not answered; send it two or three times if it matters.
  std::size_t make_bye(ByeReason reason, std::span<std::uint8_t> out) noexcept;

  ClientState state() const noexcept { return state_; }
  /// May commands be sent? In kLost too, unless the server has said that the session is gone.
  bool has_session() const noexcept { return session_alive_; }
  const Welcome& welcome() const noexcept { return welcome_; }
  std::uint64_t features() const noexcept { return welcome_.feature_bits; }  ///< agreed; 0 before a Welcome
  std::uint64_t sessions() const noexcept { return sessions_; }  ///< Welcomes accepted since the construction
  /// Has the newest Welcome resumed, by a token of an earlier run (ClientConfig), a session whose account this
  /// object has not seen?
  bool resumed_unknown_account() const noexcept { return unknown_account_; }
  std::uint64_t resume_token() const noexcept { return resume_token_; }  ///< of the newest Welcome
  /// Set by a Welcome whose epoch is not the last one's: the slave and its energy account are new ones.
  bool epoch_changed() const noexcept { return epoch_changed_; }
  void clear_epoch_changed() noexcept { epoch_changed_ = false; }

  bool has_reply() const noexcept { return has_reply_; }  ///< of this session id
  const Reply& reply() const noexcept { return reply_; }  ///< the newest one accepted
  std::int64_t reply_time_ns() const noexcept {
    return reply_time_ns_;
  }  ///< when it came: the force's age counts from here
  /// The datagram just taken was a reply that a newer one had overtaken (dropped as stale): for a play-out
  /// buffer that has not come to it yet. Null otherwise; valid until the next datagram.
  const Reply* overtaken_reply() const noexcept { return overtaken_ ? &incoming_.reply : nullptr; }
  /// The datagram just taken: what it was (kNone: could not be decoded) and why it was dropped (kNone: it was
  /// not).
  const Incoming& incoming() const noexcept { return incoming_; }
  DropCause last_drop() const noexcept { return last_drop_; }
  const ReceivedEnergy& slave_energy_aj() const noexcept { return slave_energy_; }

  /// The newest one; valid in kRefused and after kSwitchRefused.
  const Refuse& refuse() const noexcept { return refuse_; }
  ByeReason bye_reason() const noexcept { return bye_reason_; }  ///< of the last Bye received
  std::int64_t state_since_ns() const noexcept { return state_since_ns_; }
  std::uint32_t hellos_sent() const noexcept { return hellos_sent_; }  ///< of the present attempt

  const SequenceWindow& replies() const noexcept { return replies_; }
  /// Everything that is known of the link, for those who watch it.
  LinkQuality quality(std::int64_t now_ns) const noexcept;
  const LinkStats& stats() const noexcept { return stats_; }
  const DropCounters& drops() const noexcept { return drops_; }
  std::uint64_t commands_sent() const noexcept { return command_sequence_; }  ///< of this session id

 private:
  void set_state(ClientState state, std::int64_t now_ns) noexcept;
  void count(LinkQuality& quality) const noexcept;
  void new_attempt(std::int64_t now_ns) noexcept;
  std::int64_t silence_limit_ns() const noexcept;
  std::int64_t step_wait_ns() const noexcept;
  ClientEvent drop(DropCause cause) noexcept;
  ClientEvent on_challenge(const Challenge& challenge, std::int64_t now_ns) noexcept;
  ClientEvent on_welcome(const Welcome& welcome, std::int64_t now_ns) noexcept;
  ClientEvent on_refuse(const Refuse& refuse, std::int64_t now_ns) noexcept;
  ClientEvent on_reply(const Reply& reply, std::int64_t now_ns) noexcept;
  ClientEvent on_bye(const Bye& bye, std::int64_t now_ns) noexcept;
  ClientEvent on_scene_chunk(const SceneChunk& chunk) noexcept;
  ClientEvent on_scene_entry(const SceneListEntry& entry) noexcept;
  std::uint64_t next_nonce() noexcept;
  std::size_t poll_switch(std::int64_t now_ns, std::span<std::uint8_t> out) noexcept;

  ClientConfig config_;
  Codec codec_;
  Incoming incoming_;
  ClientState state_ = ClientState::kIdle;
  std::int64_t state_since_ns_ = 0;

  // The handshake under way; nonce 0 = none.
  std::uint64_t nonce_counter_ = 0;
  std::uint64_t nonce_ = 0;
  std::uint64_t cookie_ = 0;
  std::uint64_t resume_token_ = 0;
  std::uint32_t hellos_sent_ = 0;
  std::int64_t attempt_start_ns_ = 0;
  std::int64_t next_hello_ns_ = 0;
  std::int64_t backoff_ns_ = 0;

  // The scene that was asked for; nonce 0 = none.
  SceneSwitching switching_ = SceneSwitching::kNone;
  std::uint64_t switch_nonce_ = 0;
  std::uint64_t switch_hash_ = 0;
  std::int64_t switch_start_ns_ = 0;
  std::int64_t next_switch_ns_ = 0;
  std::int64_t switch_backoff_ns_ = 0;

  // The session.
  bool session_alive_ = false;
  Welcome welcome_;
  std::uint64_t sessions_ = 0;
  bool epoch_changed_ = false;
  bool unknown_account_ = false;
  std::int64_t handshake_ns_ = 0;  ///< an upper bound of the round trip, before there are replies
  std::uint64_t command_sequence_ = 0;
  bool has_energy_base_ = false;
  double energy_base_in_j_ = 0;
  double energy_base_out_j_ = 0;
  PortControl control_base_;
  bool has_reply_ = false;
  Reply reply_;
  std::int64_t welcome_time_ns_ = 0;
  std::int64_t reply_time_ns_ = 0;
  std::int64_t last_news_ns_ = 0;
  bool waits_ = false;  ///< a command is not answered yet, nor a later one
  std::int64_t waits_since_ns_ =
      0;  ///< the last reply, or the first command after one that left nothing open
  SequenceWindow replies_;
  bool overtaken_ = false;
  SentCommands sent_;
  RecentCommands recent_;
  std::size_t repeats_ = kMaxRecent;
  StepSender steps_;
  SnapshotFetch snapshot_;
  std::array<std::uint8_t, kStepsBytesMost> step_bytes_{};
  LinkQuality past_;  ///< counts of the sessions before this one
  ReceivedEnergy slave_energy_;
  Refuse refuse_;
  ByeReason bye_reason_ = ByeReason::kDone;

  LinkStats stats_;
  DropCounters drops_;
  DropCause last_drop_ = DropCause::kNone;
};

}  // namespace telenano::link

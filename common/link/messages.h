#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "telenano/common/base/vec3.h"

/// The messages of the Telenano protocol, version 1, as plain structs. PROTOCOL.md is normative;
/// telenano.proto is their form on the wire; only the codec sees both.
namespace telenano::link {

inline constexpr std::uint8_t kProtocolVersion = 1;
inline constexpr std::size_t kMaxDatagramBytes = 512;
inline constexpr std::size_t kSceneNameBytes = 48;
inline constexpr std::size_t kSceneChunkBytes = 464;  ///< of a scene's bundle in one datagram

/// What may be agreed on beyond the fields that every session has. A session has a feature if the station's
/// Hello asks for it and the server's Welcome grants it; without, its fields are never sent.
enum FeatureBits : std::uint64_t {
  kFeaturePortControl = 1u << 0,     ///< PortControl in Command, PortAnswer in Reply
  kFeatureLocalModel = 1u << 1,      ///< LocalModel in Reply
  kFeatureSharing = 1u << 2,         ///< one tip for all sessions: tip_hold in Command, TipShare in Reply
  kFeatureRedundancy = 1u << 3,      ///< RecentCommands with Command (recent_commands.h)
  kFeatureStepHistory = 1u << 4,     ///< Reply::steps_before
  kFeatureParticle = 1u << 5,        ///< Particle in Reply
  kFeatureWell = 1u << 6,            ///< Welcome::well_aj
  kFeatureScene = 1u << 7,           ///< Welcome::scene, SceneRequest, SceneChunk
  kFeatureStepLog = 1u << 8,         ///< StepBatch with Command (step_log.h), StepReport in Reply and Welcome
  kFeatureSharedLog = 1u << 9,       ///< steps of one datagram belong to its tip_hold: a log at a shared tip
  kFeatureReplyDeadband = 1u << 10,  ///< ReplyDeadband in Command, Reply::replies_left_out
  kFeatureUndo = 1u << 11,           ///< kFlagUndo in Command, kFaultUndo in Reply
  kFeatureSceneSwitch = 1u << 12,    ///< SceneListRequest, SceneListEntry, SceneSwitch
};
inline constexpr std::uint64_t kKnownFeatures =
    kFeaturePortControl | kFeatureLocalModel | kFeatureSharing | kFeatureRedundancy | kFeatureStepHistory |
    kFeatureParticle | kFeatureWell | kFeatureScene | kFeatureStepLog | kFeatureSharedLog |
    kFeatureReplyDeadband | kFeatureUndo | kFeatureSceneSwitch;

/// Why the slave's state is not what the log of steps says.
enum StepBreak : std::uint32_t {
  kBreakNone = 0,
  kBreakGap = 1,      ///< steps were missing for longer than the time-out
  kBreakStop = 2,     ///< a stop did not wait for steps that were missing
  kBreakRight = 3,    ///< steps without the right to operate: they moved nothing
  kBreakSilence = 4,  ///< the slave withdrew by itself: the session was silent
  kBreakShare = 5,    ///< steps waited too long for the session's share of the server: left out
  kBreakHolder = 6,   ///< of a shared tip: this session's holding begins, and others have moved it before
  kBreakUndo = 7,     ///< the last stroke of marks was taken back
};

/// How far the server has executed the log of steps. Behind kFeatureStepLog; all zero without it.
struct StepReport {
  std::uint64_t executed = 0;      ///< the last step, and all before it; 0: none
  std::uint64_t state_hash = 0;    ///< of the slave after it; 0: not known
  std::uint64_t newest = 0;        ///< that has come; above `executed` steps are missing, or wait
  std::uint32_t breaks = 0;        ///< declared so far in this epoch
  std::uint32_t break_reason = 0;  ///< StepBreak, of the last one
  std::uint64_t break_step = 0;    ///< of the last one: from there on the log says what is executed again

  bool empty() const noexcept {
    return executed == 0 && state_hash == 0 && newest == 0 && breaks == 0 && break_reason == 0 &&
           break_step == 0;
  }
  friend bool operator==(const StepReport&, const StepReport&) = default;
};

/// A short text of fixed capacity, zero-padded, so that messages never allocate.
struct SceneName {
  std::array<char, kSceneNameBytes> text{};
  friend bool operator==(const SceneName&, const SceneName&) = default;
};

/// Station → server: asks for a session. Sent again, with the cookie, after a Challenge. Padded by the codec
/// so that no answer is larger than the question (amplification <= 1).
struct Hello {
  std::uint32_t version_min = kProtocolVersion;
  std::uint32_t version_max = kProtocolVersion;
  std::uint64_t feature_bits = 0;
  std::uint64_t nonce = 0;         ///< chosen by the station for this attempt, echoed in every answer
  std::uint64_t cookie = 0;        ///< from Challenge; 0 = none yet
  std::uint64_t resume_token = 0;  ///< from an earlier Welcome; 0 = a new session
  std::uint32_t rate_hz = 1000;    ///< rate at which commands will be sent
};

/// Server → station: prove that you receive at this address. The server keeps no state for it.
struct Challenge {
  std::uint64_t nonce = 0;
  std::uint64_t cookie = 0;
};

/// The bundle that the server's scene can be fetched as. Behind kFeatureScene; all zero: none.
struct SceneOffer {
  std::array<std::uint64_t, 4> hash{};  ///< SHA-256 of the bundle, eight bytes a number, little-endian
  std::uint32_t bytes = 0;              ///< of the bundle
  std::uint64_t canonical_motion = 0;   ///< what the server's own physics make of it

  bool empty() const noexcept { return bytes == 0 && hash == decltype(hash){} && canonical_motion == 0; }
  std::uint64_t name() const noexcept { return hash[0]; }  ///< short enough for each request and chunk
  std::uint32_t chunks() const noexcept {
    return static_cast<std::uint32_t>((std::uint64_t{bytes} + kSceneChunkBytes - 1) / kSceneChunkBytes);
  }
  /// 0: there is no such chunk.
  std::size_t chunk_bytes(std::uint32_t chunk) const noexcept {
    const std::uint64_t at = std::uint64_t{chunk} * kSceneChunkBytes;
    if (at >= bytes) return 0;
    return bytes - at < kSceneChunkBytes ? static_cast<std::size_t>(bytes - at) : kSceneChunkBytes;
  }
  friend bool operator==(const SceneOffer&, const SceneOffer&) = default;
};

/// Server → station: a session, the slave's limits and where the tip is.
struct Welcome {
  std::uint32_t version = kProtocolVersion;
  std::uint64_t feature_bits = 0;
  std::uint64_t nonce = 0;
  std::uint64_t session_id = 0;
  std::uint64_t resume_token = 0;
  std::uint32_t epoch = 0;       ///< of the slave's energy account; a new epoch grants no new allowance
  std::uint32_t timeout_ms = 0;  ///< silence after which the slave retracts and forgets the session
  std::uint32_t slave_rate_max_hz = 0;
  SceneName scene_name;
  std::uint64_t scene_hash = 0;
  Vec3 workspace_min_w_nm = Vec3::Zero();
  Vec3 workspace_max_w_nm = Vec3::Zero();
  Vec3 start_pos_w_nm = Vec3::Zero();  ///< commanded tip position at which the session starts
  double surface_z_w_nm = 0;  ///< height of the surface under the start position (tip apex at contact)
  double force_max_nn = 0;    ///< the slave's own force limit
  double coupling_stiffness_n_m =
      0;  ///< largest stiffness that the port can show: coupling in series with probe
  double coupling_damping_n_s_m = 0;
  double stiffness_min_n_m = 0;  ///< most negative slope of the slave's port that is stable (informative)
  /// Behind kFeatureWell: most that the sample can give out of its own (adhesion, attraction), beyond what
  /// was ever put in; >= 0.
  double well_aj = 0;
  StepReport steps;  ///< behind kFeatureStepLog: where the log goes on
  SceneOffer scene;
};

enum class RefuseReason : std::uint32_t {
  kVersion = 1,
  kFull = 2,
  kRate = 3,
  kShuttingDown = 4,
  kScene = 5  ///< of a SceneSwitch: there is no such scene, or it cannot be made
};

/// Server → station: no session, and why.
struct Refuse {
  std::uint64_t nonce = 0;
  RefuseReason reason = RefuseReason::kVersion;
  std::uint32_t version_min = kProtocolVersion;
  std::uint32_t version_max = kProtocolVersion;
};

enum CommandFlags : std::uint32_t {
  kFlagClutch = 1u << 0,   ///< engaged: the slave follows; clear: the slave holds its commanded position
  kFlagDeadman = 1u << 1,  ///< held by the operator; clear: the slave holds
  kFlagStop = 1u << 2,     ///< latched stop: the slave retracts
  // Behind kFeatureSharing.
  kFlagTakeOver = 1u << 3,  ///< asks for the tip; what counts is that it becomes set
  kFlagHandOver = 1u << 4,  ///< gives the tip up, or does not want it
  // Behind kFeatureUndo.
  kFlagUndo = 1u << 5,  ///< asks to take back the last stroke of marks; what counts is that it becomes set
};

/// The control method that a station runs, as the wire numbers it: those of control::Method.
enum PortMethod : std::uint32_t {
  kMethodNone = 0,
  kMethodKs = 1,
  kMethodKsClamp = 2,
  kMethodTdpa = 3,
  kMethodWave = 4,
  kMethodTank = 5,
  kMethodModel = 6,
  kMethodTwin = 7  ///< behind kFeatureStepLog
};

/// Does the slave's port, with this method, weigh energies of the hand against its own?
constexpr bool needs_energy_scale(std::uint32_t method) noexcept {
  return method == kMethodTdpa || method == kMethodWave || method == kMethodTank;
}

/// What the slave's port has to do for the method at the station. Behind kFeaturePortControl; all zero: none.
struct PortControl {
  std::uint32_t method = kMethodNone;  ///< a PortMethod
  /// Energy at the tip that stands for a joule at the hand, α_v/α_F·1e18; >= 0, and > 0 with tdpa, wave,
  /// tank.
  double energy_scale_aj_j = 0;
  double energy_sent_j = 0;      ///< given to the slave so far, >= 0, monotone in a session, from its Welcome
  Vec3 wave_sum = Vec3::Zero();  ///< Σ u_i T of the outgoing wave u, √(aJ·s), frame W, from the Welcome
  double wave_energy_aj = 0;     ///< Σ u²T/2, >= 0, monotone in a session, from its Welcome
  double wave_impedance_n_s_m = 0;  ///< b_w as the tip feels it; >= 0, and > 0 with wave

  bool empty() const noexcept {
    return method == 0 && energy_scale_aj_j == 0 && energy_sent_j == 0 && wave_sum.isZero(0) &&
           wave_energy_aj == 0 && wave_impedance_n_s_m == 0;
  }
};

/// How much the force may differ from that of the last reply before another one is sent: the greater of the
/// two. Behind kFeatureReplyDeadband; all zero: every command is answered.
struct ReplyDeadband {
  std::uint32_t floor_pn = 0;           ///< on the tip, absolute
  std::uint32_t relative_permille = 0;  ///< of the force in the last reply, at most kPermilleMost
  static constexpr std::uint32_t kPermilleMost = 1000;

  bool empty() const noexcept { return floor_pn == 0 && relative_permille == 0; }
  friend bool operator==(const ReplyDeadband&, const ReplyDeadband&) = default;
};

/// Station → server, once a tick. Velocity streams, position anchors: loss causes no drift. Energies are
/// cumulative.
struct Command {
  std::uint64_t session_id = 0;
  std::uint64_t sequence = 0;      ///< from 1, never repeated in a session
  std::uint64_t send_time_ns = 0;  ///< station clock
  std::uint64_t newest_reply = 0;  ///< highest reply sequence accepted so far
  std::uint32_t epoch = 0;         ///< slave epoch that the station believes in
  std::uint32_t flags = 0;
  Vec3 tip_vel_w_nm_s = Vec3::Zero();  ///< commanded
  Vec3 tip_pos_w_nm = Vec3::Zero();    ///< commanded, cumulative
  double energy_in_j = 0;              ///< station port, put in by the hand so far, >= 0, monotone
  double energy_out_j = 0;             ///< station port, given to the hand so far, >= 0, monotone
  PortControl control;
  /// Behind kFeatureSharing: the holding of the tip (TipShare::hold) that tip_pos_w_nm is anchored to.
  std::uint32_t tip_hold = 0;
  ReplyDeadband reply_deadband;
};

enum class ContactState : std::uint32_t { kFree = 0, kVanDerWaals = 1, kNonContact = 2, kContact = 3 };

enum FaultBits : std::uint32_t {
  kFaultForceLimit = 1u << 0,     ///< the slave's force limit held the tip back
  kFaultWorkspace = 1u << 1,      ///< the commanded position was clamped to the workspace
  kFaultNonFinite = 1u << 2,      ///< a non-finite value was met; force is zero
  kFaultRetracted = 1u << 3,      ///< the slave is retracting or has retracted (time-out or stop)
  kFaultNoEquilibrium = 1u << 4,  ///< the solver did not converge; the last force was kept and the tip held
  kFaultStepLimit = 1u << 5,  ///< the commanded position moves faster than the slave allows; it follows late
  kFaultApproaching =
      1u << 6,  ///< with kFaultRetracted: the slave is bringing the tip back; no force until then
  /// The session has used up its share of the server: the tip follows late, and catches up as the share comes
  /// in. Nothing of the motion is lost.
  kFaultShare = 1u << 7,
  kFaultUndo = 1u << 8,  ///< behind kFeatureUndo: the last stroke of marks was not taken back, as asked
  kFaultUndoAnothers = 1u << 9,  ///< with that: since another session made it
};

/// What the slave's port says to the method at the station. Behind kFeaturePortControl; all zero: nothing.
struct PortAnswer {
  double energy_sent_aj = 0;     ///< given to the station so far, >= 0, monotone in an epoch
  Vec3 wave_sum = Vec3::Zero();  ///< Σ w_i T of the returning wave w, √(aJ·s), frame W, in this epoch
  double wave_energy_aj = 0;     ///< Σ w²T/2, >= 0, monotone in an epoch

  bool empty() const noexcept { return energy_sent_aj == 0 && wave_sum.isZero(0) && wave_energy_aj == 0; }
};

/// The contact around the tip as a plane, so that the station can render it at its own rate. Behind
/// kFeatureLocalModel.
struct LocalModel {
  std::uint32_t version = 0;       ///< 0 = there is none; another one whenever the model is another one
  Vec3 point_w_nm = Vec3::Zero();  ///< commanded position at which the port's force along the normal is 0
  Vec3 normal_w = Vec3::Zero();    ///< out of the sample; of length 1 within 1e-6, or 0 with version 0
  double stiffness_n_m = 0;        ///< of the port along the normal, >= 0
  double adhesion_nn = 0;          ///< pull at which the contact lets go, >= 0
  double shear_stiffness_n_m = 0;  ///< of the port across the normal, >= 0
  double friction_nn = 0;          ///< force across the normal at which it slips, >= 0

  bool empty() const noexcept {
    return version == 0 && point_w_nm.isZero(0) && normal_w.isZero(0) && stiffness_n_m == 0 &&
           adhesion_nn == 0 && shear_stiffness_n_m == 0 && friction_nn == 0;
  }
};

inline bool is_finite(const LocalModel& m) noexcept {
  return telenano::is_finite(m.point_w_nm) && telenano::is_finite(m.normal_w) &&
         std::isfinite(m.stiffness_n_m) && std::isfinite(m.adhesion_nn) &&
         std::isfinite(m.shear_stiffness_n_m) && std::isfinite(m.friction_nn);
}

/// Whose the one tip is. Behind kFeatureSharing; all zero without it.
struct TipShare {
  /// 0: this session observes. Else it holds the tip, and this is the number of the holding: a new one each
  /// time that the tip goes to somebody.
  std::uint32_t hold = 0;
  Vec3 pos_w_nm = Vec3::Zero();  ///< commanded position that the slave holds: where a new holder begins

  bool empty() const noexcept { return hold == 0 && pos_w_nm.isZero(0); }
};

/// How a particle lies, by what touches it.
enum class ParticleStatus : std::uint32_t {
  kRests = 0,   ///< on the sample, the tip does not touch it
  kPushed = 1,  ///< on the sample, the tip touches it: pushed, rolled, pressed
  kHeld = 2,    ///< off the sample, at the tip: picked up
  kLost = 3,    ///< neither touches it
};

/// The scene's nanoparticle, a sphere. Behind kFeatureParticle; all zero: not known, or none.
struct Particle {
  Vec3 pos_w_nm = Vec3::Zero();  ///< centre
  double radius_nm = 0;          ///< >= 0; 0: not known
  ParticleStatus status = ParticleStatus::kRests;

  bool empty() const noexcept {
    return pos_w_nm.isZero(0) && radius_nm == 0 && status == ParticleStatus::kRests;
  }
  friend bool operator==(const Particle& a, const Particle& b) noexcept {
    return a.pos_w_nm == b.pos_w_nm && a.radius_nm == b.radius_nm && a.status == b.status;
  }
};

inline bool is_finite(const Particle& p) noexcept {
  return telenano::is_finite(p.pos_w_nm) && std::isfinite(p.radius_nm);
}

/// Reply::measurement_age_ns of a slave that measures, but has not measured yet.
inline constexpr std::uint64_t kNeverMeasuredNs = UINT64_MAX;

/// Server → station, one for each accepted command.
struct Reply {
  std::uint64_t session_id = 0;
  std::uint64_t sequence = 0;              ///< from 1, never repeated in a session
  std::uint64_t command_sequence = 0;      ///< the command answered
  std::uint64_t command_send_time_ns = 0;  ///< echoed, station clock
  std::uint64_t server_time_ns = 0;        ///< server clock when sent
  std::uint64_t hold_time_ns = 0;          ///< between receiving the command and sending this
  std::uint64_t measurement_age_ns = 0;    ///< of the force when sent; 0: computed; kNeverMeasuredNs: not yet
  std::uint32_t epoch = 0;
  ContactState contact_state = ContactState::kFree;
  std::uint32_t fault_bits = 0;
  Vec3 force_w_nn = Vec3::Zero();    ///< on the tip
  Vec3 tip_pos_w_nm = Vec3::Zero();  ///< actual apex
  double deflection_nm = 0;          ///< of the cantilever, up positive
  double energy_in_aj = 0;           ///< slave port, put in by the command so far, >= 0, monotone per epoch
  double energy_out_aj = 0;          ///< slave port, given back so far, >= 0, monotone per epoch
  PortAnswer port;
  LocalModel model;
  TipShare tip;
  /// Bit i set: the command numbered command_sequence − 1 − i had come, and the slave had stepped by it.
  /// Behind kFeatureStepHistory: what a station must know to tell, or repeat, in which order the slave
  /// stepped when commands and replies were lost.
  std::uint64_t steps_before = 0;
  Particle particle;
  StepReport steps;
  /// Behind kFeatureReplyDeadband: replies of this session that were left out so far. They have no number.
  std::uint64_t replies_left_out = 0;
};

/// Of the slave's state in one datagram.
inline constexpr std::size_t kSnapshotPieceBytes = 432;

/// Station → server, behind kFeatureStepLog: asks for a piece of the slave's state.
struct SnapshotRequest {
  std::uint64_t session_id = 0;
  std::uint32_t snapshot = 0;  ///< the station's number for it, not 0; another one freezes the state anew
  std::uint32_t piece = 0;     ///< from 0
};

/// Server → station: that piece.
struct SnapshotPiece {
  std::uint64_t session_id = 0;
  std::uint32_t snapshot = 0;
  std::uint32_t piece = 0;
  std::uint64_t step = 0;        ///< the last one executed when it was frozen
  std::uint64_t state_hash = 0;  ///< then
  std::uint32_t breaks = 0;      ///< declared until then
  std::uint32_t total = 0;       ///< bytes of the state; 0: it cannot be had
  std::uint32_t size = 0;        ///< of `data`
  std::array<std::uint8_t, kSnapshotPieceBytes> data{};
};

/// Station → server, behind kFeatureScene: asks for a piece of the scene's bundle.
struct SceneRequest {
  std::uint64_t session_id = 0;
  std::uint64_t bundle = 0;  ///< SceneOffer::name
  std::uint32_t chunk = 0;   ///< from 0
};

/// Server → station: that piece.
struct SceneChunk {
  std::uint64_t session_id = 0;
  std::uint64_t bundle = 0;
  std::uint32_t chunk = 0;
  std::uint32_t size = 0;  ///< of `data`, 1 … kSceneChunkBytes
  std::array<std::uint8_t, kSceneChunkBytes> data{};
};

/// Station → server, behind kFeatureSceneSwitch: asks for one line of the list of scenes.
struct SceneListRequest {
  std::uint64_t session_id = 0;
  std::uint32_t index = 0;  ///< from 0
};

/// Server → station: that line.
struct SceneListEntry {
  std::uint64_t session_id = 0;
  std::uint32_t index = 0;       ///< below `count`
  std::uint32_t count = 0;       ///< scenes in the list, not 0
  std::uint64_t scene_hash = 0;  ///< as a Welcome to this scene has it; not 0
  SceneName scene_name;          ///< likewise; not empty
};

/// Station → server: this session on another scene. Answered by a Welcome or a Refuse with its nonce.
struct SceneSwitch {
  std::uint64_t session_id = 0;
  std::uint64_t nonce = 0;       ///< of this wish, as a Hello's
  std::uint64_t scene_hash = 0;  ///< of the scene that is wanted
};

enum class ByeReason : std::uint32_t {
  kDone = 1,
  kIdle = 2,
  kShuttingDown = 3,
  kStopped = 4,
  kUnknownSession = 5
};

/// Either way: the session ends. Not answered.
struct Bye {
  std::uint64_t session_id = 0;
  ByeReason reason = ByeReason::kDone;
};

enum class MessageType : std::uint8_t {
  kNone = 0,
  kHello = 1,
  kChallenge = 2,
  kWelcome = 3,
  kRefuse = 4,
  kCommand = 5,
  kReply = 6,
  kBye = 7,
  kSceneRequest = 8,
  kSceneChunk = 9,
  kSnapshotRequest = 10,
  kSnapshotPiece = 11,
  kSceneListRequest = 12,
  kSceneListEntry = 13,
  kSceneSwitch = 14
};

}  // namespace telenano::link

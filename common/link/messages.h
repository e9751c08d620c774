#pragma once

#include <array>
#include <cstdint>

#include "common/base/vec3.h"

/// The messages of the Telenano protocol, version 1, as plain structs. PROTOCOL.md is normative;
/// telenano.proto is their form on the wire; only the codec sees both.
namespace telenano::link {

inline constexpr std::uint8_t kProtocolVersion = 1;
inline constexpr std::size_t kMaxDatagramBytes = 512;
inline constexpr std::size_t kSceneNameBytes = 48;

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

/// Server → station: a session, the slave's limits and where the tip is.
struct Welcome {
  std::uint32_t version = kProtocolVersion;
  std::uint64_t feature_bits = 0;
  std::uint64_t nonce = 0;
  std::uint64_t session_id = 0;
  std::uint64_t resume_token = 0;
  std::uint32_t epoch = 0;       ///< of the slave's energy book; a new epoch grants no new allowance
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
};

enum class RefuseReason : std::uint32_t { kVersion = 1, kFull = 2, kRate = 3, kShuttingDown = 4 };

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
};

enum class ContactState : std::uint32_t { kFree = 0, kVanDerWaals = 1, kNonContact = 2, kContact = 3 };

enum FaultBits : std::uint32_t {
  kFaultForceLimit = 1u << 0,     ///< the slave's force limit held the tip back
  kFaultWorkspace = 1u << 1,      ///< the commanded position was clamped to the workspace
  kFaultNonFinite = 1u << 2,      ///< a non-finite value was met; force is zero
  kFaultRetracted = 1u << 3,      ///< the slave is retracting or has retracted (time-out or stop)
  kFaultNoEquilibrium = 1u << 4,  ///< the solver did not converge; the last force was kept and the tip held
  kFaultStepLimit = 1u << 5,  ///< the commanded position moves faster than the slave allows; it follows late
};

/// Server → station, one for each accepted command.
struct Reply {
  std::uint64_t session_id = 0;
  std::uint64_t sequence = 0;              ///< from 1, never repeated in a session
  std::uint64_t command_sequence = 0;      ///< the command answered
  std::uint64_t command_send_time_ns = 0;  ///< echoed, station clock
  std::uint64_t server_time_ns = 0;        ///< server clock when sent
  std::uint64_t hold_time_ns = 0;          ///< between receiving the command and sending this
  std::uint64_t measurement_age_ns = 0;    ///< age of the force when sent
  std::uint32_t epoch = 0;
  ContactState contact_state = ContactState::kFree;
  std::uint32_t fault_bits = 0;
  Vec3 force_w_nn = Vec3::Zero();    ///< on the tip
  Vec3 tip_pos_w_nm = Vec3::Zero();  ///< actual apex
  double deflection_nm = 0;          ///< of the cantilever, up positive
  double energy_in_aj = 0;           ///< slave port, put in by the command so far, >= 0, monotone per epoch
  double energy_out_aj = 0;          ///< slave port, given back so far, >= 0, monotone per epoch
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
  kBye = 7
};

}  // namespace telenano::link

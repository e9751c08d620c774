#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/common/control/method.h"
#include "telenano/common/link/playout.h"

namespace telenano::studies::stress {

/// What is behind the slave's port.
enum class SceneKind : std::uint8_t {
  kWall,         ///< a wall that can be computed by hand, 50 N/m (support::WallSlave)
  kOxide,        ///< deploy/scenes/flat_silicon_oxide.toml
  kPolystyrene,  ///< flat_polystyrene.toml
  kPdms,         ///< flat_pdms.toml
  kScan,         ///< flakes.toml, a real AFM scan
  kHard,         ///< the wall with 2000 N/m: harder than any coupling of a scene
  kMoist,        ///< humid_flakes.toml: capillary bridges with hysteresis
  kMarks,        ///< lithography.toml: marks that stay
  kParticle      ///< particle.toml
};
enum class HandKind : std::uint8_t {
  kPress,     ///< a firm arm that presses once, holds, lets go
  kPosition,  ///< tasks of Kim & Sitti, by the same arm
  kContact,
  kIndent,
  kRaster,
  kHuman,       ///< indent, with tremor (8–12 Hz) and a wandering aim
  kPassive,     ///< masses and springs without loss: arm of hand_a kg, resonance of hand_b Hz
  kSine,        ///< amplitude hand_a m, hand_b Hz, wherever that leads
  kSquare,      ///< in by hand_a m and out as fast as allowed, hand_b s a side
  kTelegraph,   ///< turns at random: range hand_a m, hand_b turns a second
  kGreedy,      ///< against the force at hand_a m/s, after hand_b s with it
  kWalk,        ///< a random walk below 20 Hz, range hand_a m
  kClimbWhite,  ///< hill climbing over the path, a point a sample; hand_a tries
  kClimbSlow,   ///< the same with points 25 ms apart (below 20 Hz)
  kPath         ///< `knots_m`, hand_b s apart
};
/// What a network that knows the state drops.
enum class Drops : std::uint8_t {
  kNone,
  kSpite,    ///< everything while the force goes with the hand: it takes out, and nobody hears of it
  kFlatter,  ///< replies while the sample pushes less than the hand feels: what is stale is too strong
  kStarve    ///< commands while the hand goes in: the slave does not know of what the hand pays for
};
enum class Restart : std::uint8_t { kNever, kFree, kContact, kSnapIn, kRandom };
/// What the operator does meanwhile (operator_acts.h).
enum class Act : std::uint8_t { kNone, kScale, kImpedance, kMethod, kClutch, kStop, kTask, kTakeOver };
inline constexpr std::size_t kActs = 7;  ///< besides kNone

/// Controllers, slaves and devices that are wrong on purpose (mutants.h).
enum class Mutant : std::uint8_t {
  kNone,
  kWrongIndex,
  kCreditedDamping,
  kMissingEpoch,
  kHeldWave,
  kUncappedDamper,
  kNoClamp,
  kDamperAfterClamp,
  kHalfVelocity,
  kFreeTank,
  kStickyForce,
  kLeapOnResume,
  kDoubleForce,
  kSlaveTooStrong,
  kFallingSums,
  kSlaveNoForce,
  kSlaveHalfForce,
  kSlaveLate,
  kSlaveNoAdhesion,
  kSlaveNoFriction,
  kSlaveTilted,
  kSlaveReversed,
  kSlaveSwapped,
  kSlaveLow,
  kSlaveSoft,
  kSlaveFrozen,
  kSlaveLeaky,
  kSlaveSticky,
  kSlaveCoarse,
  kSlaveNoisy,
  kSlaveSaturated,
  kSlaveUpsideDown,
  kForgivingChange,
  kGenerousChange,
  kSlaveStiff,
  kSlaveCreeping,
  kSlaveBlinking,
  kCodecSwapped,
  kCodecUnsigned,
  kCodecShort,
  kCodecKeepsFields,
  kSessionOldNews,
  kSessionOneEpoch,
  kSessionDeaf,
  kRecordLate,
  kRecordRendered,
  kRecordGaps,
  kRecordSingle,
  kRecordSwapped,
  kGateCreeping,
  kGateSilent,
  kGateForgetful,
  kGateBlind,
  kSlaveHoldsOn,
  kSlaveDrifts,
  kSlaveGivesUncounted,
  kSlaveTakesUncounted,
  kTwinHalf,
  kTwinLate,
  kTwinNoFriction,
  kTwinOneWay,
  kKsHalf,
  kClampHalf,
  kTdpaHalf,
  kWaveHalf,
  kRecordEnergy,
  kRecordForce,
  kStationHoldsClutch,
  kStationHoldsStop,
  kStationFar,
  kStationSwapped,
  kStationOldScale,
  kStationOldForce,
  kStationTooStiff,
  kSlaveSlow,
  kCommandCoarse,
  kCommandLate,
  kSlaveGoesBack,
  kStationNoTrip
};

/// One run, all of it: the same text gives the same bits on every machine.
struct RunSpec {
  control::Method method = control::Method::kModel;
  Mutant mutant = Mutant::kNone;
  SceneKind scene = SceneKind::kWall;
  HandKind hand = HandKind::kPress;
  Drops drops = Drops::kNone;
  Restart restart = Restart::kNever;
  Act act = Act::kNone;
  link::PlayoutConfig::Mode playout = link::PlayoutConfig::Mode::kNewest;

  double scale = 1;              ///< α_F over the one planned for this station, device and slave
  double velocity_scale = 1e-6;  ///< α_v
  double rate_hz = 1000;
  double seconds = 10;  ///< of motion; round trips are added, so that each is felt
  double hand_a = 0, hand_b = 0;
  double damping_n_s_m = 2;  ///< of the device, certain
  double quantum_m = 0;      ///< of the encoder

  double rtt_ms = 0;
  double jitter = 0;  ///< standard deviation over the one-way delay (of 2 ms at least); reorders
  double loss = 0;    ///< share of the time
  double burst_ms = 20;
  double duplicate = 0;
  double reorder = 0;
  double drift_ppm = 0;     ///< of the server's clock
  double leap_ms = 0;       ///< of the server's clock, at 3 s and 6 s
  double outage_ms = 0;     ///< both ways, from 2 s on and 3 s after the last
  double down_ms = 0;       ///< from the server's death to its restart
  double late = 0;          ///< share of ticks that come late …
  double late_periods = 0;  ///< … by up to so many periods
  double playout_ms = 20;   ///< from a command to when its reply is shown; adaptive: where it begins
  double redundancy = 0;    ///< commands that each datagram repeats: 0, 1, … link::kMaxRecent
  double deadband_nm = 0;   ///< of the commanded position: less is not sent
  double deadband_n = 0;    ///< of the force shown: less asks for no command
  double reply_permille =
      0;               ///< of the force: less than this share of it needs no reply; 0: every command has one
  double reply_n = 0;  ///< with that: nor does less than this, of the force shown
  double compand = 1;  ///< attraction before contact, up to so many times as strong
  std::uint64_t seed = 1;

  std::vector<double> knots_m{};  ///< of kPath: height over the ground
};

/// A field of the text form that is a number, with the range in which it makes sense.
struct NumberField {
  const char* key;
  double RunSpec::*value;
  double low, high;
  bool whole = false;  ///< a whole number
};
std::span<const NumberField> number_fields() noexcept;

std::string_view scene_kind_name(SceneKind kind) noexcept;
std::string_view hand_name(HandKind kind) noexcept;
std::string_view drops_name(Drops drops) noexcept;
std::string_view restart_name(Restart restart) noexcept;
std::string_view act_name(Act act) noexcept;
std::string_view playout_name(link::PlayoutConfig::Mode playout) noexcept;
std::string_view mutant_name(Mutant mutant) noexcept;
SceneKind parse_scene_kind(std::string_view name);  ///< throws UserError, as the others
Mutant parse_mutant(std::string_view name);
std::string scene_kind_names();
inline constexpr std::size_t kMutants = 78;  ///< besides kNone
std::array<Mutant, kMutants> all_mutants() noexcept;

/// "method=model scene=wall hand=press …": what differs from the defaults, and always the first three and the
/// seed. Numbers as short as they can be read back to the bit.
std::string to_text(const RunSpec& spec);
/// Throws UserError: one line that names the word that is wrong and what is expected.
RunSpec parse_run_spec(const std::string& text);

}  // namespace telenano::studies::stress

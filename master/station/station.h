#pragma once

#include <cstdint>
#include <memory>

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/energy_observer.h"
#include "telenano/common/control/methods.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/link/priced_energy.h"
#include "telenano/common/link/received_sums.h"
#include "telenano/common/link/snapshot.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/force_limits.h"
#include "telenano/master/station/sample_wells.h"
#include "telenano/master/station/scale_history.h"
#include "telenano/master/station/station_config.h"
#include "telenano/master/station/twin_run.h"
#include "telenano/master/station/workspace_mapping.h"

namespace telenano::station {

/// idle: no session. homing: the device is not calibrated, its positions mean nothing yet. ready: a session,
/// not engaged. engaged: the tip follows, forces are shown. held: replies have stopped coming while engaged,
/// force is zero, the tip target is frozen until they come again. stopped: latched. Stored in files: never
/// renumber.
enum class Mode : std::uint8_t { kIdle, kReady, kEngaged, kHeld, kStopped, kHoming };
const char* mode_name(Mode mode) noexcept;

/// Named faults; several may be set at once.
enum StationFaults : std::uint32_t {
  kFaultStopPressed = 1u << 0,       ///< latched
  kFaultVelocityTrip = 1u << 1,      ///< latched
  kFaultHandPosNonFinite = 1u << 2,  ///< latched: not finite or not believable (a jump of a metre)
  kFaultAppliedNonFinite = 1u << 3,  ///< latched: not finite or not believable (twice what the device can do)
  kFaultDeviceFailed = 1u << 4,      ///< latched
  kFaultReplyNonFinite = 1u << 5,    ///< that reply is ignored and the force ramps up again from zero
  kFaultForceNonFinite = 1u << 6,    ///< latched: own computation went wrong
  kFaultStale = 1u << 7,             ///< no new reply for longer than the hold time
  kFaultBadTick = 1u << 8,  ///< a tick without a positive, finite length: nothing was done but zero force
  kFaultSlaveStiffer = 1u << 9,  ///< latched: the new session's slave is stiffer than what was planned for
  kFaultOtherScene = 1u << 10,   ///< latched: the server that came back serves another scene
  kFaultOld = 1u << 11,  ///< replies come, but the round trip is longer than the method may show forces at
  kFaultTwinLeft = 1u << 12,  ///< the force fades: it was as stiff as only the twin may show it
};
/// Name of the lowest fault bit set; "none" if none.
const char* fault_name(std::uint32_t faults) noexcept;

/// The method itself, or the best one that can do without what the slave does not offer (feature bits of its
/// Welcome): `model` → `tank` → `ks-clamp`; `tdpa`, `wave`, `tank` → `ks-clamp`.
control::Method usable_method(control::Method wanted, std::uint64_t features) noexcept;

struct StationInput {
  std::int64_t time_ns = 0;  ///< of this tick, any origin
  device::DeviceStatus device_status = device::DeviceStatus::kOk;
  Vec3 hand_pos_h_m = Vec3::Zero();  ///< as the encoder sees it
  std::uint32_t buttons = 0;         ///< device::ButtonBits; clutch pressed = disengaged (hand re-centres)
  Vec3 applied_force_h_n = Vec3::Zero();  ///< what write_force() returned for the interval that just ended
  bool session_up = false;
  const link::Reply* reply = nullptr;  ///< newest accepted since the last tick; null if none came
  std::uint64_t command_sequence = 0;  ///< that the command of this tick will carry
  std::uint64_t next_step = 0;         ///< number that this tick's step gets, where steps are logged
  const link::SnapshotFetch* snapshot = nullptr;            ///< of the slave's state, complete; null: none
  std::size_t snapshot_pieces = 0;                          ///< of the one under way that are here
  double snapshot_per_s = link::SnapshotFetch::kPerSecond;  ///< so many are asked for, at most
  bool snapshot_refused = false;  ///< it is larger than there is room for, or cannot be had
  double rtt_s = 0;               ///< as known; 0: not yet
  std::uint32_t tip_wish = 0;     ///< link::kFlagTakeOver, link::kFlagHandOver: what the operator wants
};

/// What one tick did, for recording and display. Plain data.
struct StationTrace {
  std::int64_t time_ns = 0;
  Mode mode = Mode::kIdle;
  std::uint32_t faults = 0;  ///< now
  Vec3 hand_pos_h_m = Vec3::Zero();
  Vec3 hand_vel_h_m_s = Vec3::Zero();  ///< Δx/T of the encoder, unfiltered
  Vec3 tip_target_pos_w_nm = Vec3::Zero();
  Vec3 applied_force_h_n = Vec3::Zero();  ///< in the interval that just ended
  control::Method method = control::Method::kNone;
  Vec3 scaled_force_h_n = Vec3::Zero();    ///< α_F F_tip of the newest reply
  Vec3 rendered_force_h_n = Vec3::Zero();  ///< that the method shows, before damper, ramp and limits
  Vec3 damper_force_h_n = Vec3::Zero();
  Vec3 commanded_force_h_n = Vec3::Zero();  ///< after everything
  double damper_n_s_m = 0;                  ///< γ
  double force_bound_n = 0;                 ///< of the energy clamp; infinite without one
  double ramp = 0;                          ///< 0 … 1
  bool clamped = false;                     ///< the energy clamp cut the force
  bool limited = false;                     ///< the force limit cut it
  bool slewed = false;                      ///< the slew limit cut it
  double energy_j = 0;                      ///< of the observer, put in by the hand
  double energy_in_j = 0;
  double energy_out_j = 0;
  double quantisation_bound_j = 0;  ///< of energy_j
  double account_j = 0;             ///< of the method
  double slave_energy_in_j = 0;     ///< slave port, scaled to hand joules
  double slave_energy_out_j = 0;
  double stale_s = 0;  ///< since the last new reply
  std::uint64_t reply_sequence = 0;
  TwinState twin = TwinState::kNone;
  TwinEnd twin_end = TwinEnd::kNone;
  std::uint64_t twin_behind = 0;  ///< steps of the twin that are not confirmed
  double contact_radius_nm = 0;   ///< of the twin; 0: no contact, or no twin
  double adhesion_nn = 0;  ///< pull at which a contact here lets go, of twin or local model; 0: not known
  bool observes = false;   ///< another session moves the tip, or none: no force, no commanded motion
};

struct StationOutput {
  Vec3 hand_force_h_n = Vec3::Zero();  ///< to send to the device now
  link::Command command{};  ///< velocity, position, energies, flags, newest_reply; the link fills the rest
  bool has_step = false;    ///< the slave's next step, where steps are logged
  link::LoggedStep step{};
  bool wants_snapshot = false;    ///< of the slave's state
  std::uint32_t snapshot_of = 0;  ///< another number: what is on its way is not it any more
  StationTrace trace{};
};

/// The whole of the station's step: pure, no clock, no allocation, no exception.
///
/// Forces, in this order: what the method shows + damper, times the ramp; slew; force limit; energy clamp;
/// stop and non-finite → 0. Each later one has the higher priority and can only take force away, so the
/// earlier ones cannot undo it.
class Station {
 public:
  /// `stand_in`: a method of the caller's own in place of the configured one (control::Methods::stand_in).
  Station(const StationConfig& config, const device::DeviceInfo& device, const SlavePort& slave,
          std::unique_ptr<control::StationMethod> stand_in = nullptr);

  /// The slave's twin, for sessions that log their steps and serve its scene. Before the first tick.
  void use_twin(std::unique_ptr<TwinRun> twin) noexcept {
    twin_ = std::move(twin);
    if (twin_) twin_->compand(config_.companding);
  }
  const TwinRun* twin() const noexcept { return twin_.get(); }

  /// A session begins or is resumed: the tip is at `start_pos_w_nm` and may move within the workspace. Never
  /// makes a force step; the account goes on (a new session grants no new allowance). Scaling, damper and clamp
  /// were planned for one slave: a stiffer or more damped one is a latched stop; so is another scene than the
  /// last session's, which is no longer what the operator was shown. `known_account` false: the slave's sums
  /// began before this station, and what they hold already is credited to nobody here.
  void begin_session(const link::Welcome& welcome, bool known_account = true) noexcept;

  /// The next session is this one's on another scene, which a person has asked for: it was planned anew, for its slave.
  /// What is owed, and what samples have given, goes on; no allowance is granted. Outside of the loop, and while the
  /// device shows no force: the hand may be elsewhere when it goes on. `twin` null: there is none. Throws UserError,
  /// and nothing changes, for a config that is not valid.
  void go_to_scene(const StationConfig& config, const SlavePort& slave, std::unique_ptr<TwinRun> twin,
                   std::uint64_t scene_hash);

  /// Of the last session, or of the next one after go_to_scene(); 0: none yet.
  std::uint64_t scene_hash() const noexcept { return expected_scene_ != 0 ? expected_scene_ : scene_hash_; }

  void step(const StationInput& input, double dt_s, StationOutput& output) noexcept;

  /// Another control method, from the next tick on. Bumpless: the energy that is owed is carried over, none
  /// is granted, and the force goes over by the ramp. One that needs what the slave does not offer becomes
  /// usable_method() of it.
  void change_method(control::Method method) noexcept;
  /// Another scale, likewise; hand and tip stay where they are. False, and nothing changes, where the config
  /// would not be valid or, unless allowed, not safe for this slave and what is felt of it.
  bool change_scaling(const control::Scaling& scaling) noexcept;
  /// Another companding of forces before contact, likewise. False, and nothing changes, where the config would
  /// not be valid. Felt with a twin only.
  bool change_companding(const control::CompandingConfig& companding) noexcept;
  control::Method method() const noexcept { return methods_.method(); }

  /// Does the tip follow this station, once engaged? Always where each session has its own; of a shared one,
  /// while the slave's replies say so.
  bool holds_tip() const noexcept { return !shares_tip() || tip_hold_ != 0; }

  /// The slave has withdrawn its tip: no force, and nothing follows, until it says that the tip is back.
  bool tip_up() const noexcept { return has_reply_ && tip_up_; }
  /// The newest that was good; zeros before the first.
  const link::Reply& reply() const noexcept { return reply_; }

  /// Only a person may call this, after looking. Does nothing unless stopped; the force ramps up from zero.
  void clear_stop() noexcept;

  Mode mode() const noexcept { return mode_; }
  std::uint32_t latched_faults() const noexcept { return latched_; }
  const StationConfig& config() const noexcept { return config_; }
  double force_limit_n() const noexcept { return force_limit_n_; }
  const control::EnergyObserver& observer() const noexcept { return observer_; }

 private:
  bool logs_steps() const noexcept { return (features_ & link::kFeatureStepLog) != 0; }
  bool shares_tip() const noexcept { return (features_ & link::kFeatureSharing) != 0; }
  bool shows_twin() const noexcept {
    return twin_ && twin_->on() && methods_.method() == control::Method::kTwin;
  }
  /// Of a shared tip, while its state is not here yet: what the twin would show is not known.
  bool twin_waits() const noexcept { return shows_twin() && twin_->waits(); }
  control::MethodConfig method_config() const noexcept;

  // A session begins (station_session.cpp).
  control::Method usable(control::Method wanted) const noexcept;
  Vec3 session_start_w_nm(const link::Welcome& welcome) const noexcept;

  // The interval that has ended (station_measurement.cpp).
  void watch(const StationInput& input, double dt_s) noexcept;

  // The newest reply (station_replies.cpp),
  void accept_reply(const StationInput& input) noexcept;
  void on_tip_share(const link::TipShare& tip) noexcept;
  void on_tip_up() noexcept;
  void watch_age(const StationInput& input) noexcept;
  // and its energies (station_energy.cpp).
  struct SampleCredit {
    double well_j = 0;
    double given_j = 0;
  };
  link::ReceivedSums::News account_for_slave() noexcept;
  void update_method(const link::ReceivedSums::News& added, double price_j_aj) noexcept;
  SampleCredit sample_credit() noexcept;
  double given_aj() const noexcept;
  double well_j() const noexcept;

  // Mode and ramp (station_mode.cpp).
  void choose_mode(const StationInput& input, double dt_s) noexcept;
  void update_ramp(const StationInput& input, double dt_s) noexcept;
  double hold_s() const noexcept;
  double zero_s() const noexcept;
  void stand_at_tip(const Vec3& tip_pos_w_nm) noexcept;
  void begin_anew() noexcept;
  void follow_a_retracted_tip() noexcept;

  // The slave's step, where steps are logged (station_step_log.cpp).
  double step_s(std::int64_t now_ns, double dt_s) noexcept;
  void step_slave(const StationInput& input, double dt_s, StationOutput& output) noexcept;

  // The force (station_force.cpp).
  void render(const StationInput& input, double dt_s, StationTrace& trace) noexcept;
  void leave_twins_scale() noexcept;
  void fade_to_new_scale(double dt_s, StationTrace& trace) noexcept;
  Vec3 limited_force(double dt_s, StationTrace& trace) noexcept;

  // Command and trace (station_output.cpp).
  std::uint32_t command_flags(const StationInput& input) const noexcept;
  void fill_port_control(link::Command& command) const noexcept;
  void fill(const StationInput& input, double dt_s, StationOutput& output) noexcept;

  StationConfig config_;
  SlavePort slave_;
  double device_damping_n_s_m_ = 0;
  double position_quantum_m_ = 0;
  double period_s_ = 0;
  double device_force_max_n_ = 0;
  double force_limit_n_ = 0;
  control::EnergyObserver observer_;
  control::Methods methods_;
  std::uint64_t features_ = 0;  // of the session
  std::unique_ptr<TwinRun> twin_;
  std::uint64_t newest_step_ = 0;       // of the log, where there is one,
  Vec3 last_step_w_nm_ = Vec3::Zero();  // and its target
  std::uint32_t step_breaks_ = 0;       // in the log, as the server has said last
  std::uint32_t epoch_ = 0;
  std::uint64_t scene_hash_ = 0;
  bool has_scene_ = false;
  std::uint64_t expected_scene_ = 0;  // of go_to_scene(), until that session begins; 0: none
  std::uint32_t tip_hold_ = 0;  // of a shared tip: the holding that the target is anchored to; 0 = observes
  bool tip_up_ = false;         // the newest reply says that the slave has withdrawn its tip
  bool waits_for_tip_ = false;  // the operator wants to engage; the tip is up
  link::ReceivedSums slave_sums_;
  ScaleHistory scales_;
  double price_j_aj_ = 0;      // at which the newest reply's news cross
  link::PricedEnergy sample_;  // what the slave's sums say of it, at the scale of their time
  double well_aj_ = 0;         // of the scene, as the slave says; 0: none, or not known
  double given_aj_ = 0;        // out less in of the slave's sums, in this epoch
  SampleWells wells_;          // the most of that ever, of each sample
  WorkspaceMapping mapping_;
  Mode mode_ = Mode::kIdle;
  std::uint32_t latched_ = 0;
  std::uint32_t faults_ = 0;
  bool has_hand_pos_ = false;
  Vec3 hand_pos_h_m_ = Vec3::Zero();
  Vec3 hand_step_h_m_ = Vec3::Zero();
  bool has_reply_ = false;
  link::Reply reply_{};
  Vec3 tip_force_h_n_ = Vec3::Zero();  ///< of that reply, scaled
  Vec3 rendered_force_h_n_ = Vec3::Zero();
  bool leaves_twin_ = false;              // the method is another one from this tick on, in contact perhaps
  Vec3 left_by_twin_h_n_ = Vec3::Zero();  // that it showed more, which goes at control::Twin::kGoOver_n_s
  bool fades_ = false;                    // a stiffness planned for the twin, which is not felt any more:
  Vec3 fading_h_n_ = Vec3::Zero();        // this force, at control::Twin::kGoOver_n_s; then another scale
  bool bump_ahead_ = false;               // the force may be another one at once: let the ramp bring it in
  std::uint64_t newest_sequence_ = 0;
  std::int64_t last_reply_ns_ = 0;
  double stale_s_ = 0;
  std::int64_t last_tick_ns_ = 0;
  double steps_ahead_s_ = 0;  // of the logged steps before the time that has passed
  double blind_s_ = 0;        // that, or how long too much was shown without a confirmation
  bool old_ = false;          // the round trip is longer than the method allows,
  std::int64_t old_since_ns_ = 0;
  double ramp_ = 0;
  Vec3 last_target_w_nm_ = Vec3::Zero();
  Vec3 commanded_force_h_n_ = Vec3::Zero();
  Vec3 applied_force_h_n_ = Vec3::Zero();
};

}  // namespace telenano::station

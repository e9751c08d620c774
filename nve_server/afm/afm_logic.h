#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "telenano/nve_server/afm/across_rule.h"
#include "telenano/nve_server/afm/afm_config.h"
#include "telenano/nve_server/afm/afm_exchange.h"
#include "telenano/nve_server/afm/afm_port.h"
#include "telenano/nve_server/afm/motion_history.h"
#include "telenano/nve_server/afm/signal_watch.h"
#include "telenano/nve_server/afm/surface_tracker.h"
#include "telenano/nve_server/afm/touch_model.h"
#include "telenano/nve_server/afm/work_account.h"

namespace telenano::afm {

enum class Loss : std::uint8_t { kClosed, kGarbage, kSilent };

/// Everything that an AFM slave decides, without a socket or a clock: events and times go in, calls for four
/// serial connections come out. The same object runs against a real controller and, in virtual time, against
/// a simulated one. A value: a copy goes on alike. One thread; it allocates, so never the server's loop.
///
/// Safety. After the start-up checks, in which nothing moves, every fault ends in one latched withdrawal: on
/// the emergency connection (Stop, Withdraw, then looking whether the tip is up, and again), and on the
/// motion connection besides, until the height that the controller reports is that of a withdrawn tip.
///
/// Force limit. The base goes lower only as far as no reading is needed to know that the force stays below
/// the limit. A reading that only repeats the last one, bit for bit, is none: z_hi counts from the first of
/// them on, at most from the top of the ground that was touched last, as long as the value says that the tip
/// is free (signal_watch.h). A reading F is the average over a window in which the base was no higher than
/// z_hi and after whose beginning it travelled s across; the force as a function of the base is nowhere
/// steeper than the lever, k, and across it rises by at most m k (across_rule.h), or ground is no steeper than m = slope_max
/// above the relief. So at z, F' ≤ F + k (z_hi − z + m s) (a jump only
/// lowers it on the way down), and the base is kept at z ≥ z_hi + m s − (F_max − F)/k, by the newest reading and by
/// every one of the last 60 ms: a signal that shows less force than there is (a dip, a glitch, hum) for 50 ms
/// lets it go no lower. Older readings hold at their own place, without the way across since, and one that says
/// that the tip is free counts from the top of the ground that is known, as below. What is left over the
/// limit is noise, thermal bending since the tare, and drift times the age of the reading, times k.
///
/// Lateral limit. Nearer to the sample than `relief_nm` above the highest ground that was touched, the base
/// goes across and down only as far as AcrossRule lets it, and along the lever, where no signal shows the force,
/// as AlongRule says: not at all, or with as little force down as the slope that is known there asks for. A lateral reading that repeats the last one, bit for
/// bit, is none there.
///
/// In the approach the Z controller moves the tip, and presses with its set point: that is read before each
/// approach, and must lie within F_max. Beyond it (it was changed, or the controller overshoots) the readings
/// withdraw; by then the controller has gone on for a reading's age at its speed.
class AfmLogic {
 public:
  AfmLogic(const AfmConfig& config, std::unique_ptr<AfmPort> port);

  // Connections.
  void connected(Role role, std::int64_t now_ns);
  void lost(Role role, Loss loss, std::int64_t now_ns);
  /// The next call of a connection that is idle; its reply is then expected.
  bool next(Role role, std::int64_t now_ns, AfmCommand& call);
  /// Its bytes are gone, at this time by a clock read since: the reply is waited for from here on. This thread may have been kept
  /// waiting after next(), and is not to find the controller silent for it.
  void sent(Role role, std::int64_t now_ns) noexcept;
  void answered(Role role, const AfmReading& reading, std::int64_t now_ns);
  /// True once when a connection must be closed, because its reply did not come: lost() need not be called.
  bool take_close(Role role) noexcept;
  /// Which command the connection waits for; null if none.
  const AfmCommand* waits_for(Role role) const noexcept;

  /// Time goes on: time-outs, latches. Call it before next(), at least every few milliseconds.
  void tick(std::int64_t now_ns, const PortTarget& wish);

  void withdraw(Cause cause, std::int64_t now_ns);
  /// Before the start: no approach after the checks, until approve() or an operator who wants to engage.
  void await_approval() noexcept { unapproved_ = true; }
  bool awaits_approval() const noexcept {
    return state_.phase == Phase::kWithdrawn && state_.cause == Cause::kNotApproved && !ending_;
  }
  void approve(std::int64_t now_ns);
  /// No approach, for a reason outside of the rig: refused.
  void forbid(const std::string& why, std::int64_t now_ns);
  /// Nothing is left to do after withdraw(Cause::kExit), or after a refusal: the tip is up, and the
  /// controller has its settings back, or cannot be reached for it before anything has moved.
  bool finished() const noexcept;
  const PortState& state() const noexcept { return state_; }
  /// One line, once kRefused.
  const std::string& refusal() const noexcept { return refusal_; }
  /// What happened last, one line; changes with the count.
  const std::string& news() const noexcept { return news_; }
  std::uint64_t news_count() const noexcept { return news_count_; }

  /// Between this logic and the controller: for whoever passes the bytes on.
  AfmPort& port() noexcept { return *port_; }
  const AfmConfig& config() const noexcept { return config_; }
  double drift_nm_s() const noexcept { return surface_.drift_nm_s(); }
  double tare_nn() const noexcept { return tare_nn_; }
  double force_trip_nn() const noexcept;

 private:
  struct Connection {
    bool connected = false;
    bool busy = false;
    bool close = false;
    AfmCommand call;
    std::int64_t sent_ns = 0;        // not after the call: what its reply tells may be as old
    std::int64_t waits_from_ns = 0;  // not before the call
    std::int64_t next_ns = 0;        // not before
    bool checked = false;
  };
  Connection& at(Role role) noexcept { return connections_[static_cast<std::size_t>(role)]; }
  const Connection& at(Role role) const noexcept { return connections_[static_cast<std::size_t>(role)]; }
  bool all_connected() const noexcept;
  bool send(Role role, const AfmCommand& command, std::int64_t now_ns, AfmCommand& call);
  std::int64_t timeout_ns(const Connection& c) const noexcept;

  void checked(Role role, const AfmReading& reading);
  bool gives_back() const noexcept;
  double wanted_floor_nm(std::int64_t now_ns) const noexcept;
  bool next_floor(std::int64_t now_ns, AfmCommand& call);
  void on_watched(double value);
  void compare_safe_tip(std::int64_t now_ns);
  /// Why the approach must not be made with this set point; empty if it may.
  std::string setpoint_excess(const AfmReading& reading) const;
  void refuse(const std::string& text);
  void tell(const std::string& text);
  bool withdrawing() const noexcept {
    return state_.phase == Phase::kWithdrawing || state_.phase == Phase::kWithdrawn;
  }
  void enter(Phase phase, std::int64_t now_ns);
  void engage(std::int64_t now_ns);

  bool next_motion(std::int64_t now_ns, AfmCommand& call);
  bool next_move(std::int64_t now_ns, AfmCommand& call);
  bool next_touch(std::int64_t now_ns, AfmCommand& call);
  bool next_lift(std::int64_t now_ns, AfmCommand& call);
  void lift_reading(double deflection_nm, std::int64_t now_ns);
  bool next_emergency(std::int64_t now_ns, AfmCommand& call);
  bool next_data(std::int64_t now_ns, AfmCommand& call);
  bool next_held(AfmCommand& command);
  void on_held(const AfmReading& reading, std::int64_t now_ns);
  void watch_safe_tip(double value, std::int64_t sent_ns, std::int64_t now_ns);
  bool send_z(double z_w_nm, std::int64_t now_ns, AfmCommand& call);
  double lowest_allowed_nm(std::int64_t now_ns) const noexcept;
  /// Where the base may have stood while the newest reading was averaged, and how much lower it may go.
  struct Stood {
    double low_nm = 0, high_nm = 0, down_nm = 0;
  };
  Stood stood(std::int64_t now_ns) const noexcept;
  void keep_bound(std::int64_t now_ns) noexcept;
  double lowest_by_lateral_nm(std::int64_t now_ns) const noexcept;
  double slope() const noexcept;
  void hold_along(bool told, double& along_nm);
  bool near_ground() const noexcept { return config_.relief_nm > 0 && sent_w_nm_.z() < clear_nm(); }
  double clear_nm() const noexcept { return ground_nm_ + config_.relief_nm; }
  AcrossRule::Since since_lateral(std::int64_t now_ns) const noexcept;
  double top_of_ground_nm() const noexcept;
  double deepest_touch_nm() const noexcept;

  void on_motion(const AfmReading& reading, std::int64_t now_ns);
  void on_reading(const AfmReading& reading, std::int64_t sent_ns, std::int64_t now_ns);
  bool plausible(double volts, double lateral_volts, std::int64_t from_ns, std::int64_t now_ns);
  bool zero_moved(std::int64_t now_ns);
  void on_status(const AfmReading& reading, std::int64_t sent_ns, std::int64_t now_ns);
  void on_setpoint(const AfmReading& reading, std::int64_t now_ns);
  void on_height(double height, std::int64_t now_ns);
  void tare(double deflection_nm, double lateral_nn, std::int64_t sent_ns, std::int64_t now_ns);
  void touch_reading(std::int64_t sent_ns, std::int64_t now_ns);
  void touched(std::int64_t now_ns);
  void begin_following(std::int64_t now_ns);
  void retouch(const Vec3& base_w_nm, double force_nn, double way_nm, std::int64_t now_ns);
  void slew_surface(std::int64_t now_ns) noexcept;

  double contact_height_nm(std::int64_t now_ns) const noexcept;

  AfmConfig config_;
  std::array<Connection, kRoles> connections_;
  PortHandle port_;
  std::size_t next_check_ = 0;
  std::string refusal_;
  std::string news_;
  std::uint64_t news_count_ = 0;
  PortState state_;
  PortTarget wish_;
  std::uint64_t cleared_ = 0;

  // What the rig said.
  double free_deflection_nm_ = 0;
  double range_z_nm_ = 0;
  double start_x_nm_ = 0, start_y_nm_ = 0;
  double top_height_nm_ = 0;  // where it stood withdrawn

  // What it had before, and how deep it lets the tip go.
  std::size_t given_back_ = 0;
  bool ending_ = false;
  bool unapproved_ = false;
  bool approved_ = false;
  double floor_nm_ = kNoFloor;  // as the controller was told last
  double asked_floor_nm_ = kNoFloor;
  static constexpr double kNoFloor = 1e300;  // not known

  // SafeTip's signal in the air and at the first touch.
  double safe_tip_air_ = 0, safe_tip_touch_ = 0;
  bool safe_tip_air_known_ = false, safe_tip_touch_known_ = false;
  int safe_tip_differs_ = 0;  // times in a row, while it follows
  // What somebody else may change: which is asked next, and how many questions there were since.
  std::size_t next_held_ = 0;
  int since_held_ = 0;
  std::size_t held_asked_ = 0;  // and found as they were, since the approach began

  // Approach.
  std::int64_t phase_ns_ = 0;  // since when
  std::int64_t engage_ns_ = 0;
  int engage_step_ = 0;
  std::int64_t off_ns_ = 0;   // when the Z controller had said that it is off
  int calm_ = 0;              // looks in a row that saw it stand still,
  std::int64_t calm_ns_ = 0;  // the first of them
  bool setpoint_ok_ = false;  // read, and within the limit, since the approach began
  double last_height_nm_ = 0;
  double settled_height_nm_ = 0;
  double height_nm_ = 0;  // as last sent or read, of the base
  // The lift goes on until the force no longer changes with the height.
  double lift_nm_;  // above the surface, where the tip waits: as configured, or where it came off
  bool free_ = false;
  double lift_to_nm_ = 0;
  int lift_readings_ = 0;
  double lift_sum_nm_ = 0, lift_last_nm_ = kNoFloor;
  int tared_ = 0;
  double tare_sum_ = 0, tare_squares_ = 0, tare_lateral_sum_ = 0;
  double tare_nm_ = 0, tare_nn_ = 0, tare_lateral_nn_ = 0;
  std::vector<double> free_volts_;  // of the deflection, in free space
  std::vector<double> free_lateral_v_;
  // Readings in a row that were taken where no force can act, and their sum.
  int high_readings_ = 0;
  double high_sum_nn_ = 0;
  SignalWatch watch_;
  double contact_stiffness_n_m_ = 0;  // of the last touch; 0 until there was one in this approach
  bool ever_touched_ = false;
  enum class Touch : std::uint8_t { kDown, kCompare, kUp, kPause, kLevel } touch_ = Touch::kDown;
  int touches_ = 0;
  bool touch_fresh_ = false;  // a reading since the last step down
  std::int64_t touch_moved_ns_ = 0;
  double touch_from_height_nm_ = 0;
  double touch_last_nn_ = 0, touch_last_nm_ = 0;  // the reading before, on the way down
  double touch_height_nm_ = 0;
  std::int64_t touch_ns_ = 0;
  double last_touch_height_nm_ = 0;
  std::int64_t last_touch_ns_ = 0;

  // Where the tip touches.
  SurfaceTracker surface_;
  double last_force_nn_ = 0;
  double shift_nm_ = 0;  // of W's zero, still to be made
  std::int64_t shifted_ns_ = 0;

  // Following.
  MotionHistory history_;
  BoundHistory bounds_;  // that readings have set, in W
  Vec3 sent_w_nm_ = Vec3::Zero();
  std::int64_t last_move_ns_ = 0;
  std::int64_t last_xy_ns_ = 0;
  std::int64_t reading_from_ns_ = 0;  // the window of the newest one
  std::int64_t lateral_from_ns_ = 0;  // of the newest that says something new of the force across
  double lateral_volts_ = 0;
  int lateral_repeats_ = 0;
  bool lateral_told_ = false;
  double ground_nm_ = 0;  // the highest that was touched, in W
  AcrossRule across_rule_;
  AlongRule along_rule_;
  double free_y_nm_ = 0;  // where it was last higher than any ground
  bool along_told_ = false;
  std::int64_t reading_ns_ = 0;     // when it came
  std::int64_t round_trip_ns_ = 0;  // of a question that is answered at once
  std::int64_t last_account_ns_ = 0;
  bool across_next_ = false;
  TouchModel model_;
  WorkAccount account_;
  bool was_touching_ = false;
  std::int64_t session_ns_ = 0;  // last sign of a session

  // Withdrawing.
  bool stop_sent_ = false;
  bool withdraw_sent_ = false;
  bool motion_withdraw_sent_ = false;
  // Whoever has the emergency port answers there, and does not object: no approach otherwise.
  bool emergency_ready_ = false;
  bool emergency_objects_ = false;
  bool asks_status_ = false;
  std::int64_t withdraw_ns_ = 0;
  std::int64_t say_ns_ = 0;  // when to say again that it is not up
};

}  // namespace telenano::afm

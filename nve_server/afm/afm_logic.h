#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "nve_server/afm/afm_config.h"
#include "nve_server/afm/afm_exchange.h"
#include "nve_server/afm/motion_history.h"
#include "nve_server/afm/touch_model.h"
#include "nve_server/afm/work_book.h"
#include "nve_server/nanonis/codec.h"

namespace telenano::afm {

enum class Role : std::uint8_t { kMotion, kReads, kData, kEmergency };
inline constexpr std::size_t kRoles = 4;
std::string_view name(Role role) noexcept;

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
/// the limit. A reading F is the average over a window in which the base was no higher than z_hi and after
/// whose beginning it travelled s across; the force as a function of the base is nowhere steeper than the
/// lever, k, and ground no steeper than m. So at z, F' ≤ F + k (z_hi − z + m s) (a jump only lowers it on the
/// way down), and the base is kept at z ≥ z_hi + m s − (F_max − F)/k. What is left over the limit is noise,
/// thermal bending since the tare, and drift times the age of the reading, times k.
///
/// In the approach the Z controller moves the tip, and presses with its set point: that is read before each
/// approach, and must lie within F_max. Beyond it (it was changed, or the controller overshoots) the readings
/// withdraw; by then the controller has gone on for a reading's age at its speed.
class AfmLogic {
 public:
  explicit AfmLogic(const AfmConfig& config);

  // Connections.
  void connected(Role role, std::int64_t now_ns);
  void lost(Role role, Loss loss, std::int64_t now_ns);
  /// The next call of a connection that is idle; its reply is then expected.
  bool next(Role role, std::int64_t now_ns, nanonis::Call& call);
  void answered(Role role, const nanonis::Answer& answer, std::int64_t now_ns);
  /// True once when a connection must be closed, because its reply did not come: lost() need not be called.
  bool take_close(Role role) noexcept;
  /// Which command the connection waits for; null if none.
  const nanonis::Call* waits_for(Role role) const noexcept;

  /// Time goes on: time-outs, latches. Call it before next(), at least every few milliseconds.
  void tick(std::int64_t now_ns, const PortWish& wish);

  void withdraw(Cause cause, std::int64_t now_ns);
  const PortState& state() const noexcept { return state_; }
  /// One line, once kRefused.
  const std::string& refusal() const noexcept { return refusal_; }
  /// What happened last, one line; changes with the count.
  const std::string& news() const noexcept { return news_; }
  std::uint64_t news_count() const noexcept { return news_count_; }

  const AfmConfig& config() const noexcept { return config_; }
  double drift_nm_s() const noexcept { return drift_nm_s_; }
  double tare_nn() const noexcept { return tare_nn_; }
  double force_trip_nn() const noexcept;

 private:
  struct Connection {
    bool connected = false;
    bool busy = false;
    bool close = false;
    nanonis::Call call;
    std::int64_t sent_ns = 0;
    std::int64_t next_ns = 0;  // not before
    bool checked = false;
  };
  struct Check {
    Role role;
    nanonis::Call call;
  };

  Connection& at(Role role) noexcept { return connections_[static_cast<std::size_t>(role)]; }
  const Connection& at(Role role) const noexcept { return connections_[static_cast<std::size_t>(role)]; }
  bool all_connected() const noexcept;
  bool send(Role role, nanonis::CommandId id, std::vector<double> numbers, std::int64_t now_ns,
            nanonis::Call& call);
  std::int64_t timeout_ns(const Connection& c) const noexcept;

  void make_checks();
  void checked(const Check& check, const nanonis::Answer& answer);
  /// Why the approach must not be made with this set point; empty if it may.
  std::string setpoint_excess(double setpoint) const;
  void refuse(const std::string& text);
  void tell(const std::string& text);
  bool withdrawing() const noexcept {
    return state_.phase == Phase::kWithdrawing || state_.phase == Phase::kWithdrawn;
  }
  void enter(Phase phase, std::int64_t now_ns);
  void engage(std::int64_t now_ns);

  bool next_motion(std::int64_t now_ns, nanonis::Call& call);
  bool next_move(std::int64_t now_ns, nanonis::Call& call);
  bool next_touch(std::int64_t now_ns, nanonis::Call& call);
  bool next_emergency(std::int64_t now_ns, nanonis::Call& call);
  bool next_data(std::int64_t now_ns, nanonis::Call& call);
  bool send_z(double z_w_nm, std::int64_t now_ns, nanonis::Call& call);
  double lowest_allowed_nm(std::int64_t now_ns) noexcept;

  void on_motion(const nanonis::Answer& answer, std::int64_t now_ns);
  void on_reading(const nanonis::Answer& answer, std::int64_t sent_ns, std::int64_t now_ns);
  void on_status(double status, std::int64_t sent_ns, std::int64_t now_ns);
  void on_setpoint(double setpoint, std::int64_t now_ns);
  void on_height(double z_m, std::int64_t now_ns);
  void tare(double deflection_nm, double lateral_nn, std::int64_t sent_ns, std::int64_t now_ns);
  void touch_reading(std::int64_t sent_ns, std::int64_t now_ns);
  void touched(std::int64_t now_ns);

  double contact_height_nm(std::int64_t now_ns) const noexcept;
  double height_of(double z_m) const noexcept { return 1e9 * config_.z_sign * z_m; }

  AfmConfig config_;
  std::array<Connection, kRoles> connections_;
  std::vector<Check> checks_;
  std::size_t next_check_ = 0;
  std::string refusal_;
  std::string news_;
  std::uint64_t news_count_ = 0;
  PortState state_;
  PortWish wish_;
  std::uint64_t cleared_ = 0;

  // What the rig said.
  double calibration_m_v_ = 0;  // units of the signal a volt
  double offset_ = 0;
  double lateral_calibration_ = 1;
  double lateral_offset_ = 0;
  double free_deflection_nm_ = 0;
  double range_z_nm_ = 0;
  double start_x_nm_ = 0, start_y_nm_ = 0;
  double top_height_nm_ = 0;  // where it stood withdrawn

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
  int tared_ = 0;
  double tare_sum_ = 0, tare_squares_ = 0, tare_lateral_sum_ = 0;
  double tare_nm_ = 0, tare_nn_ = 0, tare_lateral_nn_ = 0;
  bool ever_touched_ = false;
  enum class Touch : std::uint8_t { kDown, kUp, kPause } touch_ = Touch::kDown;
  int touches_ = 0;
  bool touch_fresh_ = false;  // a reading since the last step down
  std::int64_t touch_moved_ns_ = 0;
  double touch_from_height_nm_ = 0;
  double touch_height_nm_ = 0;
  std::int64_t touch_ns_ = 0;
  double last_touch_height_nm_ = 0;
  std::int64_t last_touch_ns_ = 0;

  // Surface and drift: the tip touches at height surface + drift·(t − at).
  double surface_height_nm_ = 0;
  std::int64_t surface_ns_ = 0;
  double drift_nm_s_ = 0;
  bool drift_known_ = false;

  // Following.
  MotionHistory history_;
  Vec3 sent_w_nm_ = Vec3::Zero();
  std::int64_t last_move_ns_ = 0;
  std::int64_t last_xy_ns_ = 0;
  std::int64_t reading_from_ns_ = 0;  // the window of the newest one
  std::int64_t reading_ns_ = 0;       // when it came
  std::int64_t last_book_ns_ = 0;
  bool across_next_ = false;
  TouchModel model_;
  WorkBook book_;
  bool was_touching_ = false;
  std::int64_t session_ns_ = 0;  // last sign of a session

  // Withdrawing.
  bool stop_sent_ = false;
  bool withdraw_sent_ = false;
  bool motion_withdraw_sent_ = false;
  std::int64_t withdraw_ns_ = 0;
};

}  // namespace telenano::afm

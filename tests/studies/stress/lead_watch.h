#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "telenano/common/base/vec3.h"

namespace telenano::studies::stress {

/// Does the hand lead the target, and it alone? By what the hand does and by the scale that the operator has chosen, not by the
/// station's own mapping:
///
///   led             while the station is engaged the target moves by α_v times the hand's way, in the slave's workspace:
///                   what went beyond it must come back before the target moves again
///   where it was    when the station engages, and while it does not, the target stays, or is put where the tip is
///   a new session   begins where its Welcome says
///   withdrawn       once the tip has been up, the target of the next engagement is where the tip is
///   let go          while the hand holds the clutch, has stopped, or another session moves the tip, the station is not engaged;
///                   a tip that another session has, and only leads aside, keeps its height
///   no force        from when the hand has let go: none at once after a stop, none after the fade with the clutch
///   no jump         when the operator changes scale, method or task: the force grows by one tick of the ramp at most
///
/// A target that is put somewhere is told by the replies; one of a log of steps goes on where its last step was.
class LeadWatch {
 public:
  struct Limits {
    double period_s = 1e-3;
    double fade_s = 0.08;   ///< of a force whose hand has let go
    double ramp_s = 0.2;    ///< of a force that comes
    double damper_m_s = 0;  ///< v_max: the damper's force besides what the method shows
  };
  explicit LeadWatch(const Limits& limits) noexcept : limits_(limits) {}

  struct Tick {
    double time_s = 0;
    int periods = 1;
    Vec3 hand_h_m = Vec3::Zero();  ///< as its encoder shows it
    Vec3 target_w_nm = Vec3::Zero();
    Vec3 force_h_n = Vec3::Zero();     ///< that acts from now on
    Vec3 rendered_h_n = Vec3::Zero();  ///< that the method shows
    double damper_n_s_m = 0;
    double velocity_scale = 1e-6;  ///< that the operator has chosen
    bool rescaled = false;         ///< just now, to whatever scale
    bool engaged = false;
    bool retracted = false;  ///< the newest reply says that the slave has withdrawn the tip
    bool observes = false;   ///< another session moves the tip, as the newest reply says
    bool clutch = false;     ///< the hand holds it
    bool stopped = false;
    bool acted = false;            ///< the operator changed scale, method or task just now
    bool another_has_tip = false;  ///< another session has the shared tip, and moves it along the ground only
    bool withdraws = false;        ///< the slave
    double slave_z_w_nm = 0;       ///< of its commanded end
    bool put_anywhere = false;     ///< where the tip is, is not known here
    std::int64_t sessions = 0;     ///< so far
    bool logs = false;             ///< of steps
    Vec3 begins_w_nm = Vec3::Zero();  ///< that the Welcome says
    Vec3 lowest_w_nm = Vec3::Zero(),
         highest_w_nm = Vec3::Zero();  ///< of the workspace; without volume: no bound
    Vec3 tip_w_nm = Vec3::Zero(),
         held_w_nm = Vec3::Zero();  ///< of the newest reply: tip, and end of a shared one
  };

  void look(const Tick& now) noexcept {
    if (begun_) {
      if (!is_led(now)) wrong_ = true;
      if (!is_let_go(now)) holds_on_ = true;
      if (now.acted && !is_bumpless(now)) jumps_ = true;
    }
    if (now.engaged) {
      const bool led = begun_ && last_.engaged && now.sessions == last_.sessions;
      unbounded_w_nm_ = led && !put_ ? led_w_nm(now) : now.target_w_nm;
      // Where a target was put outside the workspace, not all of its way back is seen.
      put_at_edge_ = is_at_edge(now) && (!led || put_ || put_at_edge_);
    }
    if (begun_) {
      moved_h_m_ = (now.hand_h_m - last_.hand_h_m) / last_.periods;
      changed_n_ = (now.rendered_h_n - last_.rendered_h_n).norm();
    }
    begun_ = true;
    last_ = now;
  }

  bool leads() const noexcept { return !wrong_; }
  bool lets_go() const noexcept { return !holds_on_; }
  bool is_smooth() const noexcept { return !jumps_; }

 private:
  // Nanometres of some hundred in double, 1e5 sums of them.
  static constexpr double kRoundingNm = 1e-6;
  static constexpr double kNotFeltN = 0.05;
  static constexpr double kCatchUpNm = 0.1;  // a lag that is caught up for the one who has the tip now
  static constexpr double kOutsideNm = 1;    // the most that a sample holds a tip outside the workspace
  static constexpr double kInTheAirNm = 1;   // between a tip in the air and its lever's other end

  /// Without the workspace.
  Vec3 led_w_nm(const Tick& now) const noexcept {
    // With another scale the target is the anchor, and what went beyond the workspace is forgotten.
    const Vec3 from_w_nm = now.rescaled ? last_.target_w_nm : unbounded_w_nm_;
    return from_w_nm + 1e9 * now.velocity_scale * (now.hand_h_m - last_.hand_h_m);
  }
  static bool near(const Vec3& a, const Vec3& b) noexcept { return (a - b).norm() <= kRoundingNm; }
  static Vec3 in_workspace_w_nm(const Tick& now, Vec3 pos_w_nm) noexcept {
    for (int axis = 0; axis < 3; ++axis) {
      if (now.lowest_w_nm[axis] < now.highest_w_nm[axis])
        pos_w_nm[axis] = std::clamp(pos_w_nm[axis], now.lowest_w_nm[axis], now.highest_w_nm[axis]);
    }
    return pos_w_nm;
  }
  /// The target is there, or, once engaged, at the next place in the workspace: what pulls at a tip can hold it a little outside.
  static bool is_at(const Tick& now, const Vec3& pos_w_nm) noexcept {
    return near(now.target_w_nm, pos_w_nm) ||
           (now.engaged && near(now.target_w_nm, in_workspace_w_nm(now, pos_w_nm)));
  }
  static bool is_at_edge(const Tick& now) noexcept {
    for (int axis = 0; axis < 3; ++axis) {
      const double at = now.target_w_nm[axis];
      const bool bounded = now.lowest_w_nm[axis] < now.highest_w_nm[axis];
      if (bounded && (at <= now.lowest_w_nm[axis] || at >= now.highest_w_nm[axis])) return true;
    }
    return false;
  }
  static bool is_put(const Tick& now, const Tick& last) noexcept {
    return is_at(now, now.tip_w_nm) || is_at(now, now.held_w_nm) || is_at(now, last.tip_w_nm) ||
           is_at(now, last.held_w_nm) || now.put_anywhere;
  }

  bool is_led(const Tick& now) noexcept {
    put_ = false;
    if (now.sessions != last_.sessions) was_up_ = false;
    if (now.sessions != last_.sessions) return now.logs || near(now.target_w_nm, now.begins_w_nm);
    if (now.engaged && last_.engaged) {
      const double off_nm = (now.target_w_nm - in_workspace_w_nm(now, led_w_nm(now))).norm();
      if (off_nm <= kRoundingNm) return true;
      return put_ = is_put(now, last_) || (put_at_edge_ && off_nm <= kOutsideNm);
    }
    if (now.retracted) was_up_ = true;
    if (now.engaged && was_up_) {
      was_up_ = false;
      // Steps of a log that are on their way lead the tip to the target yet.
      return now.put_anywhere || now.logs || (now.target_w_nm - now.tip_w_nm).norm() <= kInTheAirNm ||
             (now.target_w_nm - now.held_w_nm).norm() <= kInTheAirNm;
    }
    return is_at(now, last_.target_w_nm) || is_put(now, last_);
  }

  bool is_let_go(const Tick& now) noexcept {
    if (!now.another_has_tip || !last_.another_has_tip || now.withdraws) given_z_w_nm_ = now.slave_z_w_nm;
    if (std::fabs(now.slave_z_w_nm - given_z_w_nm_) > kCatchUpNm) return false;
    const bool free = !now.clutch && !now.stopped && !now.observes;
    if (free) {
      let_go_since_s_ = -1;
      return true;
    }
    if (let_go_since_s_ < 0) let_go_since_s_ = now.time_s;
    const double force_n = now.force_h_n.norm();
    if (now.engaged || (now.stopped && force_n > 0)) return false;
    return now.time_s - let_go_since_s_ <= limits_.fade_s + 2 * limits_.period_s || !(force_n > 0);
  }

  bool is_bumpless(const Tick& now) const noexcept {
    const double shown_n = now.rendered_h_n.norm() + now.damper_n_s_m * limits_.damper_m_s;
    const double step_n = shown_n * limits_.period_s * last_.periods / limits_.ramp_s;
    // What the hand's own motion changes: as in the tick before, and by its damper.
    const double vel_change_m_s =
        ((now.hand_h_m - last_.hand_h_m) / last_.periods - moved_h_m_).norm() / limits_.period_s;
    const double moves_n = 3 * changed_n_ + now.damper_n_s_m * vel_change_m_s + kNotFeltN;
    return now.force_h_n.norm() <= last_.force_h_n.norm() + step_n + moves_n;
  }

  Limits limits_;
  bool begun_ = false;
  Tick last_;
  Vec3 unbounded_w_nm_ = Vec3::Zero();
  Vec3 moved_h_m_ = Vec3::Zero();  // in a period, before the last tick
  double changed_n_ = 0;           // of what was shown, in the last tick
  bool put_ = false, put_at_edge_ = false;
  bool was_up_ = false;
  double let_go_since_s_ = -1;
  double given_z_w_nm_ = 0;
  bool wrong_ = false, holds_on_ = false, jumps_ = false;
};

}  // namespace telenano::studies::stress

#pragma once

#include <cstdint>
#include <limits>

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/contact_plane.h"
#include "telenano/common/control/method.h"
#include "telenano/common/control/passivity_controller.h"
#include "telenano/common/control/port_interval.h"
#include "telenano/common/control/scaling.h"

namespace telenano::control {

/// What a new reply of the slave says, in the station's units. Energies and waves are what has been added
/// since the last one accepted (cumulative sums on the wire, so nothing that was lost on the way is missed),
/// crossed by the scaling.
struct SlaveNews {
  Vec3 force_h_n = Vec3::Zero();  ///< α_F F_tip
  bool touching = false;
  double energy_out_j = 0;     ///< given back by it, ≥ 0
  double energy_sent_j = 0;    ///< ≥ 0
  Vec3 wave_h = Vec3::Zero();  ///< Σ w T, √(J s)
  double wave_j = 0;           ///< Σ ½ w² T, ≥ 0
  ContactPlane model;          ///< version 0 = none
  std::uint64_t answers = 0;   ///< number of the command answered
  /// What of the sample's own energy may be believed: at most `well_j`, the deepest well that it can have at
  /// the present scale (0: none, or not known). `given_j` ≤ well_j: the most that it has ever given beyond
  /// what was put in. Both ≥ 0, and now, not since the last reply.
  double well_j = 0;
  double given_j = 0;
};

/// What the slave that runs at the station says after the step of this tick, in the station's units.
struct LocalNews {
  Vec3 force_h_n = Vec3::Zero();  ///< α_F F_tip
  bool other_state = false;       ///< the slave was put into another state since the last step
  double dt_s = 1e-3;             ///< of this tick
  /// Of its own account, as in SlaveNews.
  double well_j = 0;
  double given_j = 0;
};

/// Where the station renders.
struct RenderPoint {
  Vec3 target_w_nm = Vec3::Zero();  ///< commanded tip position of this tick
  std::uint64_t command = 0;        ///< number of the command that will carry it
  double dt_s = 1e-3;
};

/// What a method has to tell the slave; cumulative, hand units.
struct SlaveOrder {
  double energy_sent_j = 0;
  Vec3 wave_sum_h = Vec3::Zero();   ///< Σ u T, √(J s)
  double wave_j = 0;                ///< Σ ½ u² T
  double wave_impedance_n_s_m = 0;  ///< b_w, hand units; 0 = no waves
};

struct MethodConfig {
  PassivityConfig passivity{};  ///< its `method` is set by each method itself
  Scaling scaling{};
  double model_slew_n_s =
      100;  ///< how fast a local model's own changes may change the force at a resting hand
};

/// A control method of the station's port. Order of calls in a tick: account_for() — on_reply(), if there is news —
/// force_h_n() — damper_force_h_n(), force_bound_n() — fill_command(). All forces act on the hand (frame H,
/// N). Nothing here allocates, waits or throws.
class StationMethod {
 public:
  StationMethod() = default;
  StationMethod(const StationMethod&) = delete;
  StationMethod& operator=(const StationMethod&) = delete;
  virtual ~StationMethod() = default;

  /// Becomes the method in use: `account_j` is what the last one had. Its deficit is taken over, its surplus
  /// is not: a change of method grants no allowance. Likewise a change of scale. What it knew of the slave is
  /// forgotten; the caller lets it on_reply() the newest reply again. credited_j() is carried over by who
  /// changes methods.
  virtual void take_over(double account_j, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept = 0;
  /// A session has begun or was resumed: what was on the way is lost; with a new epoch the slave is another
  /// one, which knows of no energy that was sent to the last.
  virtual void begin_session(bool new_epoch) noexcept = 0;

  virtual void account_for(const PortInterval& interval) noexcept = 0;
  virtual void on_reply(const SlaveNews& news) noexcept = 0;
  /// Each tick, where the slave runs at the station too.
  virtual void feel(const LocalNews& /*news*/) noexcept {}
  /// The force to show now, before ramp, damper and limits.
  virtual Vec3 force_h_n(const RenderPoint& at) noexcept = 0;
  virtual Vec3 damper_force_h_n() const noexcept { return Vec3::Zero(); }
  virtual double damper_n_s_m() const noexcept { return 0; }
  /// Largest norm of the force that may be committed; infinite for methods without a clamp.
  virtual double force_bound_n() const noexcept { return std::numeric_limits<double>::infinity(); }
  virtual double account_j() const noexcept = 0;  ///< the method's own account

  /// What the other side is believed to have given for good, once in a station's life, whatever the method,
  /// epoch or scale: of what it said that it gave, less what was sent to it and what has been forfeited
  /// since. Never above the sample's well, and a tank's grant besides; so that out ≤ in + E₀ + that.
  double credited_j() const noexcept { return credited_j_; }
  void set_credited_j(double credited_j) noexcept { credited_j_ = credited_j; }

  virtual void fill_command(SlaveOrder& order) const noexcept { order = {}; }

 protected:
  double credited_j_ = 0;
};

}  // namespace telenano::control

#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "telenano/common/control/method.h"
#include "telenano/common/recording/sample.h"
#include "telenano/master/station/station_config.h"
#include "tests/studies/stress/stress_hand.h"
#include "tests/studies/stress/watched_slave.h"

namespace telenano::studies::stress {

/// What must hold at every sample, and is looked at from outside: true positions, forces that really acted,
/// what the slave really did. Never by the product's own observer. Stored in tables: never renumber.
enum Invariant : std::uint32_t {
  /// Energy: extracted(k) = ΣF(k−1)·Δx − bΣ|Δx|²/T ≤ 2E₀ (one-port methods: E₀) + (U₀ − U_min) + Q + late,
  /// while |v| ≤ v_max; and after the least that it ever was, no more than the store besides. U₀ − U_min: passes_on_the_well(); with `twin` the scene's, once. late: a tick
  /// that comes k periods late may
  /// overdraw once by (k−1)|F|·v_max·T.
  kInvariantEnergy = 1u << 0,
  /// Two ports: hand and slave together have got no more than 2E₀ + Q + late (methods that balance both).
  kInvariantBalance = 1u << 1,
  kInvariantSums = 1u << 2,   ///< sums of energy never fall: the station's, and each slave's in its epoch
  kInvariantForce = 1u << 3,  ///< |F| ≤ ε f̂_a
  /// |F| grows by no more than slew·T a tick along its new direction, also where stop, clamp or force limit
  /// act: they can only take away. How often they act is counted.
  kInvariantSlew = 1u << 4,
  /// No force later than stale_zero_s after the last new reply, from stale_hold_s on less with each tick, and none at
  /// all over a link that is too long for the method; where replies wait to be shown, after the
  /// last that was shown, which is no later after it came than the longest wait and the longest late tick.
  kInvariantStale = 1u << 5,
  kInvariantLeap = 1u << 6,    ///< back after such a silence: from no force one tick of the ramp at most
  kInvariantTip = 1u << 7,     ///< the slave's force within its own limit
  kInvariantFinite = 1u << 8,  ///< no NaN, no infinity
  /// The product's observer says what the true account says, up to Q.
  kInvariantAccount = 1u << 9,
  kInvariantDamper = 1u << 10,   ///< injected damping within γ ≤ b − KT/2 − |B|
  kInvariantRecover = 1u << 11,  ///< on an otherwise clean link a session is back in 3 s + 10 RTT
  kInvariantRepeat = 1u << 12,   ///< the same run again gives the same bits
  /// Calm runs (felt_limits.h), beside the same sample felt without link and delay: how far off, the lateral
  /// force, when it comes, the pull-off.
  kInvariantFelt = 1u << 13,
  kInvariantLateral = 1u << 14,
  kInvariantInTime = 1u << 15,
  kInvariantPull = 1u << 16,
  kInvariantRefusal = 1u << 17,  ///< a change of scale that was refused changed something
  /// A row is what was: the hand's place when the tick began, the force that acts from then on, each tick
  /// once, in time (record_watch.h).
  kInvariantRecord = 1u << 18,
  /// Of a run in which replies are left out: the last one that left the server still says what the slave does
  /// (reply_watch.h).
  kInvariantReplies = 1u << 19,
  /// Each slave's sums of energy are the work at its port (port_watch.h).
  kInvariantWork = 1u << 20,
  /// A slave rises when it has been told to stop, or has heard nothing for as long as its session may be silent.
  kInvariantWithdraw = 1u << 21,
  /// Hand and tip at rest, the tip is where the hand has led it.
  kInvariantFollow = 1u << 22,
  kInvariantLead = 1u << 23,  ///< the hand leads the target, and it alone (lead_watch.h)
  kInvariantLetGo =
      1u << 24,  ///< neither motion nor force for a hand that has let go, or has stopped (lead_watch.h)
  kInvariantJump = 1u << 25,  ///< what the operator changes makes no step of the force (lead_watch.h)
  kInvariantSent = 1u << 26,  ///< what the station sends says where the hand leads, in time (command_watch.h)
  kInvariantPath = 1u << 27,  ///< the slave goes to what was sent, in its order (command_watch.h)
  kInvariantTrip = 1u << 28,  ///< a hand that was faster than the trip speed has stopped the station
};
constexpr int kInvariants = 29;
const char* invariant_name(std::uint32_t bit) noexcept;
std::string invariant_names(std::uint32_t bits);  ///< "energy+slew"; "none"

/// What a method is held to. All are held to all but: `none`, `ks`, `tdpa`, `wave` promise no energy (they
/// are baselines: their violations are shown as they are), `ks` no cap of its damper, nor that it comes by the ramp.
std::uint32_t promised(control::Method method) noexcept;

/// 2E₀, or E₀ for methods that promise it of one port (`ks-clamp`, `model`, `twin`), J.
double promised_extraction_j(control::Method method, double allowance_j) noexcept;

/// Where a sample's potential falls (a tip that snaps in), what it gives may reach the hand: U₀ − U_min, none
/// of it made by control. Not with `ks-clamp`, which pays for every force from the hand's own port.
bool passes_on_the_well(control::Method method) noexcept;

class InvariantWatch {
 public:
  struct Limits {
    control::Method method = control::Method::kModel;
    double allowance_j = 0.010;
    double velocity_max_m_s = 0.5;
    double trip_m_s = 0.5;
    double period_s = 1e-3;
    double force_limit_n = 0;
    double slew_n_s = 4000;
    double stale_zero_s = 0.1;
    double stale_hold_s = 0;  ///< from then on it fades; 0: not checked
    bool too_long = false;    ///< the link is: no force is shown
    /// What was put in and may come back: no more than this after the most that was ever in; infinite: not checked.
    double store_j = std::numeric_limits<double>::infinity();
    double ramp_s = 0.2;
    double tip_limit_nn = 0;
    double damper_cap_n_s_m = 0;
    bool balance = false;                                          ///< of both ports is to be checked
    double hand_j_per_aj = 0;                                      ///< α_F/α_v in these units
    double recover_s = 0;                                          ///< 0: not checked
    double well_most_j = std::numeric_limits<double>::infinity();  ///< finite: that, at any time
    double stop_s = 0;     ///< a stop is with the slave after so long; 0: not checked
    double silence_s = 0;  ///< after so long an outage it must have withdrawn; 0: not checked
    double waits_s = 0;    ///< longest that a reply waits to be shown; 0: it is shown when it comes
  };
  explicit InvariantWatch(const Limits& limits) : limits_(limits) {}

  /// What of a tick is not in its row.
  struct Around {
    double given_before_j = 0;  ///< by the true account, when the tick began
    double q_before_j = 0;      ///< its Q then
    /// When the link accepted its newest reply (numbers begin anew with sessions).
    std::int64_t reply_ns = 0;
    double time_s = 0;    ///< of the tick
    int periods = 1;      ///< until the next one
    double silent_s = 0;  ///< of an outage that is under way
  };
  /// After a tick of the station, and the hand's motion until the next one.
  void look(const recording::Sample& row, const StressHand& hand, const SlaveWatch& slave,
            const Around& around) noexcept;
  /// Link and server are well again from here on; how long until touch is back is measured.
  void well_again(double time_s) noexcept {
    well_since_s_ = time_s;
    waiting_ = true;
  }
  void not_well() noexcept { waiting_ = false; }
  void violate(std::uint32_t bit, double time_s) noexcept {
    if (violated_ == 0) first_s_ = time_s;
    violated_ |= bit;
  }

  std::uint32_t violated() const noexcept { return violated_; }
  double first_s() const noexcept { return first_s_; }  ///< −1: none
  double late_j() const noexcept { return late_j_; }
  double least_margin_j() const noexcept { return least_margin_j_; }
  double most_generated_j() const noexcept { return most_generated_j_; }
  double slowest_recovery_s() const noexcept { return recovery_s_; }  ///< −1: nothing to recover from

 private:
  Limits limits_;
  std::uint32_t violated_ = 0;
  double first_s_ = -1;
  double late_j_ = 0;
  double least_extracted_j_ = 0;
  double first_news_s_ = -1;
  double least_margin_j_ = 1e300;
  double most_generated_j_ = 0;
  Vec3 last_h_n_ = Vec3::Zero();
  Vec3 last_h_m_ = Vec3::Zero();
  double in_j_ = 0, out_j_ = 0;
  std::int64_t last_reply_ns_ = -1;
  double last_news_s_ = -1e9;  ///< was shown
  double last_came_s_ = -1e9;
  int latest_periods_ = 1;
  double last_tick_s_ = -1;
  double stopped_since_s_ = -1;  ///< −1: not stopped
  bool waiting_ = false;
  double well_since_s_ = 0;
  double recovery_s_ = -1;
};

}  // namespace telenano::studies::stress

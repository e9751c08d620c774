#pragma once

#include <cstdint>
#include <string>

#include "telenano/common/control/method.h"
#include "telenano/common/control/scaling.h"

namespace telenano::control {

/// Samples of delay with which a scaling is planned and beyond which it is refused, of the loop's own
/// `loop_delay_samples`:
///
///   none, ks
///     the loop's. What they show is passive only as far as the whole loop is: KS's damper acts after the
///     energy is out, and not at rest.
///   ks-clamp, tdpa, wave, tank, model
///     at most one. They pay for the way's delay themselves, by a bound on the energy given or by what they
///     put on the line, whatever its length. What no method can pay for is the sampling at the hand: a force
///     held for a period, and an answer used one tick later at the earliest.
int binding_delay_samples(Method method, int loop_delay_samples) noexcept;

/// The same with what is known of the device: `latency_samples`, an upper bound of how late its force acts,
/// measured together with a lower bound of its damping; negative: nobody has measured them.
///
///   twin
///     its force answers the position of the same tick, and nothing comes over the link. So that latency is all
///     of its delay; what is not measured is taken for one sample.
///   the others
///     as binding_delay_samples(), and not less than that latency.
double binding_delay(Method method, int loop_delay_samples, double latency_samples) noexcept;

/// What decides the scaling of a station, its device, its link and a slave.
struct ScalingPlanInput {
  Method method = Method::kNone;
  ScalingPlant plant{};              ///< delay_samples of the whole loop, see loop_delay_samples()
  double device_force_max_n = 12.0;  ///< f̂_a
  double force_safety = 0.8;         ///< ε
  double tip_force_max_nn = 0;       ///< f̂_e
  /// Edges of the cubes of KS fig. 10.
  double haptic_workspace_m = 0.1;
  double visual_workspace_m = 0.3;
  double nano_workspace_nm = 100;
  double velocity_scale = 0;     ///< α_v where it is given; 0: from the workspaces
  double device_latency_s = -1;  ///< upper bound, measured with the damping; negative: not measured
};

enum class BindingLimit : std::uint8_t {
  kPassivity,  ///< the device's damping, rate and coupling, and the delay that the method leaves to them
  kDevice,     ///< its greatest force
  kNothing     ///< no force scale is safe
};

/// A plan for the scaling factors.
///
///   k³ = W_haptic/W_visual, k'³ = W_visual/W_nano, α_v = 1/(k k')           [Kim & Sitti (KS), eqs. 18–20]
///
/// (the visual workspace cancels: it is k' that makes the picture). α_F then is bounded by the exact
/// sampled-data bound (scaling.h) at the method's delay, binding_delay_samples(), and by ε f̂_a/f̂_e [KS, eq.
/// 22], and KS maximise the Z-width, hence α_F, within the region. Recommended is the largest α_F of the
/// region, less kPlanMargin.
/// KS's cases, from Goldfarb's dimensional analysis: I, α_F = 1/α_v (high adhesion), II, α_F = 1/α_v² (low
/// adhesion); each is a choice only where it lies in the region.
struct ScalingPlan {
  double haptic_to_visual = 0;  ///< k
  double visual_to_nano = 0;    ///< k'
  Scaling scaling{};            ///< recommended; force 0 if nothing is safe
  BindingLimit binding = BindingLimit::kNothing;
  double published_force_scale = 0;  ///< Llewellyn's: for comparison, 4 to 17 times too permissive
  double sampled_force_scale = 0;    ///< exact, were there no delay
  double delayed_force_scale = 0;    ///< exact, with the loop's delay
  double passive_force_scale = 0;    ///< exact, with the delay that binds this method
  double binding_delay_samples = 0;  ///< binding_delay()
  double device_force_scale = 0;     ///< ε f̂_a/f̂_e
  double case_one_force_scale = 0;   ///< 1/α_v
  double case_two_force_scale = 0;   ///< 1/α_v²
  bool case_one_safe = false;
  bool case_two_safe = false;
  double passive_wall_n_m = 0;     ///< Z-width: stiffest passive pure spring of this device, no delay: 2b/T
  double delayed_wall_n_m = 0;     ///< the same at the loop's delay d: 2b/((1 + 2d)T)
  double shown_stiffness_n_m = 0;  ///< α_v α_F k_c as recommended
  double felt_force_max_n = 0;     ///< α_F f̂_e as recommended
  /// The largest force would be less than kNoticedForceN: safe, and of no use.
  bool too_weak_to_feel = false;
};

inline constexpr double kPlanMargin = 0.01;
/// About what a hand that holds a handle begins to notice; an assumption.
inline constexpr double kNoticedForceN = 0.05;

/// Throws UserError, naming the value, for one that is not finite or not in its range.
ScalingPlan plan_scaling(const ScalingPlanInput& input);

/// In plain words, one line: which limit binds, and what would move it; and where touch would be of no use.
std::string plan_reason(const ScalingPlanInput& input, const ScalingPlan& plan);

/// Samples between a position read and the force that answers it, over a link: a command leaves after its
/// tick's force, so its answer is used in the next tick at the earliest, and `rtt_s` later rounded up.
int loop_delay_samples(double rtt_s, double period_s) noexcept;

}  // namespace telenano::control

#pragma once

#include <cstdint>
#include <string>

#include "common/control/scaling.h"

namespace telenano::control {

/// What decides the scaling of a station, its device, its link and a slave.
struct ScalingPlanInput {
  ScalingPlant plant{};              ///< delay_samples of the whole loop, see loop_delay_samples()
  double device_force_max_n = 12.0;  ///< f̂_a
  double force_safety = 0.8;         ///< ε
  double tip_force_max_nn = 0;       ///< f̂_e
  /// Edges of the cubes of KS fig. 10.
  double haptic_workspace_m = 0.1;
  double visual_workspace_m = 0.3;
  double nano_workspace_nm = 100;
};

enum class BindingLimit : std::uint8_t {
  kPassivity,  ///< the device's damping, rate, coupling and delay
  kDevice,     ///< its greatest force
  kNothing     ///< no force scale is safe
};

/// A plan for the scaling factors.
///
///   k³ = W_haptic/W_visual, k'³ = W_visual/W_nano, α_v = 1/(k k')           [Kim & Sitti (KS), eqs. 18–20]
///
/// (the visual workspace cancels: it is k' that makes the picture). α_F then is bounded by the exact
/// sampled-data bound at the loop's delay (scaling.h) and by ε f̂_a/f̂_e [KS, eq. 22], and KS maximise the
/// Z-width, hence α_F, within the region. Recommended is the largest α_F of the region, less kPlanMargin.
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
  double device_force_scale = 0;     ///< ε f̂_a/f̂_e
  double case_one_force_scale = 0;   ///< 1/α_v
  double case_two_force_scale = 0;   ///< 1/α_v²
  bool case_one_safe = false;
  bool case_two_safe = false;
  double passive_wall_n_m = 0;     ///< Z-width: stiffest passive pure spring of this device, no delay: 2b/T
  double shown_stiffness_n_m = 0;  ///< α_v α_F k_c as recommended
};

inline constexpr double kPlanMargin = 0.01;

/// Throws UserError, naming the value, for one that is not finite or not in its range.
ScalingPlan plan_scaling(const ScalingPlanInput& input);

/// In plain words: which limit binds, and what would move it.
std::string plan_reason(const ScalingPlanInput& input, const ScalingPlan& plan);

/// Samples between a position read and the force that answers it, over a link: a command leaves after its
/// tick's force, so its answer is used in the next tick at the earliest, and `rtt_s` later rounded up.
int loop_delay_samples(double rtt_s, double period_s) noexcept;

}  // namespace telenano::control

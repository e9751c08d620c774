#include "common/control/scaling_plan.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "common/base/error.h"

namespace telenano::control {
namespace {

constexpr int kDelayMax = 10'000;

std::string number(double value) {
  std::array<char, 40> text{};
  return {text.data(),
          std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 4).ptr};
}

void require(bool good, const char* name, double value, const char* expected) {
  if (!good) throw UserError(std::string("plan: ") + name + " = " + number(value) + ", expected " + expected);
}

void validate(const ScalingPlanInput& in) {
  const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
  const auto not_negative = [](double x) { return std::isfinite(x) && x >= 0; };
  const ScalingPlant& p = in.plant;
  require(not_negative(p.device_damping_n_s_m), "device damping", p.device_damping_n_s_m, ">= 0 N s/m");
  require(not_negative(p.adaptive_damping_n_s_m), "adaptive damping", p.adaptive_damping_n_s_m, ">= 0 N s/m");
  require(positive(p.coupling_stiffness_n_m), "coupling stiffness", p.coupling_stiffness_n_m, "> 0 N/m");
  require(not_negative(p.coupling_damping_n_s_m), "coupling damping", p.coupling_damping_n_s_m, ">= 0 N s/m");
  require(positive(p.period_s) && p.period_s <= 1, "period", p.period_s, "(0, 1] s");
  require(p.delay_samples >= 0 && p.delay_samples <= kDelayMax, "delay", p.delay_samples,
          "0 to 10000 samples");
  require(positive(in.device_force_max_n), "device force", in.device_force_max_n, "> 0 N");
  require(in.force_safety > 0 && in.force_safety <= 1, "force safety", in.force_safety, "(0, 1]");
  require(positive(in.tip_force_max_nn), "tip force", in.tip_force_max_nn, "> 0 nN");
  require(positive(in.haptic_workspace_m), "haptic workspace", in.haptic_workspace_m, "> 0 m");
  require(positive(in.visual_workspace_m), "visual workspace", in.visual_workspace_m, "> 0 m");
  require(positive(in.nano_workspace_nm), "nano workspace", in.nano_workspace_nm, "> 0 nm");
}

}  // namespace

ScalingPlan plan_scaling(const ScalingPlanInput& in) {
  validate(in);
  ScalingPlan plan;
  plan.haptic_to_visual = in.haptic_workspace_m / in.visual_workspace_m;
  plan.visual_to_nano = in.visual_workspace_m * kNmPerM / in.nano_workspace_nm;
  const double velocity = 1 / (plan.haptic_to_visual * plan.visual_to_nano);
  ScalingPlant at_once = in.plant;
  at_once.delay_samples = 0;
  // γ beyond b leaves nothing that is safe.
  plan.published_force_scale = llewellyn_impedance_bound(at_once) / velocity;
  plan.sampled_force_scale = std::max(0.0, exact_impedance_bound(at_once)) / velocity;
  plan.delayed_force_scale = std::max(0.0, exact_impedance_bound(in.plant)) / velocity;
  plan.device_force_scale =
      device_force_scale_bound(in.force_safety, in.device_force_max_n, in.tip_force_max_nn);
  plan.case_one_force_scale = 1 / velocity;
  plan.case_two_force_scale = 1 / (velocity * velocity);
  const double largest = std::min(plan.delayed_force_scale, plan.device_force_scale);
  plan.case_one_safe = plan.case_one_force_scale <= largest;
  plan.case_two_safe = plan.case_two_force_scale <= largest;
  plan.binding = !(largest > 0)                                       ? BindingLimit::kNothing
                 : plan.delayed_force_scale < plan.device_force_scale ? BindingLimit::kPassivity
                                                                      : BindingLimit::kDevice;
  plan.scaling = {velocity, (1 - kPlanMargin) * largest};
  plan.passive_wall_n_m = 2 * in.plant.device_damping_n_s_m / in.plant.period_s;
  plan.shown_stiffness_n_m = plan.scaling.impedance() * in.plant.coupling_stiffness_n_m;
  return plan;
}

std::string plan_reason(const ScalingPlanInput& in, const ScalingPlan& plan) {
  switch (plan.binding) {
    case BindingLimit::kNothing:
      return "no force scale is safe: the device needs certain damping of its own, more than the adaptive "
             "damper's " +
             number(in.plant.adaptive_damping_n_s_m) + " N s/m";
    case BindingLimit::kDevice:
      return "the device's force binds: beyond a force scale of " + number(plan.device_force_scale) +
             " the slave's largest force, " + number(in.tip_force_max_nn) + " nN, would ask for more than " +
             number(in.force_safety * in.device_force_max_n) + " N; passivity would allow " +
             number(plan.delayed_force_scale);
    case BindingLimit::kPassivity:
      break;
  }
  return "passivity binds: with " + number(in.plant.device_damping_n_s_m) +
         " N s/m of its own damping, a period of " + number(1e3 * in.plant.period_s) + " ms and " +
         std::to_string(in.plant.delay_samples) + (in.plant.delay_samples == 1 ? " sample" : " samples") +
         " of delay the device shows a coupling of " + number(in.plant.coupling_stiffness_n_m) +
         " N/m passively up to a force scale of " + number(plan.delayed_force_scale) +
         "; without the delay it would be " + number(plan.sampled_force_scale) +
         ", and its greatest force would allow " + number(plan.device_force_scale);
}

int loop_delay_samples(double rtt_s, double period_s) noexcept {
  if (!(rtt_s > 0)) return 1;
  // An answer just in time for a tick counts for that tick: a round trip of two periods written in decimals
  // is two samples, not three.
  const double samples = std::ceil(rtt_s / period_s * (1 - 1e-12));
  return static_cast<int>(std::clamp(samples, 1.0, static_cast<double>(kDelayMax)));
}

}  // namespace telenano::control

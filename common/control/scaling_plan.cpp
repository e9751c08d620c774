#include "telenano/common/control/scaling_plan.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "telenano/common/base/error.h"
#include "telenano/common/control/z_width.h"

namespace telenano::control {
namespace {

constexpr int kDelayMax = 10'000;
constexpr double kVelocityScaleMin = 1e-12;

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
  require(!(in.device_latency_s > 1), "device latency", in.device_latency_s, "at most 1 s");
  require(positive(in.device_force_max_n), "device force", in.device_force_max_n, "> 0 N");
  require(in.force_safety > 0 && in.force_safety <= 1, "force safety", in.force_safety, "(0, 1]");
  require(positive(in.tip_force_max_nn), "tip force", in.tip_force_max_nn, "> 0 nN");
  require(positive(in.haptic_workspace_m), "haptic workspace", in.haptic_workspace_m, "> 0 m");
  require(positive(in.visual_workspace_m), "visual workspace", in.visual_workspace_m, "> 0 m");
  require(positive(in.nano_workspace_nm), "nano workspace", in.nano_workspace_nm, "> 0 nm");
  require(not_negative(in.velocity_scale), "velocity scale", in.velocity_scale, "> 0");
}

std::string samples(double count) {
  return number(count) + (count == 1 ? " sample" : " samples");
}

}  // namespace

int binding_delay_samples(Method method, int loop_delay_samples) noexcept {
  switch (method) {
    case Method::kNone:
    case Method::kKs:
      break;
    case Method::kKsClamp:
    case Method::kTdpa:
    case Method::kWave:
    case Method::kTank:
    case Method::kModel:
    case Method::kTwin:
      return std::min(loop_delay_samples, 1);
  }
  return loop_delay_samples;
}

double binding_delay(Method method, int loop_delay_samples, double latency_samples) noexcept {
  if (!(latency_samples >= 0)) return binding_delay_samples(method, loop_delay_samples);
  if (method == Method::kTwin) return latency_samples;
  return std::max<double>(binding_delay_samples(method, loop_delay_samples), latency_samples);
}

ScalingPlan plan_scaling(const ScalingPlanInput& in) {
  validate(in);
  ScalingPlan plan;
  plan.haptic_to_visual = in.haptic_workspace_m / in.visual_workspace_m;
  plan.visual_to_nano = in.visual_workspace_m * kNmPerM / in.nano_workspace_nm;
  const double velocity =
      in.velocity_scale > 0 ? in.velocity_scale : 1 / (plan.haptic_to_visual * plan.visual_to_nano);
  require(velocity >= kVelocityScaleMin && velocity <= 1, "velocity scale", velocity,
          "1e-12 to 1: the tip's workspace is smaller than the hand's");
  ScalingPlant at_once = in.plant;
  at_once.delay_samples = 0;
  plan.binding_delay_samples =
      binding_delay(in.method, in.plant.delay_samples, in.device_latency_s / in.plant.period_s);
  // γ beyond b leaves nothing that is safe.
  plan.published_force_scale = llewellyn_impedance_bound(at_once) / velocity;
  plan.sampled_force_scale = std::max(0.0, exact_impedance_bound(at_once)) / velocity;
  plan.delayed_force_scale = std::max(0.0, exact_impedance_bound(in.plant)) / velocity;
  plan.passive_force_scale =
      std::max(0.0, exact_impedance_bound(in.plant, plan.binding_delay_samples)) / velocity;
  plan.device_force_scale =
      device_force_scale_bound(in.force_safety, in.device_force_max_n, in.tip_force_max_nn);
  plan.case_one_force_scale = 1 / velocity;
  plan.case_two_force_scale = 1 / (velocity * velocity);
  const double largest = std::min(plan.passive_force_scale, plan.device_force_scale);
  plan.case_one_safe = plan.case_one_force_scale <= largest;
  plan.case_two_safe = plan.case_two_force_scale <= largest;
  plan.binding = !(largest > 0)                                       ? BindingLimit::kNothing
                 : plan.passive_force_scale < plan.device_force_scale ? BindingLimit::kPassivity
                                                                      : BindingLimit::kDevice;
  plan.scaling = {velocity, (1 - kPlanMargin) * largest};
  const HapticDisplay display{in.plant.device_damping_n_s_m, 0, in.plant.period_s};
  const auto wall = [&](int delay_samples) {  // none where there is no damping
    const double stiffness = passive_stiffness_closed(display, {0, 0, delay_samples});
    return std::isnan(stiffness) ? 0.0 : stiffness;
  };
  plan.passive_wall_n_m = wall(0);
  plan.delayed_wall_n_m = wall(in.plant.delay_samples);
  plan.shown_stiffness_n_m = plan.scaling.impedance() * in.plant.coupling_stiffness_n_m;
  plan.felt_force_max_n = plan.scaling.force / kNanonewtonPerNewton * in.tip_force_max_nn;
  plan.too_weak_to_feel = plan.felt_force_max_n < kNoticedForceN;
  return plan;
}

std::string plan_reason(const ScalingPlanInput& in, const ScalingPlan& plan) {
  const std::string damping = number(in.plant.device_damping_n_s_m) + " N s/m of its own damping";
  if (plan.binding == BindingLimit::kNothing) {
    return in.plant.adaptive_damping_n_s_m > 0
               ? "no force scale is safe: the adaptive damper is sampled too, and its " +
                     number(in.plant.adaptive_damping_n_s_m) + " N s/m leave nothing of the device's " +
                     damping
               : "no force scale is safe: a force held between samples puts energy into the hand, which only "
                 "damping of the device itself can take up for certain, and this one has " +
                     damping;
  }
  if (plan.too_weak_to_feel && plan.binding == BindingLimit::kPassivity) {
    return "nothing that could be felt is safe: with " + damping + " and " +
           samples(plan.binding_delay_samples) + " of delay the slave's largest force, " +
           number(in.tip_force_max_nn) + " nN, may come to " + number(plan.felt_force_max_n) +
           " N at most, and a hand notices about " + number(kNoticedForceN) +
           " N; a shorter way or a method that does not rest on the loop would help";
  }
  if (plan.binding == BindingLimit::kDevice) {
    return "the device's force binds: beyond a force scale of " + number(plan.device_force_scale) +
           " the slave's largest force, " + number(in.tip_force_max_nn) + " nN, would ask for more than " +
           number(in.force_safety * in.device_force_max_n) + " N; passivity would allow " +
           number(plan.passive_force_scale);
  }
  const bool rests_on_twin = in.method == Method::kTwin && in.device_latency_s >= 0;
  return "passivity binds: with " + damping + ", a period of " + number(1e3 * in.plant.period_s) +
         " ms and " + samples(plan.binding_delay_samples) + " of delay the device shows a coupling of " +
         number(in.plant.coupling_stiffness_n_m) + " N/m passively up to a force scale of " +
         number(plan.passive_force_scale) + "; without the delay it would be " +
         number(plan.sampled_force_scale) + ", and its greatest force would allow " +
         number(plan.device_force_scale) +
         (rests_on_twin ? "; planned for the twin alone, whose force waits for no answer: the delay is the "
                          "device's latency as measured, and without the twin a lower scale takes its place"
                        : "");
}

int loop_delay_samples(double rtt_s, double period_s) noexcept {
  if (!(rtt_s > 0)) return 1;
  // An answer just in time for a tick counts for that tick: a round trip of two periods written in decimals
  // is two samples, not three.
  const double samples = std::ceil(rtt_s / period_s * (1 - 1e-12));
  return static_cast<int>(std::clamp(samples, 1.0, static_cast<double>(kDelayMax)));
}

}  // namespace telenano::control

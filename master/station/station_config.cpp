#include "telenano/master/station/station_config.h"

#include <array>
#include <charconv>
#include <cmath>

#include "telenano/common/base/error.h"
#include "telenano/common/control/scaling_plan.h"

namespace telenano::station {
namespace {

std::string number(double value) {
  std::array<char, 40> text{};
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 6).ptr;
  return {text.data(), end};
}

/// To four digits, never up, so that a bound typed in as it was printed is kept: rounding adds at most 5e-4
/// of it.
std::string rounded_down(double value) {
  std::array<char, 40> text{};
  const double less = value * (1 - 5e-4);
  return {text.data(),
          std::to_chars(text.data(), text.data() + text.size(), less, std::chars_format::general, 4).ptr};
}

std::string samples(double count) {
  return number(count) + (count == 1 ? " sample" : " samples") + " of delay";
}

}  // namespace

double StationConfig::age_most_s(control::Method shown) const noexcept {
  if (shown == control::Method::kTwin) return HUGE_VAL;
  if (force_age_s > 0) return force_age_s;
  if (shown == control::Method::kModel) return 0.8;
  return control::needs_port_control(shown) ? 0.5 : 0.4;
}

void StationConfig::validate(const std::string& source) const {
  const auto require = [&](bool good, const char* key, double value, const std::string& range) {
    if (!good) throw UserError(source + ": " + key + " = " + number(value) + ", expected " + range);
  };
  const auto between = [](double value, double low, double high) { return value >= low && value <= high; };
  require(between(rate_hz, 10, 8000), "rate_hz", rate_hz, "10 to 8000");
  require(between(scaling.velocity, kVelocityScaleMin, kVelocityScaleMax), "scaling.velocity",
          scaling.velocity, "1e-12 to 1");
  require(between(scaling.force, kForceScaleMin, kForceScaleMax), "scaling.force", scaling.force,
          "1 to 1e12");
  require(between(store_max_j, 1e-3, 1e6), "control.store_max_j", store_max_j, "0.001 to 1e6");
  require(between(companding.gain, 1, kCompandingGainMax), "companding.gain", companding.gain, "1 to 10");
  require(between(companding.energy_aj, 1e-3, 1e4), "companding.energy_aj", companding.energy_aj,
          "0.001 to 1e4");
  require(between(leak_time_s, 0, 1e6), "control.leak_time_s", leak_time_s, "0 (never) to 1e6");
  require(between(allowance_j, 1e-6, 1), "control.allowance_j", allowance_j, "1e-6 to 1");
  require(between(well_max_j, 0, 10), "control.well_max_j", well_max_j, "0 to 10");
  require(between(guaranteed_velocity_m_s, 0.01, 5), "control.guaranteed_velocity_m_s",
          guaranteed_velocity_m_s, "0.01 to 5");
  require(between(trip_velocity_m_s, 0.01, guaranteed_velocity_m_s), "limits.trip_velocity_m_s",
          trip_velocity_m_s, "0.01 to control.guaranteed_velocity_m_s = " + number(guaranteed_velocity_m_s));
  require(between(force_safety, 0.01, 1), "limits.force_safety", force_safety, "0.01 to 1");
  require(between(slew_n_s, 1, 1e6), "limits.slew_n_s", slew_n_s, "1 to 1e6");
  require(between(stale_hold_s, 0, 0.020), "limits.stale_hold_s", stale_hold_s, "0 to 0.02");
  require(stale_zero_s > stale_hold_s && stale_zero_s <= 0.100, "limits.stale_zero_s", stale_zero_s,
          "more than limits.stale_hold_s = " + number(stale_hold_s) + ", at most 0.1");
  require(force_age_s == 0 || between(force_age_s, 0.05, 10), "limits.force_age_s", force_age_s,
          "0.05 to 10, or 0 (by the method)");
  require(between(engage_ramp_s, 0.01, 10), "limits.engage_ramp_s", engage_ramp_s, "0.01 to 10");
  require(device_damping_n_s_m < 0 || between(device_damping_n_s_m, 0, 1000), "device.damping_n_s_m",
          device_damping_n_s_m, "0 to 1000, or negative for what the device reports");
  require(device_latency_s < 0 || between(device_latency_s, 0, 0.1), "device latency, s", device_latency_s,
          "0 to 0.1, or negative where it was not measured");
  require(impedance_without_twin == 0 || between(impedance_without_twin, 1e-12, 1e12),
          "impedance without the twin", impedance_without_twin, "more than 0, or 0: the same");
}

ScalingCheck check_scaling(const StationConfig& config, const device::DeviceInfo& device,
                           const SlavePort& slave, int delay_samples) {
  control::ScalingPlant plant;
  plant.device_damping_n_s_m =
      config.device_damping_n_s_m < 0 ? device.damping_n_s_m : config.device_damping_n_s_m;
  plant.coupling_stiffness_n_m = slave.coupling_stiffness_n_m;
  plant.coupling_damping_n_s_m = slave.coupling_damping_n_s_m;
  plant.period_s = 1 / config.rate_hz;
  plant.delay_samples = delay_samples;
  ScalingCheck check;
  check.loop_bound = control::exact_impedance_bound(plant);
  const double binding =
      control::binding_delay(config.method, delay_samples, config.device_latency_s * config.rate_hz);
  check.impedance = config.scaling.impedance();
  check.exact_bound = control::exact_impedance_bound(plant, binding);
  check.llewellyn_bound = control::llewellyn_impedance_bound(plant);
  check.device_force_scale =
      control::device_force_scale_bound(config.force_safety, device.force_max_n, slave.force_max_nn);
  check.shown_stiffness_n_m = check.impedance * slave.coupling_stiffness_n_m;
  check.safe = check.impedance <= check.exact_bound;
  check.saturates = config.scaling.force > check.device_force_scale;
  check.text = "velocity scale " + number(config.scaling.velocity) + " x force scale " +
               number(config.scaling.force) + " = " + number(check.impedance) +
               (check.safe ? ", within the " : ", more than the ") + number(check.exact_bound) +
               " that this device shows passively (damping " + number(plant.device_damping_n_s_m) +
               " N s/m, coupling " + number(slave.coupling_stiffness_n_m) + " N/m and " +
               number(slave.coupling_damping_n_s_m) + " N s/m, " + number(config.rate_hz) + " Hz, " +
               samples(binding) + ")";
  if (!check.safe) {
    const double force_scale = check.exact_bound / config.scaling.velocity;
    check.advice = !(check.exact_bound > 0) ? std::string("no scaling is safe without damping of the device")
                   : force_scale > 2 * kForceScaleMin
                       ? "lower --force-scale (scaling.force) to " + rounded_down(force_scale) + " or less"
                       : std::string("lower --velocity-scale (scaling.velocity)");
    check.advice += ", or insist with --allow-unsafe-scaling";
  } else if (check.impedance > check.loop_bound) {
    check.note = "with " + samples(delay_samples) + " the loop alone is passive only up to " +
                 number(check.loop_bound) + " of velocity scale x force scale; beyond it " +
                 std::string(control::method_name(config.method)) +
                 " keeps the energy within its bound by taking force away";
  }
  return check;
}

}  // namespace telenano::station

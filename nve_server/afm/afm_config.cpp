#include "telenano/nve_server/afm/afm_config.h"

#include <filesystem>

#include "telenano/common/config/toml_document.h"
#include "telenano/nve_server/afm/across_rule.h"

namespace telenano::afm {

using config::between;
using config::TomlTable;

AfmConfig load_afm_config(const std::string& path) {
  const config::TomlDocument document = config::TomlDocument::load(path);
  const TomlTable root = document.root();
  AfmConfig c;
  c.path = path;
  const TomlTable signals = root.table("signals");
  c.deflection_signal = static_cast<int>(signals.integer("deflection", 0, 4095));
  c.lateral_signal = static_cast<int>(signals.integer("lateral", 0, 4095));
  if (c.lateral_signal == c.deflection_signal) signals.fail("lateral", "the same signal as deflection");

  c.range_v = signals.number_or("range_v", between(0.1, 1000), AfmConfig{}.range_v);

  const TomlTable calibration = root.table("calibration");
  c.z_sign = static_cast<int>(calibration.integer("z_sign", -1, 1));
  if (c.z_sign == 0)
    calibration.fail("z_sign", "expected 1 (larger Z is away from the sample) or -1 (towards it)");
  c.sensitivity_nm_v = calibration.number("sensitivity_nm_v", between(-1e4, 1e4));
  if (c.sensitivity_nm_v == 0)
    calibration.fail("sensitivity_nm_v", "0 is not possible; expected nm per volt, with its sign");
  c.spring_constant_n_m = calibration.number("spring_constant_n_m", between(0.001, 1000));
  c.lateral_nn_v = calibration.number("lateral_nn_v", between(-1e6, 1e6));
  c.across_n_m = calibration.number_or("across_n_m", between(0.1, 1e5), AfmConfig{}.across_n_m);
  c.along_part = calibration.number_or("along_part", between(0, 2), AfmConfig{}.along_part);

  const AfmConfig standard;
  if (const auto t = root.optional_table("limits")) {
    c.speed_nm_s = t->number_or("speed_nm_s", between(100, 50000), standard.speed_nm_s);
    c.step_nm = t->number_or("step_nm", between(0.01, 5), standard.step_nm);
    c.force_max_nn = t->number_or("force_max_nn", between(0.01, 1e5), standard.force_max_nn);
    c.lateral_max_nn = t->number_or("lateral_max_nn", between(0.01, 1e5), standard.lateral_max_nn);
    c.slope_max = t->number_or("slope_max", between(0, 5), standard.slope_max);
    c.relief_nm = t->number_or("relief_nm", between(0, 1e5), standard.relief_nm);
    c.along_slope = t->number_or("along_slope", between(0, 100), standard.along_slope);
    c.half_width_nm = t->number_or("half_width_nm", between(1, 1e6), standard.half_width_nm);
    c.top_nm = t->number_or("top_nm", between(1, 1e5), standard.top_nm);
    c.depth_nm = t->number_or("depth_nm", between(0, 1e5), standard.depth_nm);
    c.drift_max_nm_s = t->number_or("drift_max_nm_s", between(0.001, 1000), standard.drift_max_nm_s);
  }
  if (const auto t = root.optional_table("timing")) {
    c.force_rate_hz = t->number_or("force_rate_hz", between(5, 2000), standard.force_rate_hz);
    c.link_loss_ms = t->number_or("link_loss_ms", between(10, 10000), standard.link_loss_ms);
    c.reply_timeout_ms = t->number_or("reply_timeout_ms", between(10, 10000), standard.reply_timeout_ms);
    if (t->has("stale_force_ms")) c.stale_force_ms = t->number("stale_force_ms", between(10, 10000));
    if (c.stale_force_ms > 0 && 1e-3 * c.stale_force_ms < 1.5 * c.period_s())
      t->fail("stale_force_ms", "less than one and a half periods of force_rate_hz");
  }
  if (const auto t = root.optional_table("approach")) {
    c.lift_nm = t->number_or("lift_nm", between(2, 1e4), standard.lift_nm);
    c.tare_readings = static_cast<int>(t->integer_or("tare_readings", 2, 10000, standard.tare_readings));
    c.touch_force_nn = t->number_or("touch_force_nn", between(0.01, 1e5), standard.touch_force_nn);
    c.touch_pause_s = t->number_or("touch_pause_s", between(0.1, 600), standard.touch_pause_s);
    c.timeout_s = t->number_or("timeout_s", between(1, 3600), standard.timeout_s);
    c.withdraw_nm_s = t->number_or("withdraw_nm_s", between(1000, 1e6), standard.withdraw_nm_s);
    c.park_after_s = t->number_or("park_after_s", between(1, 1e5), standard.park_after_s);
    if (c.touch_force_nn > 0.5 * c.force_max_nn) t->fail("touch_force_nn", "more than half of force_max_nn");
    if (c.along_slope > 0 &&
        AlongRule({c.across_n_m, c.lateral_max_nn, c.along_slope, c.along_part}).force_down_nn(0) <
            c.touch_force_nn)
      t->fail("touch_force_nn", "more than limits.along_slope leaves of the force down (0: not known)");
    if (c.lift_nm > c.top_nm) t->fail("lift_nm", "above the workspace: more than limits.top_nm");
  }
  if (const auto t = root.optional_table("deadman")) {
    const std::string key = t->text("key");
    if (key.empty()) t->fail("key", "expected the name of a file");
    c.deadman_key = (std::filesystem::path(path).parent_path() / key).string();
  }
  document.finish();
  return c;
}

}  // namespace telenano::afm

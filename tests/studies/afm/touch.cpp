#include "tests/studies/afm/touch.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "telenano/common/base/error.h"
#include "telenano/common/config/shared_files.h"
#include "telenano/nve_server/afm_sim/default_scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/support/virtual_afm_slave.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies {
namespace {

// Both levels are held for two seconds; judged is the last one of each.
constexpr double kFirstFromS = 3.5, kFirstToS = 4.5, kSecondFromS = 6.0, kSecondToS = 7.0;

std::vector<device::IntendedMotion::Waypoint> press(double height_nm) {
  return {{0, {0, 0, height_nm}}, {1.5, {0, 0, 2}},   {2.5, {0, 0, -4}}, {4.5, {0, 0, -4}},
          {5.0, {0, 0, -14}},     {7.0, {0, 0, -14}}, {8.5, {0, 0, 20}}, {9.5, {0, 0, 20}}};
}

/// A virtual environment whose coupling is as good as rigid, as an AFM has none.
std::shared_ptr<const scene::Scene> stiffly_coupled() {
  const std::string path = config::find_shared("flat_silicon_oxide", "scenes", ".toml");
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  std::string toml = text.str();
  const std::string soft = "stiffness_n_m = 20.0";
  const auto at = toml.find(soft);
  if (at == std::string::npos) throw RunError(path + ": no coupling of 20 N/m");
  toml.replace(at, soft.size(), "stiffness_n_m = 1000.0");
  return scene::parse_scene(toml, path);
}

struct Level {
  double force_n = 0, hand_m = 0, tip_nn = 0, base_nm = 0;
  double low_n = 1e300, high_n = -1e300;
  int n = 0;
  void add(double force, double hand, double tip, double base) {
    force_n += force;
    hand_m += hand;
    tip_nn += tip;
    base_nm += base;
    low_n = std::min(low_n, force);
    high_n = std::max(high_n, force);
    ++n;
  }
  void finish() {
    const double k = std::max(n, 1);
    force_n /= k, hand_m /= k, tip_nn /= k, base_nm /= k;
  }
};

}  // namespace

TouchResult run_touch(const TouchConfig& config) {
  TouchResult result;
  result.config = config;
  support::VirtualSessionConfig session_config;
  support::VirtualAfmSlave* afm = nullptr;
  slave::NveSlave* nve = nullptr;
  double height_nm = 0;
  if (config.afm) {
    afm::AfmConfig afm_config;
    afm_config.force_rate_hz = config.force_rate_hz;
    afm_config.force_max_nn = 400;
    afm_config.link_loss_ms = 200;
    afm_sim::SimConfig rig;
    rig.seed = config.seed;
    const auto ready = std::make_shared<support::VirtualAfm>(
        support::approached(afm_config, rig, afm_sim::default_scene(), config.seed));
    height_nm = afm_config.lift_nm;
    session_config.make_slave = [ready, &afm] {
      auto made = std::make_unique<support::VirtualAfmSlave>(*ready);
      afm = made.get();
      return made;
    };
  } else {
    const auto scene = stiffly_coupled();
    height_nm = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
    session_config.make_slave = [scene, &nve] {
      auto made = std::make_unique<slave::NveSlave>(scene);
      nve = made.get();
      return made;
    };
  }
  session_config.station.method = config.method;
  session_config.task = config.presses ? device::Task::kScript : config.task;
  session_config.script = press(height_nm);
  session_config.seed = config.seed;
  session_config.to_server.delay_ns = session_config.to_station.delay_ns =
      static_cast<std::int64_t>(0.5e9 * config.rtt_s);
  support::VirtualSession session(session_config);
  const double impedance = session_config.station.scaling.impedance();

  Level first, second;
  double age = 0, lag2 = 0;
  std::int64_t engaged = 0;
  std::uint64_t row = 0;
  session.run(16000, [&](const recording::Sample& s) {
    if (!session.device().motion_started()) return;
    const double t = session.device().motion_time_s();
    const double hand_n = s.hand_force_applied_h_n[2], hand_m = s.hand_pos_h_m[2];
    const double true_nn =
        afm != nullptr ? afm->afm().controller().tip().force_w_nn().z() : nve->trace().tip.force_w_nn.z();
    const double base_nm =
        afm != nullptr ? afm->afm().controller().tip().base_w_nm().z() : nve->trace().commanded_end_w_nm.z();
    result.peak_tip_nn = std::max(result.peak_tip_nn, true_nn);
    if (result.touched_s < 0 && true_nn > 5) result.touched_s = t;
    if (t >= kFirstFromS && t < kFirstToS) first.add(hand_n, hand_m, true_nn, base_nm);
    if (t >= kSecondFromS && t < kSecondToS) second.add(hand_n, hand_m, true_nn, base_nm);
    result.extracted_mj = std::max(result.extracted_mj, -1e3 * s.energy_j);
    result.stopped = result.stopped || s.station_faults != 0 || (s.fault_bits & link::kFaultRetracted) != 0;
    age += s.measurement_age_ms;
    const double lag = s.tip_target_w_nm[2] - s.tip_pos_w_nm[2] + s.deflection_nm;
    lag2 += lag * lag;
    ++engaged;
    if (row++ % 10 == 0)
      result.rows.push_back({t, s.tip_target_w_nm[2], s.tip_pos_w_nm[2], true_nn, 1e3 * hand_m, hand_n});
  });
  first.finish();
  second.finish();
  if (config.presses && first.n > 0 && second.n > 0) {
    result.stiffness_n_m = (second.force_n - first.force_n) / (first.hand_m - second.hand_m);
    result.port_n_m = impedance * (second.tip_nn - first.tip_nn) / (first.base_nm - second.base_nm);
    result.static_tip_nn = second.tip_nn;
    result.swing_part = std::max((first.high_n - first.low_n) / std::max(std::fabs(first.force_n), 1e-9),
                                 (second.high_n - second.low_n) / std::max(std::fabs(second.force_n), 1e-9));
  }
  if (engaged > 0) {
    result.age_ms = age / static_cast<double>(engaged);
    result.lag_nm = std::sqrt(lag2 / static_cast<double>(engaged));
  }
  return result;
}

}  // namespace telenano::studies

#include "tests/studies/fidelity/fidelity_grid.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "telenano/common/control/scaling_plan.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/studies/zwidth/on_all_cores.h"

namespace telenano::studies::fidelity {

ScenePairs::ScenePairs(const std::vector<const SceneMotion*>& motions) {
  for (const SceneMotion* m : motions) pairs_[m->scene];
  std::vector<std::pair<const std::string, Pair>*> list;
  for (auto& entry : pairs_) list.push_back(&entry);
  on_all_cores(2 * list.size(), [&](std::size_t i) {
    auto& [name, pair] = *list[i / 2];
    const std::shared_ptr<const scene::Scene> scene = scene::load_scene(name);
    if (i % 2 == 0) {
      pair.served = scene;
      pair.make_served = slave::nve_slaves(scene);
    } else {
      pair.make_truth = slave::nve_slaves(scene);
    }
  });
}

control::Scaling planned_scaling(const slave::SlaveLimits& limits, const device::PlantConfig& plant,
                                 double rate_hz, double velocity_scale) {
  control::ScalingPlanInput input;
  input.method = control::Method::kModel;
  input.plant.device_damping_n_s_m = plant.device_damping_n_s_m;
  input.plant.coupling_stiffness_n_m = limits.coupling_stiffness_n_m;
  input.plant.coupling_damping_n_s_m = limits.coupling_damping_n_s_m;
  input.plant.period_s = 1 / rate_hz;
  input.plant.delay_samples = 1;
  input.device_force_max_n = plant.force_max_n;
  input.force_safety = station::StationConfig{}.force_safety;
  input.tip_force_max_nn = limits.force_max_nn;
  input.velocity_scale = velocity_scale;
  return control::plan_scaling(input).scaling;
}

CellResult run_cell(const Cell& cell, const ScenePairs& scenes, const MakeMethod& stand_in) {
  const ScenePairs::Pair& pair = scenes.of(cell.motion->scene);
  TouchRun run;
  support::VirtualSessionConfig& session = run.session;
  session.scene = pair.served;
  session.make_slave = pair.make_served;
  session.station.method = cell.method;
  session.station.scaling = planned_scaling(pair.make_served()->limits(), session.plant,
                                            session.station.rate_hz, cell.motion->velocity_scale);
  session.station.allow_unsafe_scaling = true;  // `none` over a delay is beyond what is safe
  if (stand_in) session.make_method = [&] { return stand_in(session.station.scaling); };
  session.station.companding.gain = cell.compand;
  session.link_options.reply_deadband.permille = cell.reply_permille;
  run.companding = session.station.companding;
  session.twin = run.by_executed_log = cell.method == control::Method::kTwin && !stand_in;
  session.task = device::Task::kScript;
  session.script = cell.motion->script;
  session.seed = cell.seed;
  for (net::SimPath* path : {&session.to_server, &session.to_station}) {
    path->delay_ns = std::llround(0.5e6 * cell.rtt_ms);
    path->loss = cell.loss;
  }
  run.make_truth = pair.make_truth;
  run.after_s = 0.3 + 1e-3 * cell.rtt_ms;
  CellResult result;
  result.cell = cell;
  result.run = run_touch(run);
  result.metrics = measure(result.run.trace, 0.1 + 1.5e-3 * cell.rtt_ms);
  result.haptic = measure_haptic(result.run.trace, 0.1 + 1.5e-3 * cell.rtt_ms);
  if (!cell.keep_trace) result.run.trace = {};
  return result;
}

std::string cells_csv(const std::vector<CellResult>& results) {
  std::string csv =
      "scene,motion,method,rtt_ms,loss,nrmse,nrmse_between,nrmse_x,nrmse_y,nrmse_z,lateral_correlation,"
      "lag_ms,nrmse_at_lag,snap_in_true_n,snap_in_error,pull_off_true_n,pull_off_error,false_releases,work_"
      "true_mj,"
      "work_felt_mj,snap_in_peak_n,pull_off_peak_n,true_rms_n,true_lateral_rms_n,clamped_share,"
      "stopped_s,unexecuted,effective_delay_ms,effective_nrmse,weber_sent_share,weber_nrmse,"
      "effective_delay_derivative,time_offset_ms,value_gain,value_offset_n\n";
  const auto number = [](double value) {
    return std::isfinite(value) ? fmt::format("{:.3g}", value) : std::string();
  };
  for (const CellResult& r : results) {
    const FeltMetrics& m = r.metrics;
    csv += fmt::format("{},{},{},{:g},{:g}", r.cell.motion->scene, r.cell.motion->motion,
                       control::method_name(r.cell.method), r.cell.rtt_ms, r.cell.loss);
    for (const double value :
         {m.nrmse, m.nrmse_between, m.nrmse_x, m.nrmse_y, m.nrmse_z, m.lateral_correlation, m.lag_ms,
          m.nrmse_at_lag, m.snap_in_true_n, m.snap_in_error, m.pull_off_true_n, m.pull_off_error})
      csv.append(1, ',').append(number(value));
    csv += fmt::format(",{},{:.3g},{:.3g}", m.false_releases, m.work_true_mj, m.work_felt_mj);
    for (const double value : {m.snap_in_peak_n, m.pull_off_peak_n, m.true_rms_n, m.true_lateral_rms_n})
      csv.append(1, ',').append(number(value));
    csv += fmt::format(",{:.3g},{:g},{}", r.run.clamped_share, r.run.stopped_s, r.run.unexecuted);
    const HapticMetrics& h = r.haptic;
    for (const double value :
         {h.effective_delay_ms, h.effective_nrmse, h.weber_sent_share, h.weber_nrmse,
          h.effective_delay_derivative, h.time_offset_ms, h.value_gain, h.value_offset_n})
      csv.append(1, ',').append(number(value));
    csv += '\n';
  }
  return csv;
}

std::string replies_csv(const std::vector<CellResult>& results, const std::vector<CellResult>& sparing) {
  std::string csv = "scene,motion,method,rtt_ms,loss,permille,left_out_share,nrmse,nrmse_with_every_reply\n";
  const auto number = [](double value) {
    return std::isfinite(value) ? fmt::format("{:.3g}", value) : std::string();
  };
  for (const CellResult& with : sparing) {
    const Cell& c = with.cell;
    for (const CellResult& r : results) {
      const bool same = r.cell.motion == c.motion && r.cell.method == c.method && r.cell.rtt_ms == c.rtt_ms &&
                        r.cell.loss == c.loss;
      if (!same) continue;
      csv += fmt::format("{},{},{},{:g},{:g},{:g},{:.3f},{},{}\n", c.motion->scene, c.motion->motion,
                         control::method_name(c.method), c.rtt_ms, c.loss, c.reply_permille,
                         with.run.left_out_share, number(with.metrics.nrmse), number(r.metrics.nrmse));
    }
  }
  return csv;
}

}  // namespace telenano::studies::fidelity

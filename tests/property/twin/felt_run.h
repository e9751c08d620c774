#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tests/property/twin/deployed_scene.h"
#include "tests/property/twin/logged_slave.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {

struct Link {
  double rtt_ms = 0;
  double loss = 0;
  double jitter_ms = 0;
  double duplicates = 0;
};

inline VirtualSessionConfig session_config(const std::shared_ptr<const scene::Scene>& scene, const Link& link,
                                           const std::shared_ptr<ExecutedLog>& log) {
  VirtualSessionConfig config;
  config.scene = scene;
  config.make_slave = [scene, log] { return std::make_unique<LoggedSlave>(scene, log); };
  config.station.method = control::Method::kTwin;
  config.twin = true;
  for (net::SimPath* const path : {&config.to_server, &config.to_station}) {
    path->delay_ns = static_cast<std::int64_t>(0.5e6 * link.rtt_ms);
    path->jitter_ns = static_cast<std::int64_t>(1e6 * link.jitter_ms);
    path->loss = link.loss;
    path->duplicate = link.duplicates;
  }
  // Down, along, up.
  const double deep = scene->particle ? 4 : scene->marks ? -12 : -6;
  const double z0 = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
  config.task = device::Task::kScript;
  config.script = {{0, {0, 0, z0}},    {1.2, {0, 0, deep}},  {2.2, {60, 8, deep}}, {3, {60, 8, z0}},
                   {3.6, {60, 8, z0}}, {4.2, {60, 8, deep}}, {4.6, {50, 8, deep}}, {5.2, {50, 8, z0}}};
  return config;
}

struct Felt {
  std::uint64_t step = 0;
  Vec3 force_w_nn = Vec3::Zero();
  bool shown = false;  ///< in full: engaged, by the twin, behind no ramp
};

struct Outcome {
  double nrmse = 0;
  double true_rms_nn = 0;
  std::size_t compared = 0;
  std::uint64_t confirmed = 0;
  std::uint64_t steps = 0;
  std::uint64_t partings = 0;
  std::size_t unequal_hashes = 0;
  std::size_t executed = 0;
  double rtt_ms = 0;       ///< smoothed, at the end
  double most_rtt_ms = 0;  ///< likewise, in the second half of the session
  station::TwinState end = station::TwinState::kNone;
};

/// `change`: what of the session is another one.
inline Outcome run(const std::string& name, const Link& link, double extra_s = 1.5,
                   const std::function<void(VirtualSessionConfig&)>& change = {}) {
  const auto scene = deployed(name);
  const auto log = std::make_shared<ExecutedLog>();
  VirtualSessionConfig config = session_config(scene, link, log);
  if (change) change(config);
  VirtualSession session(config);
  std::vector<Felt> felt;
  const double to_n = session.station().config().scaling.hand_force_n(Vec3::UnitX()).x();
  std::vector<double> round_trips_ms;
  const auto note = [&] {
    round_trips_ms.push_back(1e-6 * session.client().stats().rtt_ns());
    const station::StationTrace& t = session.loop().trace();
    felt.push_back({session.client().next_step() - 1, t.rendered_force_h_n / to_n,
                    t.mode == station::Mode::kEngaged && t.method == control::Method::kTwin && t.ramp >= 1});
  };
  session.run(12000, [&](const recording::Sample&) { note(); });
  for (int i = 0; i < extra_s * 1000; ++i) {
    session.step();
    note();
  }
  // The executed log, by a slave of its own.
  Outcome out;
  slave::NveSlave independent(scene);
  std::vector<Vec3> truth(log->size() + 1, Vec3::Zero());
  slave::SlaveOutput output;
  for (std::size_t i = 0; i < log->size(); ++i) {
    independent.step((*log)[i].input, (*log)[i].dt_s, output);
    truth[i + 1] = output.force_w_nn;
    out.unequal_hashes += independent.state_hash() != (*log)[i].hash;
  }
  double wrong = 0, right = 0;
  for (const Felt& f : felt) {
    if (!f.shown || f.step == 0 || f.step >= truth.size()) continue;
    wrong += (f.force_w_nn - truth[f.step]).squaredNorm();
    right += truth[f.step].squaredNorm();
    ++out.compared;
  }
  out.true_rms_nn = out.compared > 0 ? std::sqrt(right / static_cast<double>(out.compared)) : 0;
  out.nrmse = right > 0 ? std::sqrt(wrong / right) : 1;
  out.rtt_ms = round_trips_ms.back();
  out.most_rtt_ms = *std::max_element(
      round_trips_ms.begin() + static_cast<std::ptrdiff_t>(round_trips_ms.size() / 2), round_trips_ms.end());
  const station::TwinRun& twin = *session.station().twin();
  out.confirmed = twin.confirmed();
  out.steps = session.client().next_step() - 1;
  out.partings = twin.partings();
  out.executed = log->size();
  out.end = twin.state();
  return out;
}

}  // namespace telenano::support

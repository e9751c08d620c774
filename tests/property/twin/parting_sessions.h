#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/property/twin/deployed_scene.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {

inline VirtualSessionConfig pressing(const std::shared_ptr<const scene::Scene>& scene, double rtt_ms) {
  VirtualSessionConfig config;
  config.scene = scene;
  config.station.method = control::Method::kTwin;
  config.twin = true;
  config.to_server.delay_ns = config.to_station.delay_ns = static_cast<std::int64_t>(0.5e6 * rtt_ms);
  const double z0 = scene->start_apex_w_nm.z() - scene->start_touch_w_nm;
  config.task = device::Task::kScript;
  config.script = {{0, {0, 0, z0}}, {0.8, {0, 0, -5}}, {20, {30, 0, -5}}};
  return config;
}

inline bool agrees(const VirtualSession& session) {
  const station::TwinState state = const_cast<VirtualSession&>(session).station().twin()->state();
  return state == station::TwinState::kBehind || state == station::TwinState::kConfirmed;
}

inline void steps(VirtualSession& session, int ticks) {
  for (int i = 0; i < ticks; ++i) session.step();
}

/// The hand's force never changes faster than the slew limit; where a state is taken up, 20 N/s, besides what
/// the hand's own motion does.
inline double steepest_n(VirtualSession& session, int ticks) {
  double steepest = 0;
  Vec3 last = session.loop().trace().commanded_force_h_n;
  for (int i = 0; i < ticks; ++i) {
    session.step();
    const Vec3 now = session.loop().trace().commanded_force_h_n;
    steepest = std::max(steepest, (now - last).norm());
    last = now;
  }
  return steepest;
}

/// The server's slave with a step of its own beside the log now and then: a bug, or a lie.
class StraySlave final : public slave::Slave {
 public:
  StraySlave(std::shared_ptr<const scene::Scene> scene, std::vector<int> strays, bool lies)
      : slave_(std::move(scene)), strays_(std::move(strays)), lies_(lies) {}
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    slave_.step(input, dt_s, output);
    if (std::find(strays_.begin(), strays_.end(), ++count_) == strays_.end()) return;
    slave::SlaveInput stray = input;
    stray.follow = true;
    stray.tip_target_pos_w_nm = output.commanded_pos_w_nm + Vec3(0.5, 0, 0.5);
    slave_.step(stray, dt_s, output);
  }
  const slave::SlaveLimits& limits() const noexcept override { return slave_.limits(); }
  std::uint64_t state_hash() const noexcept override { return slave_.state_hash() + (lies_ ? 1 : 0); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return slave_.save(out); }
  std::size_t snapshot_bytes_max() const noexcept override { return slave_.snapshot_bytes_max(); }

 private:
  slave::NveSlave slave_;
  std::vector<int> strays_;
  bool lies_;
  int count_ = 0;
};

}  // namespace telenano::support

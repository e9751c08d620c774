#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <utility>

#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::slave {

/// Moves a slave's tip as an operator does: 1 kHz, along straight lines.
class SlaveWalk {
 public:
  static constexpr double kDt_s = 1e-3;
  using EachStep = std::function<void(const SlaveOutput&)>;

  explicit SlaveWalk(std::shared_ptr<const scene::Scene> scene)
      : slave_(std::move(scene)), at_(slave_.limits().start_pos_w_nm) {}

  /// To `target` (frame W, nm) in equal steps of at most `nm_a_step`. Returns what the last step gave.
  SlaveOutput go_to(const Vec3& target, double nm_a_step, const EachStep& each = {}) {
    const Vec3 from = at_;
    const int steps = std::max(1, static_cast<int>(std::ceil((target - from).norm() / nm_a_step)));
    SlaveOutput out;
    for (int i = 1; i <= steps; ++i) {
      at_ = from + (target - from) * (static_cast<double>(i) / steps);
      SlaveInput input;
      input.tip_target_pos_w_nm = at_;
      slave_.step(input, kDt_s, out);
      if (each) each(out);
    }
    return out;
  }

  NveSlave& slave() { return slave_; }
  const physics::ParticleSolution& particle() const { return *slave_.sample().particle(); }
  const Vec3& at() const { return at_; }

 private:
  NveSlave slave_;
  Vec3 at_;
};

}  // namespace telenano::slave

#pragma once
// The slave of example 04. Its step never waits, allocates or throws.
#include <algorithm>
#include <cmath>

#include "telenano/nve_server/slave/slave.h"

namespace example {

using namespace telenano;

class Wall final : public slave::Slave {
 public:
  Wall() {
    limits_.workspace_min_w_nm = Vec3(-500, -500, -60);
    limits_.workspace_max_w_nm = Vec3(500, 500, 100);
    limits_.start_pos_w_nm = commanded_w_nm_;
    limits_.force_max_nn = 200;
    limits_.coupling_stiffness_n_m = kStiffness_n_m;  // the stiffest that a station will ever feel here
  }
  const slave::SlaveLimits& limits() const noexcept override { return limits_; }

  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    output = {};
    if (input.retract) {
      commanded_w_nm_.z() =
          std::min(commanded_w_nm_.z() + kRetract_nm_s * dt_s, limits_.workspace_max_w_nm.z());
      output.fault_bits |= link::kFaultRetracted;
    } else if (input.follow && is_finite(input.tip_target_pos_w_nm)) {
      commanded_w_nm_ =
          input.tip_target_pos_w_nm.cwiseMax(limits_.workspace_min_w_nm).cwiseMin(limits_.workspace_max_w_nm);
      commanded_w_nm_.z() = std::max(commanded_w_nm_.z(), -limits_.force_max_nn / kStiffness_n_m);
    }
    const double depth_nm = std::max(0.0, -commanded_w_nm_.z());
    const double stored_aj = 0.5 * kStiffness_n_m * depth_nm * depth_nm;  // N/m · nm² = aJ
    // Every joule that passes the port is counted: the station's passivity controller works with these sums.
    (stored_aj > stored_aj_ ? in_aj_ : out_aj_) += std::abs(stored_aj - stored_aj_);
    stored_aj_ = stored_aj;
    output.force_w_nn = Vec3(0, 0, kStiffness_n_m * depth_nm);
    output.tip_pos_w_nm = output.commanded_pos_w_nm = commanded_w_nm_;
    output.contact_state = depth_nm > 0 ? link::ContactState::kContact : link::ContactState::kFree;
    output.energy_in_aj = in_aj_;
    output.energy_out_aj = out_aj_;
  }

 private:
  static constexpr double kStiffness_n_m = 5;
  static constexpr double kRetract_nm_s = 1000;
  slave::SlaveLimits limits_;
  Vec3 commanded_w_nm_ = Vec3(0, 0, 20);
  double stored_aj_ = 0, in_aj_ = 0, out_aj_ = 0;
};

}  // namespace example

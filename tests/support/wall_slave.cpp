#include "tests/support/wall_slave.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "telenano/common/base/fnv1a.h"
#include "telenano/nve_server/slave/state_bytes.h"

namespace telenano::support {

WallSlave::WallSlave(const WallSlaveConfig& config, std::shared_ptr<WallWatch> watch)
    : config_(config), watch_(std::move(watch)), commanded_w_nm_(0, 0, config.start_height_nm) {
  limits_.workspace_min_w_nm = config.workspace_min_w_nm;
  limits_.workspace_max_w_nm = config.workspace_max_w_nm;
  limits_.start_pos_w_nm = commanded_w_nm_;
  limits_.surface_z_w_nm = 0;
  limits_.force_max_nn = config.force_max_nn;
  limits_.coupling_stiffness_n_m = config.stiffness_n_m;
  limits_.coupling_damping_n_s_m = 0;
  if (watch_) ++watch_->made;
}

void WallSlave::step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept {
  std::uint32_t faults = 0;
  const bool finite = is_finite(input.tip_target_pos_w_nm) && std::isfinite(dt_s);
  if (!finite) faults |= link::kFaultNonFinite;
  if (input.retract && std::isfinite(dt_s)) {
    faults |= link::kFaultRetracted;
    const double up_nm = commanded_w_nm_.z() + config_.retract_speed_nm_s * dt_s;
    commanded_w_nm_.z() = std::min(up_nm, config_.workspace_max_w_nm.z());
  } else if (input.follow && is_finite(input.tip_target_pos_w_nm)) {
    const Vec3 goal =
        input.tip_target_pos_w_nm.cwiseMax(config_.workspace_min_w_nm).cwiseMin(config_.workspace_max_w_nm);
    if (goal != input.tip_target_pos_w_nm) faults |= link::kFaultWorkspace;
    commanded_w_nm_ = goal;
    const double deepest_nm = -config_.force_max_nn / config_.stiffness_n_m;
    if (commanded_w_nm_.z() < deepest_nm) {
      commanded_w_nm_.z() = deepest_nm;
      faults |= link::kFaultForceLimit;
    }
  }
  const double depth_nm = std::max(0.0, -commanded_w_nm_.z());
  const double force_nn = config_.stiffness_n_m * depth_nm;  // N/m · nm = nN
  const double stored_aj = 0.5 * force_nn * depth_nm;        // nN · nm = aJ
  (stored_aj > stored_aj_ ? energy_in_aj_ : energy_out_aj_) += std::abs(stored_aj - stored_aj_);
  if (watch_) watch_->taken_in_aj += stored_aj - stored_aj_;
  stored_aj_ = stored_aj;
  say(faults, finite, output);
  touched_ = touched_ || depth_nm > 0;
  output.model = {};
  if (input.wants_model && touched_) {
    output.model.version = 1;
    output.model.normal_w = Vec3::UnitZ();
    output.model.point_w_nm = Vec3(commanded_w_nm_.x(), commanded_w_nm_.y(), 0);
    output.model.stiffness_n_m = config_.stiffness_n_m;
  }
  if (watch_) {
    watch_->commanded_z_w_nm = commanded_w_nm_.z();
    watch_->energy_in_aj = energy_in_aj_;
    watch_->energy_out_aj = energy_out_aj_;
    watch_->force_nn = force_nn;
    watch_->most_force_nn = std::max(watch_->most_force_nn, force_nn);
  }
}

void WallSlave::say(std::uint32_t faults, bool finite, slave::SlaveOutput& output) const noexcept {
  const double depth_nm = std::max(0.0, -commanded_w_nm_.z());
  const double force_nn = config_.stiffness_n_m * depth_nm;
  output.force_w_nn = Vec3(0, 0, finite ? force_nn : 0.0);
  output.tip_pos_w_nm = output.commanded_pos_w_nm = commanded_w_nm_;
  output.deflection_nm = 0;
  output.contact_state = depth_nm > 0 ? link::ContactState::kContact : link::ContactState::kFree;
  output.fault_bits = faults;
  output.energy_in_aj = energy_in_aj_;
  output.energy_out_aj = energy_out_aj_;
  output.measurement_age_ns = 0;
}

bool WallSlave::say_again(slave::SlaveOutput& output) noexcept {
  say(0, true, output);
  return true;
}

std::size_t WallSlave::save(std::span<std::uint8_t> out) const noexcept {
  slave::StateWriter writer(out);
  for (int i = 0; i < 3; ++i) writer(commanded_w_nm_[i]);
  writer(touched_);
  writer(stored_aj_);
  writer(energy_in_aj_);
  writer(energy_out_aj_);
  return writer.ok() ? writer.size() : 0;
}

std::uint64_t WallSlave::state_hash() const noexcept {
  std::array<std::uint8_t, 128> bytes{};
  const std::size_t size = save(bytes);
  return fnv1a({reinterpret_cast<const char*>(bytes.data()), size}) | 1;
}

bool WallSlave::load(std::span<const std::uint8_t> bytes) noexcept {
  slave::StateReader reader(bytes);
  for (int i = 0; i < 3; ++i) reader(commanded_w_nm_[i]);
  reader(touched_);
  reader(stored_aj_);
  reader(energy_in_aj_);
  reader(energy_out_aj_);
  return reader.ok() && reader.at_end();
}

}  // namespace telenano::support

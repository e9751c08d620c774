#include "telenano/master/twin/scene_twin.h"

#include <utility>

#include "telenano/nve_server/slave/logged_step.h"

namespace telenano::twin {
namespace {

void fill(const slave::NveSlave& slave, const slave::SlaveOutput& output,
          control::LocalAnswer& answer) noexcept {
  answer.force_w_nn = output.force_w_nn;
  answer.tip_pos_w_nm = output.tip_pos_w_nm;
  answer.commanded_pos_w_nm = output.commanded_pos_w_nm;
  answer.deflection_nm = output.deflection_nm;
  answer.contact_state = static_cast<std::uint32_t>(output.contact_state);
  answer.fault_bits = output.fault_bits;
  answer.energy_in_aj = output.energy_in_aj;
  answer.energy_out_aj = output.energy_out_aj;
  answer.stored_aj = slave.stored_aj();
  answer.contact_radius_nm = slave.contact_radius_nm();
  answer.adhesion_nn = slave.adhesion_nn();
}

}  // namespace

SceneTwin::SceneTwin(std::shared_ptr<const scene::Scene> scene) : scene_(std::move(scene)), slave_(scene_) {}

SceneTwin::SceneTwin(std::shared_ptr<const scene::Scene> scene, const slave::PortGround& ground)
    : scene_(std::move(scene)), slave_(scene_, ground) {}

void SceneTwin::step(const control::LocalStep& step, control::LocalAnswer& answer) noexcept {
  const bool was_up = (output_.fault_bits & link::kFaultRetracted) != 0;
  slave_.step(slave::input_of(step.target_w_nm, step.vel_w_nm_s, step.flags, step.operates, was_up),
              step.dt_s, output_);
  fill(slave_, output_, answer);
}

void SceneTwin::reset() noexcept {
  slave_.reset();
  output_ = {};
}

bool SceneTwin::load(std::span<const std::uint8_t> bytes, control::LocalAnswer& answer) noexcept {
  const bool loaded = slave_.load(bytes);
  slave_.say_again(output_);
  fill(slave_, output_, answer);
  return loaded;
}

}  // namespace telenano::twin

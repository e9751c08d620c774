#pragma once

#include <algorithm>
#include <memory>

#include "telenano/nve_server/server/server.h"

namespace telenano::server {

/// A slave that a test can compute by hand: an elastic floor at z = 0 under a massless tip, 1 N/m (= 1
/// nN/nm), no coupling. Counts what it is told.
class SpringSlave final : public slave::Slave {
 public:
  explicit SpringSlave(bool has_particle = false) {
    limits_.has_particle = has_particle;
    limits_.workspace_min_w_nm = {-300, -300, -50};
    limits_.workspace_max_w_nm = {300, 300, 500};
    limits_.start_pos_w_nm = {0, 0, 50};
    limits_.force_max_nn = 1000;
    limits_.coupling_stiffness_n_m = 1;
    pos_w_nm_ = limits_.start_pos_w_nm;
  }

  void take_at_most(std::uint32_t rate_hz) noexcept { limits_.rate_max_hz = rate_hz; }
  void set_well(double well_aj) noexcept { limits_.well_aj = well_aj; }

  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    ++steps;
    last_input = input;
    last_dt_s = dt_s;
    total_dt_s += dt_s;
    if (input.retract) {
      ++retracts;
      pos_w_nm_.z() = std::min(pos_w_nm_.z() + 1000 * dt_s, 100.0);
    } else if (input.follow) {
      pos_w_nm_ = input.tip_target_pos_w_nm;
    }
    const double force_nn = std::max(0.0, -pos_w_nm_.z());
    const double stored_aj = 0.5 * force_nn * force_nn;  // nN·nm = aJ; k = 1
    (stored_aj > stored_aj_ ? in_aj_ : out_aj_) += std::abs(stored_aj - stored_aj_);
    stored_aj_ = stored_aj;
    output.force_w_nn = {0, 0, force_nn + broken_nn};
    output.commanded_pos_w_nm = pos_w_nm_;
    output.tip_pos_w_nm = pos_w_nm_ + Vec3(0, 0, yield_nm_nn * force_nn);
    output.contact_state = force_nn > 0 ? link::ContactState::kContact : link::ContactState::kFree;
    output.fault_bits = input.retract ? std::uint32_t{link::kFaultRetracted} : 0u;
    output.energy_in_aj = in_aj_;
    output.energy_out_aj = out_aj_;
    output.particle = particle;
    output.measurement_age_ns = age_ns;
    highest_nm = std::max(highest_nm, pos_w_nm_.z());
  }
  const slave::SlaveLimits& limits() const noexcept override { return limits_; }

  const Vec3& commanded_w_nm() const noexcept { return pos_w_nm_; }

  std::uint64_t steps = 0;
  std::uint64_t retracts = 0;
  slave::SlaveInput last_input;
  double last_dt_s = 0;
  double total_dt_s = 0;
  std::int64_t age_ns = 0;                     ///< of its force; 0: computed
  void measure() { limits_.measures = true; }  ///< as an instrument does
  double highest_nm = -1e300;
  double broken_nn = 0;     ///< NaN: a slave gone wrong
  link::Particle particle;  ///< that it tells of, asked or not
  double yield_nm_nn = 0;   ///< how far the tip stays behind its command

 private:
  slave::SlaveLimits limits_;
  Vec3 pos_w_nm_ = Vec3::Zero();
  double in_aj_ = 0;
  double out_aj_ = 0;
  double stored_aj_ = 0;
};

/// `last` is set to the slave made last, for looking into it.
inline ServedScene spring_scene(SpringSlave** last = nullptr, int* made = nullptr,
                                bool has_particle = false) {
  ServedScene scene;
  scene.name = scene_name("spring floor");
  scene.hash = 0x1234;
  scene.timeout_ms = 700;
  scene.make_slave = [last, made, has_particle]() -> std::unique_ptr<slave::Slave> {
    auto slave = std::make_unique<SpringSlave>(has_particle);
    if (last != nullptr) *last = slave.get();
    if (made != nullptr) ++*made;
    return slave;
  };
  return scene;
}

}  // namespace telenano::server

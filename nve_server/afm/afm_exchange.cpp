#include "telenano/nve_server/afm/afm_exchange.h"

namespace telenano::afm {

void AfmExchange::store_wish(const PortTarget& w) noexcept {
  wish_.store({w.time_ns, w.session, w.clears, plain(w.target_w_nm), static_cast<std::uint8_t>(w.follow),
               static_cast<std::uint8_t>(w.retract), static_cast<std::uint8_t>(w.wanted)});
}

bool AfmExchange::load_wish(PortTarget& w) const noexcept {
  PlainWish p{};
  if (!wish_.try_load(p)) return false;
  w = {p.time_ns, p.session, p.clears, vector(p.target), p.follow != 0, p.retract != 0, p.wanted != 0};
  return true;
}

void AfmExchange::store_state(const PortState& s) noexcept {
  PlainState p{};
  p.time_ns = s.time_ns;
  p.measured_ns = s.measured_ns;
  p.latches = s.latches;
  p.base = plain(s.base_w_nm);
  p.measured_base = plain(s.measured_base_w_nm);
  p.measured_force = plain(s.measured_force_w_nn);
  p.point = plain(s.model.point_w_nm);
  p.normal = plain(s.model.normal_w);
  p.numbers = {s.model.stiffness_n_m, s.model.adhesion_nn, s.model.shear_stiffness_n_m,
               s.model.friction_nn,   s.noise_nn,          s.energy_in_aj,
               s.energy_out_aj,       s.energy_bound_aj,   s.surface_bound_nm,
               s.drift_nm_s,          s.drift_bound_nm_s};
  p.version = s.model.version;
  p.phase = static_cast<std::uint8_t>(s.phase);
  p.cause = static_cast<std::uint8_t>(s.cause);
  p.force_known = s.force_known;
  p.touching = s.touching;
  p.held_by_force = s.held_by_force;
  state_.store(p);
}

bool AfmExchange::load_state(PortState& s) const noexcept {
  PlainState p{};
  if (!state_.try_load(p)) return false;
  s.time_ns = p.time_ns;
  s.measured_ns = p.measured_ns;
  s.latches = p.latches;
  s.base_w_nm = vector(p.base);
  s.measured_base_w_nm = vector(p.measured_base);
  s.measured_force_w_nn = vector(p.measured_force);
  s.model.point_w_nm = vector(p.point);
  s.model.normal_w = vector(p.normal);
  s.model.stiffness_n_m = p.numbers[0];
  s.model.adhesion_nn = p.numbers[1];
  s.model.shear_stiffness_n_m = p.numbers[2];
  s.model.friction_nn = p.numbers[3];
  s.noise_nn = p.numbers[4];
  s.energy_in_aj = p.numbers[5];
  s.energy_out_aj = p.numbers[6];
  s.energy_bound_aj = p.numbers[7];
  s.surface_bound_nm = p.numbers[8];
  s.drift_nm_s = p.numbers[9];
  s.drift_bound_nm_s = p.numbers[10];
  s.model.version = p.version;
  s.phase = static_cast<Phase>(p.phase);
  s.cause = static_cast<Cause>(p.cause);
  s.force_known = p.force_known != 0;
  s.touching = p.touching != 0;
  s.held_by_force = p.held_by_force != 0;
  return true;
}

}  // namespace telenano::afm

#include "telenano/nve_server/server/port_control.h"

#include <algorithm>
#include <cmath>

namespace telenano::server {
namespace {

double charge_aj(const slave::SlaveOutput& last, const slave::SlaveOutput& now) noexcept {
  return (now.energy_in_aj - last.energy_in_aj) - (now.energy_out_aj - last.energy_out_aj);
}

// What a sum has grown by; nothing, where no session comes to so much.
double rise(double now, double before, double scale) noexcept {
  const double risen = (now - before) * scale;
  return risen > 0 && risen <= PortControl::kMostAj ? risen : 0;
}

}  // namespace

void PortControl::begin_session() noexcept {
  received_ = {};
  wave_came_.setZero();
  wave_came_aj_ = 0;
  level_aj_ = std::min(0.0, level_aj_);
  wave_surplus_aj_ = 0;
  has_target_ = false;
}

bool PortControl::pays_for_moves() const noexcept {
  return method_ == link::kMethodTdpa || method_ == link::kMethodTank;
}

void PortControl::receive(const link::PortControl& control) noexcept {
  if (control.method != method_) {
    level_aj_ = std::min(0.0, level_aj_);  // another method: what is owed stays owed, nothing is granted
    method_ = control.method;
  }
  const double old_scale_aj_j = energy_scale_aj_j_;
  const bool rescaled = rescale(control.energy_scale_aj_j);
  wave_impedance_n_s_m_ = control.wave_impedance_n_s_m;
  came_aj_ = rise(control.energy_sent_j, received_.energy_sent_j, energy_scale_aj_j_);
  wave_came_ = control.wave_sum - received_.wave_sum;
  if (!is_finite(wave_came_)) wave_came_.setZero();
  wave_came_aj_ = rise(control.wave_energy_aj, received_.wave_energy_aj, 1);
  // Waves cross at the station. Of what comes with a new scale some may have been sent, and lost, at the old.
  if (rescaled) wave_came_aj_ *= std::min(1.0, energy_scale_aj_j_ / old_scale_aj_j);
  received_.energy_sent_j = std::max(received_.energy_sent_j, control.energy_sent_j);
  received_.wave_sum = control.wave_sum;
  received_.wave_energy_aj = std::max(received_.wave_energy_aj, control.wave_energy_aj);
}

/// True if the port has known another scale.
bool PortControl::rescale(double energy_scale_aj_j) noexcept {
  const bool believed = energy_scale_aj_j >= kScaleLeast && energy_scale_aj_j <= kScaleMost;
  if (!believed || energy_scale_aj_j == energy_scale_aj_j_) return false;
  const double by = energy_scale_aj_j_ > 0 ? energy_scale_aj_j / energy_scale_aj_j_ : 1;
  level_aj_ *= by;
  wave_surplus_aj_ *= by;
  energy_scale_aj_j_ = energy_scale_aj_j;
  return by != 1;
}

/// The charge of a step at what was paid for it, and is to be.
double PortControl::worth_aj(double charge_aj) noexcept {
  if (!(std::fabs(charge_aj) <= kMostAj)) {
    level_aj_ = std::min(0.0, level_aj_);
    return 0;
  }
  const double price = energy_scale_aj_j_ > 0 ? 1 / energy_scale_aj_j_ : 0;
  // A method that sends no energy has paid for it at the hand alone, where its account goes on: here it is worth nothing.
  const bool paid_here = pays_for_moves() || method_ == link::kMethodWave;
  return charge_aj > 0 ? sample_.put_in(charge_aj, paid_here ? price : 0)
                       : -sample_.take_out(-charge_aj, price);
}

Vec3 PortControl::paid_move(const Vec3& move_w_nm, const Vec3& force_w_nn, double stiffness_n_m,
                            double budget_aj) const noexcept {
  // How far s against a force F there is energy for: F s + ½K s² = budget.
  const auto reach_nm = [stiffness_n_m](double force_nn, double energy_aj) {
    return energy_aj > 0
               ? 2 * energy_aj / (force_nn + std::sqrt(force_nn * force_nn + 2 * stiffness_n_m * energy_aj))
               : 0.0;
  };
  Vec3 move = move_w_nm;
  const double force_nn = force_w_nn.norm();
  const double against_nm = force_nn > 0 ? -move.dot(force_w_nn) / force_nn : 0;
  if (against_nm > 0) {
    const double paid_nm = reach_nm(force_nn, budget_aj);
    if (paid_nm < against_nm) move += force_w_nn * ((against_nm - paid_nm) / force_nn);
  }
  const double length_nm = move.norm();
  if (!(length_nm > 0)) return move;
  const double least_aj = kUnforeseenJ * energy_scale_aj_j_;
  const double longest_nm = reach_nm(-move.dot(force_w_nn) / length_nm, std::max(budget_aj, least_aj));
  return longest_nm < length_nm ? Vec3(move * (longest_nm / length_nm)) : move;
}

Vec3 PortControl::wave_move(const Vec3& lag_w_nm, const slave::SlaveOutput& last, double stiffness_n_m,
                            double dt_s) noexcept {
  const double b = wave_impedance_n_s_m_;
  Vec3 wave = wave_came_ / dt_s;
  if (!std::isfinite(wave.squaredNorm())) wave.setZero();
  const double wave_aj = 0.5 * wave.squaredNorm() * dt_s;
  if (wave_aj > wave_came_aj_) wave *= std::sqrt(wave_came_aj_ / wave_aj);
  wave_used_aj_ = std::min(wave_aj, wave_came_aj_);
  const Vec3 velocity_nm_s = (std::sqrt(2 * b) * wave + last.force_w_nn) / (b + stiffness_n_m * dt_s);
  const Vec3 move_w_nm = velocity_nm_s * dt_s;
  const Vec3 catch_up_w_nm = lag_w_nm * std::min(1.0, dt_s / kCatchUp_s);
  return move_w_nm + paid_move(catch_up_w_nm, last.force_w_nn, stiffness_n_m, wave_surplus_aj_);
}

slave::SlaveInput PortControl::before(const link::Command& command, const slave::SlaveInput& input,
                                      const slave::SlaveOutput& last, const slave::SlaveLimits& limits,
                                      double dt_s) noexcept {
  receive(command.control);
  const bool first = !has_target_;
  const Vec3 old_target_w_nm = target_w_nm_;
  target_w_nm_ = input.tip_target_pos_w_nm;
  has_target_ = true;
  slave::SlaveInput told = input;
  wave_used_aj_ = 0;
  // Kept though the tip does not follow yet: the station sends the allowance once.
  if (pays_for_moves()) level_aj_ += came_aj_;
  if (!input.follow) return told;
  const double stiffness_n_m = limits.coupling_stiffness_n_m;
  if (pays_for_moves()) {
    Vec3 move_w_nm = target_w_nm_ - last.commanded_pos_w_nm;
    if (!first) {
      const Vec3 lag_w_nm = old_target_w_nm - last.commanded_pos_w_nm;
      move_w_nm = (target_w_nm_ - old_target_w_nm) + lag_w_nm * std::min(1.0, dt_s / kCatchUp_s);
    }
    told.tip_target_pos_w_nm = last.commanded_pos_w_nm +
                               paid_move(move_w_nm, last.force_w_nn, stiffness_n_m, std::max(0.0, level_aj_));
  } else if (method_ == link::kMethodWave && wave_impedance_n_s_m_ > 0) {
    const Vec3 lag_w_nm = first ? Vec3(Vec3::Zero()) : Vec3(old_target_w_nm - last.commanded_pos_w_nm);
    told.tip_target_pos_w_nm = last.commanded_pos_w_nm + wave_move(lag_w_nm, last, stiffness_n_m, dt_s);
  }
  return told;
}

void PortControl::observe(const link::PortControl& control) noexcept {
  receive(control);
  if (pays_for_moves()) level_aj_ += came_aj_;
  has_target_ = false;
  wave_used_aj_ = wave_surplus_aj_ = 0;  // a wave is of its moment
}

void PortControl::after(const slave::SlaveOutput& last, const slave::SlaveOutput& now, double dt_s) noexcept {
  const double charge = worth_aj(charge_aj(last, now));
  if (method_ == link::kMethodTdpa) {
    level_aj_ -= std::max(0.0, charge);
  } else if (method_ == link::kMethodTank) {
    level_aj_ -= charge;
    const double surplus_aj = std::max(0.0, level_aj_ - kReserveJ * energy_scale_aj_j_);
    const double send_aj =
        std::min(surplus_aj, std::max(0.0, -charge) + surplus_aj * std::min(1.0, dt_s / kSurplusReturn_s));
    level_aj_ -= send_aj;
    answer_.energy_sent_aj += send_aj;
  } else if (method_ == link::kMethodWave && wave_impedance_n_s_m_ > 0) {
    send_wave(now, now.commanded_pos_w_nm - last.commanded_pos_w_nm, charge, dt_s);
  }
}

void PortControl::send_wave(const slave::SlaveOutput& now, const Vec3& moved_w_nm, double charge,
                            double dt_s) noexcept {
  const double b = wave_impedance_n_s_m_;
  const double there_is_aj = wave_used_aj_ - charge + level_aj_;
  const double may_send_aj = there_is_aj + wave_surplus_aj_;
  level_aj_ = std::min(0.0, may_send_aj);
  const Vec3 wave = -(now.force_w_nn + b / dt_s * moved_w_nm) / std::sqrt(2 * b);
  const double wave_aj = 0.5 * wave.squaredNorm() * dt_s;
  double sent_aj = 0;
  if (may_send_aj > 0 && wave_aj > 0 && std::isfinite(wave_aj)) {
    const double part = std::min(1.0, std::sqrt(may_send_aj / wave_aj));
    sent_aj = part * part * wave_aj;
    answer_.wave_sum += part * dt_s * wave;
    answer_.wave_energy_aj += sent_aj;
  }
  wave_surplus_aj_ = std::max(0.0, may_send_aj - sent_aj);
}

}  // namespace telenano::server

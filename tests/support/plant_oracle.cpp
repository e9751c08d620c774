#include "tests/support/plant_oracle.h"

#include <cmath>

namespace telenano::support {
namespace {

template <class Series>
long double value(const Series& series, long double t) {
  long double sum = 0;
  for (auto it = series.rbegin(); it != series.rend(); ++it) sum = sum * t + *it;
  return sum;
}

template <class Series>
long double integral_of_product(const Series& a, const Series& b, long double t) {
  long double sum = 0;
  long double power_a = t;
  for (std::size_t i = 0; i < a.size(); ++i, power_a *= t) {
    long double power = power_a;
    for (std::size_t j = 0; j < b.size(); ++j, power *= t) {
      sum += a[i] * b[j] * power / static_cast<long double>(i + j + 1);
    }
  }
  return sum;
}

template <class Series>
Series difference(const Series& a, const Series& b) {
  Series result{};
  for (std::size_t i = 0; i < a.size(); ++i) result[i] = a[i] - b[i];
  return result;
}

}  // namespace

void PlantOracle::reset(long double pos_m) {
  device_pos_m_ = arm_pos_m_ = intended_m_ = pos_m;
  device_vel_m_s_ = arm_vel_m_s_ = 0;
  force_work_j = intent_work_j = device_loss_j = friction_loss_j = arm_loss_j = 0;
  reversals = 0;
}

PlantOracle::Solution PlantOracle::solve(int sign, long double force_n, long double intended_vel) const {
  const auto& c = config_;
  Solution s;
  s.device_pos[0] = device_pos_m_;
  s.device_vel[0] = sign == 0 ? 0 : device_vel_m_s_;
  s.arm_pos[0] = arm_pos_m_;
  s.arm_vel[0] = arm_vel_m_s_;
  for (int n = 0; n < kOrder; ++n) {
    const long double constant = n == 0 ? force_n - static_cast<long double>(sign) * c.coulomb_friction_n : 0;
    const long double u = n == 0 ? intended_m_ : (n == 1 ? intended_vel : 0);
    const long double u_dot = n == 0 ? intended_vel : 0;
    const long double grip = c.grip_stiffness_n_m * (s.arm_pos[n] - s.device_pos[n]) +
                             c.grip_damping_n_s_m * (s.arm_vel[n] - s.device_vel[n]);
    const long double arm =
        c.arm_stiffness_n_m * (u - s.arm_pos[n]) + c.arm_damping_n_s_m * (u_dot - s.arm_vel[n]);
    const long double next = n + 1;
    s.device_pos[n + 1] = s.device_vel[n] / next;
    s.device_vel[n + 1] =
        sign == 0 ? 0
                  : (constant - c.device_damping_n_s_m * s.device_vel[n] + grip) / (c.device_mass_kg * next);
    s.arm_pos[n + 1] = s.arm_vel[n] / next;
    s.arm_vel[n + 1] = (arm - grip) / (c.arm_mass_kg * next);
  }
  return s;
}

long double PlantOracle::net_held_n(const Solution& s, long double t, long double force_n) const {
  return force_n + config_.grip_stiffness_n_m * (value(s.arm_pos, t) - device_pos_m_) +
         config_.grip_damping_n_s_m * value(s.arm_vel, t);
}

int PlantOracle::direction(long double force_n) const {
  if (device_vel_m_s_ != 0) return device_vel_m_s_ > 0 ? 1 : -1;
  const long double net = force_n + config_.grip_stiffness_n_m * (arm_pos_m_ - device_pos_m_) +
                          config_.grip_damping_n_s_m * arm_vel_m_s_;
  if (std::fabs(net) <= config_.coulomb_friction_n) return 0;
  return net > 0 ? 1 : -1;
}

void PlantOracle::accept(const Solution& s, int sign, long double t, long double force_n,
                         long double intended_vel) {
  const auto& c = config_;
  const long double moved = value(s.device_pos, t) - device_pos_m_;
  Series intended{};
  intended[0] = intended_m_;
  intended[1] = intended_vel;
  Series intended_dot{};
  intended_dot[0] = intended_vel;
  const Series grip_vel = difference(s.arm_vel, s.device_vel);
  const Series arm_vel = difference(intended_dot, s.arm_vel);
  const Series arm_stretch = difference(intended, s.arm_pos);
  Series force{};
  force[0] = force_n;
  force_work_j += integral_of_product(force, s.device_vel, t);
  friction_loss_j += c.coulomb_friction_n * static_cast<long double>(sign) * moved;
  device_loss_j += c.device_damping_n_s_m * integral_of_product(s.device_vel, s.device_vel, t);
  arm_loss_j += c.grip_damping_n_s_m * integral_of_product(grip_vel, grip_vel, t) +
                c.arm_damping_n_s_m * integral_of_product(arm_vel, arm_vel, t);
  intent_work_j += c.arm_stiffness_n_m * integral_of_product(arm_stretch, intended_dot, t) +
                   c.arm_damping_n_s_m * integral_of_product(arm_vel, intended_dot, t);
  device_pos_m_ += moved;
  device_vel_m_s_ = value(s.device_vel, t);
  arm_pos_m_ = value(s.arm_pos, t);
  arm_vel_m_s_ = value(s.arm_vel, t);
  intended_m_ += intended_vel * t;
}

void PlantOracle::advance(long double force_n, long double intended_m, long double period_s) {
  constexpr int kPieces = 4;    // of a period; 24 terms converge to the last bit for ω·T/4 well below 1
  constexpr int kSamples = 64;  // of a piece, to look for an event
  const long double intended_vel = (intended_m - intended_m_) / period_s;
  for (int piece = 0; piece < kPieces; ++piece) {
    long double left = period_s / kPieces;
    while (left > 0) {
      const int sign = config_.coulomb_friction_n > 0 ? direction(force_n) : 1;
      const Solution s = solve(sign, force_n, intended_vel);
      const auto violated = [&](long double t) {
        if (config_.coulomb_friction_n == 0) return false;
        if (sign == 0) return std::fabs(net_held_n(s, t, force_n)) > config_.coulomb_friction_n;
        return static_cast<long double>(sign) * value(s.device_vel, t) <= 0;
      };
      long double low = 0;
      long double high = left;
      bool event = false;
      for (int i = 1; i <= kSamples && !event; ++i) {
        const long double t = left * i / kSamples;
        if (violated(t)) {
          event = true;
          high = t;
        } else {
          low = t;
        }
      }
      if (!event) {
        accept(s, sign, left, force_n, intended_vel);
        break;
      }
      for (int i = 0; i < 90; ++i) (violated(0.5L * (low + high)) ? high : low) = 0.5L * (low + high);
      accept(s, sign, high, force_n, intended_vel);
      if (sign != 0) {
        device_vel_m_s_ = 0;
        ++reversals;
      }
      left -= high;
    }
  }
  intended_m_ = intended_m;
}

long double PlantOracle::stored_j() const {
  const auto& c = config_;
  const long double grip = arm_pos_m_ - device_pos_m_;
  const long double arm = intended_m_ - arm_pos_m_;
  return 0.5L *
         (c.device_mass_kg * device_vel_m_s_ * device_vel_m_s_ + c.arm_mass_kg * arm_vel_m_s_ * arm_vel_m_s_ +
          c.grip_stiffness_n_m * grip * grip + c.arm_stiffness_n_m * arm * arm);
}

}  // namespace telenano::support

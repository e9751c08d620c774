#include "telenano/master/device/plant.h"

#include <cmath>
#include <limits>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::device {
namespace {

constexpr int kN = AxisPlant::kStates;
constexpr int kMaxEvents = 64;  // in one period; a passive axis needs a few
using WideMatrix = std::array<long double, kN * kN>;

WideMatrix multiply(const WideMatrix& a, const WideMatrix& b) {
  WideMatrix product{};
  for (int i = 0; i < kN; ++i) {
    for (int k = 0; k < kN; ++k) {
      for (int j = 0; j < kN; ++j) product[i * kN + j] += a[i * kN + k] * b[k * kN + j];
    }
  }
  return product;
}

/// exp(A h) by scaling and squaring: with ‖A h‖/2ˢ ≤ 1/4 the Taylor remainder after 20 terms is below 1e-31,
/// and s squarings of 64-bit mantissas leave the result exact to the last digit of double.
WideMatrix exponential(const WideMatrix& a, long double h) {
  long double norm = 0;
  for (int i = 0; i < kN; ++i) {
    long double row = 0;
    for (int j = 0; j < kN; ++j) row += std::fabs(a[i * kN + j]) * h;
    if (row > norm) norm = row;
  }
  int squarings = 0;
  while (norm > 0.25L) {
    norm *= 0.5L;
    h *= 0.5L;
    ++squarings;
  }
  WideMatrix result{};
  WideMatrix term{};
  for (int i = 0; i < kN; ++i) result[i * kN + i] = term[i * kN + i] = 1;
  for (int order = 1; order <= 20; ++order) {
    term = multiply(term, a);
    for (auto& value : term) value *= h / order;
    for (int i = 0; i < kN * kN; ++i) result[i] += term[i];
  }
  for (; squarings > 0; --squarings) result = multiply(result, result);
  return result;
}

void require_of_plant(bool good, const char* key, double value, const char* range) {
  if (good) return;
  throw UserError("simulated device: " + std::string(key) + " = " + std::to_string(value) + ", expected " +
                  range);
}

}  // namespace

void PlantConfig::validate() const {
  const auto between = [](double value, double low, double high) { return value >= low && value <= high; };
  require_of_plant(between(period_s, 1e-5, 0.1), "period_s", period_s, "1e-5 to 0.1");
  require_of_plant(between(device_mass_kg, 1e-3, 100), "device_mass_kg", device_mass_kg, "0.001 to 100");
  require_of_plant(between(device_damping_n_s_m, 0, 1000), "device_damping_n_s_m", device_damping_n_s_m,
                   "0 to 1000");
  require_of_plant(between(coulomb_friction_n, 0, 100), "coulomb_friction_n", coulomb_friction_n, "0 to 100");
  require_of_plant(between(force_max_n, 0.01, 1000), "force_max_n", force_max_n, "0.01 to 1000");
  require_of_plant(between(force_quantum_n, 0, 1), "force_quantum_n", force_quantum_n, "0 to 1");
  require_of_plant(between(position_quantum_m, 0, 1e-3), "position_quantum_m", position_quantum_m,
                   "0 to 0.001");
  require_of_plant(between(arm_mass_kg, 1e-3, 1000), "arm_mass_kg", arm_mass_kg, "0.001 to 1000");
  require_of_plant(between(arm_stiffness_n_m, 0, 1e5), "arm_stiffness_n_m", arm_stiffness_n_m, "0 to 100000");
  require_of_plant(between(arm_damping_n_s_m, 0, 1e4), "arm_damping_n_s_m", arm_damping_n_s_m, "0 to 10000");
  require_of_plant(between(grip_stiffness_n_m, 0, 1e6), "grip_stiffness_n_m", grip_stiffness_n_m,
                   "0 to 1000000");
  require_of_plant(between(grip_damping_n_s_m, 0, 1e4), "grip_damping_n_s_m", grip_damping_n_s_m,
                   "0 to 10000");
  for (int axis = 0; axis < 3; ++axis) {
    require_of_plant(between(workspace_half_m[axis], 1e-3, 10), "workspace_half_m", workspace_half_m[axis],
                     "0.001 to 10");
  }
}

AxisPlant::AxisPlant(const PlantConfig& config, double stop_half_m) : config_(config), stop_m_(stop_half_m) {
  const long double device_kg = config.device_mass_kg;
  const long double arm_kg = config.arm_mass_kg;
  const long double grip_k = config.grip_stiffness_n_m;
  const long double grip_c = config.grip_damping_n_s_m;
  const long double arm_k = config.arm_stiffness_n_m;
  const long double arm_c = config.arm_damping_n_s_m;
  WideMatrix stuck{};
  stuck[2 * kN + 3] = 1;
  stuck[3 * kN + 0] = grip_k / arm_kg;
  stuck[3 * kN + 1] = grip_c / arm_kg;
  stuck[3 * kN + 2] = -(grip_k + arm_k) / arm_kg;
  stuck[3 * kN + 3] = -(grip_c + arm_c) / arm_kg;
  stuck[3 * kN + 4] = arm_k / arm_kg;
  stuck[3 * kN + 5] = arm_c / arm_kg;
  stuck[4 * kN + 5] = 1;
  WideMatrix moving = stuck;
  moving[0 * kN + 1] = 1;
  moving[1 * kN + 0] = -grip_k / device_kg;
  moving[1 * kN + 1] = -(config.device_damping_n_s_m + grip_c) / device_kg;
  moving[1 * kN + 2] = grip_k / device_kg;
  moving[1 * kN + 3] = grip_c / device_kg;
  moving[1 * kN + 6] = 1 / device_kg;
  long double h = config.period_s;
  for (int level = 0; level < kLevels; ++level, h *= 0.5L) {
    const WideMatrix wide_moving = exponential(moving, h);
    const WideMatrix wide_stuck = exponential(stuck, h);
    for (int i = 0; i < kN * kN; ++i) {
      moving_[level][i] = static_cast<double>(wide_moving[i]);
      stuck_[level][i] = static_cast<double>(wide_stuck[i]);
    }
  }
}

void AxisPlant::reset(double pos_m) noexcept {
  state_ = {pos_m, 0, pos_m, 0, pos_m, 0, 0};
}

AxisPlant::State AxisPlant::apply(const Matrix& matrix, const State& state) noexcept {
  State result;
  for (int i = 0; i < kN; ++i) {
    const double* row = &matrix[static_cast<std::size_t>(i) * kN];
    result[i] = row[0] * state[0] + row[1] * state[1] + row[2] * state[2] + row[3] * state[3] +
                row[4] * state[4] + row[5] * state[5] + row[6] * state[6];
  }
  return result;
}

double AxisPlant::acceleration(const State& state) const noexcept {
  return (state[6] - config_.device_damping_n_s_m * state[1] +
          config_.grip_stiffness_n_m * (state[2] - state[0]) +
          config_.grip_damping_n_s_m * (state[3] - state[1])) /
         config_.device_mass_kg;
}

/// What friction or a stop must balance to keep the handle at rest.
double AxisPlant::held_force_n(const State& state, double force_n) const noexcept {
  return force_n + config_.grip_stiffness_n_m * (state[2] - state[0]) + config_.grip_damping_n_s_m * state[3];
}

double AxisPlant::friction_n(Phase phase) const noexcept {
  if (phase == Phase::kForward) return config_.coulomb_friction_n;
  if (phase == Phase::kBackward) return -config_.coulomb_friction_n;
  return 0;
}

AxisPlant::Phase AxisPlant::phase_for(const State& state, double force_n) const noexcept {
  const double friction = config_.coulomb_friction_n;
  if (state[1] != 0) {
    if (friction == 0) return Phase::kFree;
    return state[1] > 0 ? Phase::kForward : Phase::kBackward;
  }
  const bool at_upper = state[0] >= stop_m_;
  const bool at_lower = state[0] <= -stop_m_;
  if (friction == 0 && !at_upper && !at_lower) return Phase::kFree;
  const double net_n = held_force_n(state, force_n);
  if (net_n > friction && !at_upper) return friction == 0 ? Phase::kFree : Phase::kForward;
  if (net_n < -friction && !at_lower) return friction == 0 ? Phase::kFree : Phase::kBackward;
  return Phase::kStuck;
}

AxisPlant::Verdict AxisPlant::judge(Phase phase, const State& from, const State& to, double force_n,
                                    double step_s) const noexcept {
  if (phase == Phase::kStuck) {
    const double net_n = held_force_n(to, force_n);
    const bool holds = (net_n <= config_.coulomb_friction_n || to[0] >= stop_m_) &&
                       (net_n >= -config_.coulomb_friction_n || to[0] <= -stop_m_);
    return holds ? Verdict::kGood : Verdict::kCrossed;
  }
  if (std::fabs(to[0]) > stop_m_) return Verdict::kCrossed;
  if (phase == Phase::kFree) return Verdict::kGood;
  const double sign = phase == Phase::kForward ? 1.0 : -1.0;
  if (!(sign * to[1] > 0)) return Verdict::kCrossed;
  // The velocity may dip through zero and come back within the step: then its acceleration changes from
  // against to along the motion, and v cannot fall faster than it begins to.
  const double a_from = sign * acceleration(from);
  const bool may_dip = a_from < 0 && sign * from[1] + a_from * step_s <= 0 && sign * acceleration(to) > 0;
  return may_dip ? Verdict::kMayDip : Verdict::kGood;
}

void AxisPlant::advance(double force_n, double intended_pos_m) noexcept {
  state_[5] = (intended_pos_m - state_[4]) / config_.period_s;
  Phase phase = phase_for(state_, force_n);
  std::uint64_t remaining = std::uint64_t{1} << (kLevels - 1);  // in units of the smallest step
  int level = 0;
  int events = 0;
  int accepted = 0;  // in a row at this level
  bool parent_crossed =
      false;  // the step of twice the size was refused for an event, and would have led to `beyond`
  State beyond{};
  while (remaining > 0) {
    for (; (std::uint64_t{1} << (kLevels - 1 - level)) > remaining; ++level) {
      accepted = 0;
      parent_crossed = false;
    }
    state_[6] = force_n - friction_n(phase);
    State next = apply(phase == Phase::kStuck ? stuck_[level] : moving_[level], state_);
    ++evaluations_;
    const double step_s = config_.period_s / static_cast<double>(std::uint64_t{1} << level);
    const Verdict verdict =
        events >= kMaxEvents ? Verdict::kGood : judge(phase, state_, next, force_n, step_s);
    if (verdict != Verdict::kGood && level < kLevels - 1) {
      parent_crossed = verdict == Verdict::kCrossed;
      if (parent_crossed) beyond = next;
      accepted = 0;
      ++level;
      continue;
    }
    remaining -= std::uint64_t{1} << (kLevels - 1 - level);
    bool event = verdict != Verdict::kGood;  // it lies in this smallest step
    if (!event && ++accepted == 2) {
      // Two halves of a refused step are good: either whatever made it small is past, or the crossing is so
      // shallow that rounding hides it from small steps. Then it is here, and the larger step knows its far
      // side.
      accepted = 0;
      event = parent_crossed;
      if (event) next = beyond;
      if (!event && level > 0) --level;
    }
    if (event) {
      ++events;
      ++events_;
      if (std::fabs(next[0]) > stop_m_) next[0] = next[0] > 0 ? stop_m_ : -stop_m_;
      next[1] = 0;
      phase = events >= kMaxEvents ? Phase::kStuck : phase_for(next, force_n);
      level = 0;
      accepted = 0;
      parent_crossed = false;
    }
    state_ = next;
  }
  state_[4] = intended_pos_m;
}

double AxisPlant::stored_j() const noexcept {
  const double grip_m = state_[2] - state_[0];
  const double arm_m = state_[4] - state_[2];
  return 0.5 * (config_.device_mass_kg * state_[1] * state_[1] + config_.arm_mass_kg * state_[3] * state_[3] +
                config_.grip_stiffness_n_m * grip_m * grip_m + config_.arm_stiffness_n_m * arm_m * arm_m);
}

Plant::Plant(const PlantConfig& config)
    : config_((config.validate(), config)),
      axes_{AxisPlant(config, config.workspace_half_m[0]), AxisPlant(config, config.workspace_half_m[1]),
            AxisPlant(config, config.workspace_half_m[2])} {}

void Plant::reset(const Vec3& pos_m) noexcept {
  for (int axis = 0; axis < 3; ++axis) axes_[static_cast<std::size_t>(axis)].reset(pos_m[axis]);
}

Vec3 Plant::applied_force_n(const Vec3& commanded_n) const noexcept {
  if (!is_finite(commanded_n)) return Vec3::Zero();
  Vec3 applied_n = commanded_n;
  if (config_.force_quantum_n > 0) {
    for (int axis = 0; axis < 3; ++axis) {
      applied_n[axis] = std::floor(applied_n[axis] / config_.force_quantum_n + 0.5) * config_.force_quantum_n;
    }
  }
  const double norm_n = applied_n.norm();
  if (norm_n > config_.force_max_n) applied_n *= config_.force_max_n / norm_n;
  return applied_n;
}

void Plant::advance(const Vec3& applied_n, const Vec3& intended_pos_m) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    axes_[static_cast<std::size_t>(axis)].advance(applied_n[axis], intended_pos_m[axis]);
  }
}

Vec3 Plant::pos_m() const noexcept {
  return {axes_[0].pos_m(), axes_[1].pos_m(), axes_[2].pos_m()};
}

Vec3 Plant::vel_m_s() const noexcept {
  return {axes_[0].vel_m_s(), axes_[1].vel_m_s(), axes_[2].vel_m_s()};
}

Vec3 Plant::encoder_pos_m() const noexcept {
  Vec3 pos = pos_m();
  const double quantum_m = config_.position_quantum_m;
  if (quantum_m > 0) {
    for (int axis = 0; axis < 3; ++axis) pos[axis] = std::floor(pos[axis] / quantum_m + 0.5) * quantum_m;
  }
  return pos;
}

double Plant::stored_j() const noexcept {
  return axes_[0].stored_j() + axes_[1].stored_j() + axes_[2].stored_j();
}

}  // namespace telenano::device

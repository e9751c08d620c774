#pragma once

#include <array>
#include <cstdint>

#include "telenano/nve_server/slave/slave.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// What a slave that is wrong on purpose (mutants.h) makes of what it is told and of what it answers. Its
/// energy sums stay those of the right one, but where they are what is wrong.
class WrongSlave {
 public:
  explicit WrongSlave(Mutant mutant) noexcept : mutant_(mutant) { late_.fill(Vec3::Zero()); }
  void before(const slave::SlaveLimits& limits, double dt_s, slave::SlaveInput& input) noexcept;
  void after(double dt_s, slave::SlaveOutput& output) noexcept;

 private:
  Vec3 wrong_force_w_nn(double dt_s, const slave::SlaveOutput& output) noexcept;

  static constexpr std::size_t kLateSteps = 100;  // 0.1 s at 1 kHz
  Mutant mutant_;
  std::array<Vec3, kLateSteps> late_;
  std::size_t at_ = 0;
  double passed_s_ = 0;
  int withdrawals_ = 0;
  double touching_s_ = 0;
  double free_s_ = 1e9;
  Vec3 held_w_nn_ = Vec3::Zero();
  Vec3 summed_w_nm_ = Vec3::Zero();
  Vec3 last_w_nm_ = Vec3::Zero(), before_w_nm_ = Vec3::Zero();  // told in the last two steps
  std::int64_t steps_ = 0;
  bool sums_ = false;
  std::uint64_t noise_ = 0x9e3779b97f4a7c15ull;
};

}  // namespace telenano::studies::stress

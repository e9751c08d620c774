#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/common/recording/sample.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// Is a row what was? Held against where the hand truly stood when the tick began, the force that truly acts
/// from then on, the hand's true account, what the slave has said, and against the ticks that there were.
class RecordWatch {
 public:
  RecordWatch(double period_s, double quantum_m) : period_s_(period_s), quantum_m_(quantum_m) {}

  /// The energy that the row says the hand has put in, less `given_j`, which the port had truly given when the tick began: the
  /// same but for what the encoder hides, and rounding.
  static bool has_energy(const recording::Sample& row, double given_j, double hidden_j) noexcept {
    constexpr double kRoundingJ = 1e-9;
    return std::fabs(row.energy_j + given_j) <= hidden_j + kRoundingJ &&
           std::fabs(row.energy_in_j - row.energy_out_j - row.energy_j) <= kRoundingJ;
  }

  /// What the slave said after a step.
  struct Said {
    Vec3 force_w_nn = Vec3::Zero();
    Vec3 tip_w_nm = Vec3::Zero();
    double deflection_nm = 0;
  };
  /// The sample's force that the row says, the tip's place and the deflection are those that the slave has said at once, no
  /// earlier than those of the row before.
  bool has_force(const recording::Sample& row, const std::vector<Said>& said) noexcept {
    const auto is_it = [](const recording::Xyz& a, const Vec3& b) {
      return a[0] == b.x() && a[1] == b.y() && a[2] == b.z();
    };
    if (!heard_ && is_it(row.force_w_nn, Vec3::Zero())) return true;  // no reply yet
    for (std::size_t at = heard_at_; at < said.size(); ++at) {
      if (!is_it(row.force_w_nn, said[at].force_w_nn) || !is_it(row.tip_pos_w_nm, said[at].tip_w_nm) ||
          row.deflection_nm != said[at].deflection_nm)
        continue;
      heard_at_ = at;
      return heard_ = true;
    }
    return false;
  }

  /// `periods`: from this tick to the next one.
  bool is_true(const recording::Sample& row, const Vec3& hand_pos_h_m, const Vec3& applied_h_n,
               int periods) noexcept {
    bool right = true;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<int>(i);
      // An encoder shows the nearest of its steps; otherwise the same number.
      right = right && std::fabs(row.hand_pos_h_m[i] - hand_pos_h_m[axis]) <= 0.5 * quantum_m_ * (1 + 1e-9);
      right = right && row.hand_force_applied_h_n[i] == applied_h_n[axis];
    }
    if (last_tick_ >= 0)
      right = right && row.tick == last_tick_ + 1 && std::fabs(row.time_s - due_s_) < 1e-9 + 0.01 * period_s_;
    last_tick_ = row.tick;
    due_s_ = row.time_s + periods * period_s_;
    return right;
  }

 private:
  double period_s_, quantum_m_;
  bool heard_ = false;
  std::size_t heard_at_ = 0;
  std::int64_t last_tick_ = -1;
  double due_s_ = 0;
};

/// A recorder that is wrong on purpose (mutants.h).
class WrongRecorder {
 public:
  explicit WrongRecorder(Mutant mutant) noexcept : mutant_(mutant) {}
  /// What it writes of a tick; null: nothing.
  const recording::Sample* operator()(const recording::Sample& row) noexcept {
    ++count_;
    written_ = row;
    switch (mutant_) {
      case Mutant::kRecordLate:  // position and force of the tick before
        if (count_ > 1) {
          written_.hand_pos_h_m = last_.hand_pos_h_m;
          written_.hand_force_applied_h_n = last_.hand_force_applied_h_n;
        }
        last_ = row;
        break;
      case Mutant::kRecordRendered:  // what the method wanted, before clamp and limits
        written_.hand_force_applied_h_n = row.hand_force_rendered_h_n;
        break;
      case Mutant::kRecordGaps:
        if (count_ % 500 == 0) return nullptr;
        break;
      case Mutant::kRecordSingle:
        for (double& x : written_.hand_pos_h_m) x = static_cast<double>(static_cast<float>(x));
        break;
      case Mutant::kRecordEnergy:  // what came out of the hand's port goes in again
        written_.energy_j = row.energy_in_j + row.energy_out_j;
        break;
      case Mutant::kRecordForce:  // of the sample, in the hand's frame of another day
        written_.force_w_nn[0] = -row.force_w_nn[0];
        written_.force_w_nn[2] *= 1.001;
        break;
      case Mutant::kRecordSwapped:
        std::swap(written_.hand_pos_h_m[0], written_.hand_pos_h_m[2]);
        break;
      default:
        break;
    }
    return &written_;
  }

 private:
  Mutant mutant_;
  std::int64_t count_ = 0;
  recording::Sample written_, last_;
};

}  // namespace telenano::studies::stress

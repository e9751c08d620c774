#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include "telenano/common/control/local_slave.h"
#include "tests/studies/stress/run_spec.h"

namespace telenano::studies::stress {

/// A station's twin that is wrong on purpose (mutants.h). What it says of its state is what a right one says, so that no
/// comparison of hashes finds it out.
class WrongTwin final : public control::LocalSlave {
 public:
  WrongTwin(std::unique_ptr<control::LocalSlave> right, Mutant mutant)
      : right_(std::move(right)), mutant_(mutant) {
    late_.fill(Vec3::Zero());
  }
  static bool concerns(Mutant mutant) noexcept {
    return mutant >= Mutant::kTwinHalf && mutant <= Mutant::kTwinOneWay;
  }

  void step(const control::LocalStep& step, control::LocalAnswer& answer) noexcept override {
    right_->step(step, answer);
    switch (mutant_) {
      case Mutant::kTwinHalf:
        answer.force_w_nn *= 0.5;
        break;
      case Mutant::kTwinLate:
        std::swap(late_[at_], answer.force_w_nn);
        at_ = (at_ + 1) % kLateSteps;
        break;
      case Mutant::kTwinNoFriction:
        answer.force_w_nn.x() = answer.force_w_nn.y() = 0;
        break;
      case Mutant::kTwinOneWay:
        if (answer.commanded_pos_w_nm.z() > last_z_w_nm_) answer.force_w_nn *= 1.3;
        last_z_w_nm_ = answer.commanded_pos_w_nm.z();
        break;
      default:
        break;
    }
  }
  std::uint64_t state_hash() const noexcept override { return right_->state_hash(); }
  void reset() noexcept override { right_->reset(); }
  bool load(std::span<const std::uint8_t> bytes, control::LocalAnswer& answer) noexcept override {
    return right_->load(bytes, answer);
  }
  std::size_t snapshot_bytes_max() const noexcept override { return right_->snapshot_bytes_max(); }
  double well_aj() const noexcept override { return right_->well_aj(); }
  std::uint64_t scene_hash() const noexcept override { return right_->scene_hash(); }
  std::shared_ptr<const surface::HeightView> heights() const override { return right_->heights(); }

 private:
  static constexpr std::size_t kLateSteps = 20;
  std::unique_ptr<control::LocalSlave> right_;
  Mutant mutant_;
  std::array<Vec3, kLateSteps> late_;
  std::size_t at_ = 0;
  double last_z_w_nm_ = 0;
};

}  // namespace telenano::studies::stress

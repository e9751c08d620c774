#pragma once

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include "tests/support/accounted_hand.h"

namespace telenano::support {

/// A hand whose true position goes where a policy sends it, whatever the force: as strong as it wants to be,
/// never faster than the velocity up to which something is promised. It knows the force that will act until
/// the next sample before it moves: no hand can know more.
class DrivenHand final : public AccountedHand {
 public:
  struct View {
    std::int64_t tick = 0;  ///< since the motion started
    double force_n = 0;     ///< on the hand, upwards positive, until the next sample
    double pos_m = 0;
  };
  using Policy = std::function<double(const View&)>;  ///< where to be at the next sample, m; followed as fast
                                                      ///< as allowed

  DrivenHand(const AccountedHandConfig& config, Policy policy, std::size_t ticks_expected = 0)
      : AccountedHand(config), policy_(std::move(policy)) {
    path_m_.reserve(ticks_expected);
  }

  const std::vector<double>& path_m() const noexcept { return path_m_; }  ///< at each sample since it started

 protected:
  long double next_pos_m(double force_n) noexcept override {
    // One part in 10⁹ less than allowed, so that no rounding of Δx is ever too fast; and no faster than what
    // the encoder will not make too fast.
    const double reach_m =
        config().velocity_max_m_s * config().period_s * (1 - 1e-9) - config().position_quantum_m;
    const double goal_m = policy_({tick_++, force_n, pos_m()});
    const double next_m = pos_m() + std::clamp(goal_m - pos_m(), -reach_m, reach_m);
    path_m_.push_back(next_m);
    return next_m;
  }

 private:
  Policy policy_;
  std::int64_t tick_ = 0;
  std::vector<double> path_m_;
};

}  // namespace telenano::support

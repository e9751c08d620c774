#pragma once

#include "telenano/common/control/energy_observer.h"
#include "telenano/common/control/passivity_controller.h"

namespace telenano::support {

/// A passivity controller with the observer that counts for it, as the station has them.
class WatchedController {
 public:
  explicit WatchedController(const control::PassivityConfig& config) noexcept
      : observer_(config.position_quantum_m), controller_(config) {}

  void observe(const Vec3& applied_force_h_n, const Vec3& hand_pos_h_m, double dt_s) noexcept {
    const bool first = !observer_.started();
    control::PortInterval interval;
    interval.applied_force_h_n = applied_force_h_n;
    interval.hand_pos_h_m = hand_pos_h_m;
    interval.dt_s = dt_s;
    interval.put_in_j = observer_.update(applied_force_h_n, hand_pos_h_m);
    interval.displacement_h_m = observer_.displacement_h_m();
    if (first) {
      controller_.take_over(0, hand_pos_h_m);
    } else {
      controller_.account_for(interval);
    }
  }
  const control::EnergyObserver& observer() const noexcept { return observer_; }
  control::PassivityController& controller() noexcept { return controller_; }

  Vec3 damper_force_h_n() const noexcept { return controller_.damper_force_h_n(); }
  double damper_n_s_m() const noexcept { return controller_.damper_n_s_m(); }
  double damper_cap_n_s_m() const noexcept { return controller_.damper_cap_n_s_m(); }
  double force_bound_n() const noexcept { return controller_.force_bound_n(); }
  double account_j() const noexcept { return controller_.account_j(); }
  double credit_j() const noexcept { return controller_.credit_j(); }

 private:
  control::EnergyObserver observer_;
  control::PassivityController controller_;
};

}  // namespace telenano::support

#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include "telenano/common/control/model_method.h"
#include "telenano/common/control/one_port.h"
#include "telenano/common/control/station_method.h"
#include "telenano/common/control/twin.h"
#include "telenano/common/control/two_layer_tank.h"
#include "telenano/common/control/two_port.h"
#include "telenano/common/control/wave_port.h"

namespace telenano::control {

/// All methods of a station, one of them in use; each is small, so a change allocates nothing.
class Methods {
 public:
  Methods(Method method, const MethodConfig& config) noexcept
      : none_(Method::kNone, config),
        ks_(Method::kKs, config),
        ks_clamp_(Method::kKsClamp, config),
        two_port_(config),
        wave_(config),
        tank_(config),
        model_(config),
        twin_(config),
        method_(method) {}

  /// From now on a method of the caller's own stands in for whichever is in use: a candidate, or one that is
  /// known to be wrong and must be found out. The slave is told what `method()` says.
  void stand_in(std::unique_ptr<StationMethod> other) noexcept { other_ = std::move(other); }

  StationMethod& now() noexcept { return other_ ? *other_ : of(method_); }
  const StationMethod& now() const noexcept { return const_cast<Methods*>(this)->now(); }
  Method method() const noexcept { return method_; }

  /// Bumpless in energy: the deficit is carried over, nothing is granted. What the sample was credited with
  /// stays credited, less what of it is forfeited here with a surplus: that may be credited again, where the
  /// account is the port's own account. The caller takes care of the force.
  void change_to(Method method, const MethodConfig& config, const Vec3& hand_pos_h_m) noexcept {
    const double account_j = now().account_j();
    double credited_j = now().credited_j();
    if (claims_energy_bound(method_) && credited_j > 0)
      credited_j = std::max(0.0, credited_j - std::max(0.0, account_j));
    // Only a tank gets back what was sent to the slave.
    if (method != Method::kTank) credited_j = std::max(0.0, credited_j);
    method_ = method;
    now().take_over(account_j, config, hand_pos_h_m);
    now().set_credited_j(credited_j);
  }

 private:
  StationMethod& of(Method method) noexcept {
    switch (method) {
      case Method::kNone:
        return none_;
      case Method::kKs:
        return ks_;
      case Method::kTdpa:
        return two_port_;
      case Method::kWave:
        return wave_;
      case Method::kTank:
        return tank_;
      case Method::kModel:
        return model_;
      case Method::kTwin:
        return twin_;
      case Method::kKsClamp:
        break;
    }
    return ks_clamp_;
  }

  OnePort none_;
  OnePort ks_;
  OnePort ks_clamp_;
  TwoPort two_port_;
  WavePort wave_;
  TwoLayerTank tank_;
  ModelMethod model_;
  Twin twin_;
  Method method_;
  std::unique_ptr<StationMethod> other_;
};

}  // namespace telenano::control

#pragma once

#include <array>

#include "telenano/common/control/method.h"
#include "telenano/common/control/scaling.h"

namespace telenano::view_model {

/// Where the sliders may go: 0 < α_v α_F ≤ bound, the exact sampled-data bound (common/control/scaling.h) at
/// the delay that binds the method, as computed when the session began.
struct ScalingRegion {
  std::array<double, control::kAllMethods.size()> impedance_bound{};  ///< of α_v α_F, by Method
  double device_force_scale = 0;  ///< α_F above which the greatest tip force saturates the device; a mark
  double velocity_min = 1e-9;     ///< ends of the sliders
  double velocity_max = 1e-4;
  double force_min = 1;
  double velocity_planned = 1e-6;  ///< of the session's start
  bool unsafe_allowed = false;     ///< the person insisted at the start: the limit is drawn, not kept

  double bound(control::Method method) const noexcept {
    return impedance_bound[static_cast<std::size_t>(method)];
  }
  /// Upper end of the slider of α_F: what lies beyond the border is seen, too.
  double force_top() const noexcept;
  /// Largest α_F for this α_v.
  double force_max(control::Method method, double velocity) const noexcept;
  /// The nearest scaling that may be asked for: α_v is kept within its ends, α_F gives way.
  control::Scaling clamped(control::Method method, const control::Scaling& wanted) const noexcept;
};

/// A value on a logarithmic slider, 0 … 1, and back.
double slider_of(double value, double least, double greatest) noexcept;
double value_of(double slider, double least, double greatest) noexcept;

}  // namespace telenano::view_model

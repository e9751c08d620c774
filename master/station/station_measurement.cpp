#include "telenano/master/station/station.h"

namespace telenano::station {
namespace {

// A measurement beyond these is no measurement: counted, it would buy or cost energy for the rest of the
// session.
constexpr double kBelievableStepM = 1.0;  // of the hand in a tick
constexpr double kBelievableForce = 2.0;  // times what the device can do

}  // namespace

/// Everything that is known about the interval that has just ended: its energy, and whether it was a sane
/// one.
void Station::watch(const StationInput& input, double dt_s) noexcept {
  hand_step_h_m_.setZero();
  if (input.buttons & device::kButtonStop) latched_ |= kFaultStopPressed;
  if (input.device_status == device::DeviceStatus::kFailed) latched_ |= kFaultDeviceFailed;
  if (input.device_status == device::DeviceStatus::kHoming) {
    // Where the hand is means nothing until the device is calibrated, and leaps when it is. No force acts
    // meanwhile, so there is nothing to count, and the account goes on where the first good position finds it.
    has_hand_pos_ = false;
    applied_force_h_n_.setZero();
    return;
  }
  const bool believable_pos =
      is_finite(input.hand_pos_h_m) &&
      (!has_hand_pos_ || (input.hand_pos_h_m - hand_pos_h_m_).cwiseAbs().maxCoeff() <= kBelievableStepM);
  const bool believable_force =
      is_finite(input.applied_force_h_n) &&
      input.applied_force_h_n.cwiseAbs().maxCoeff() <= kBelievableForce * device_force_max_n_;
  if (!believable_pos) latched_ |= kFaultHandPosNonFinite;
  if (!believable_force) latched_ |= kFaultAppliedNonFinite;
  // What cannot be measured cannot be counted; the stop holds the force at zero until a person has looked.
  if (!believable_pos || !believable_force) return;
  if (!has_hand_pos_ && observer_.started()) observer_.resume_at(input.hand_pos_h_m);
  const bool first = !observer_.started() || !has_hand_pos_;
  control::PortInterval interval;
  interval.applied_force_h_n = input.applied_force_h_n;
  interval.hand_pos_h_m = input.hand_pos_h_m;
  interval.dt_s = dt_s;
  interval.put_in_j = observer_.update(input.applied_force_h_n, input.hand_pos_h_m);
  interval.displacement_h_m = observer_.displacement_h_m();
  if (first) {
    methods_.change_to(methods_.method(), method_config(), input.hand_pos_h_m);
  } else {
    methods_.now().account_for(interval);
  }
  applied_force_h_n_ = input.applied_force_h_n;
  if (has_hand_pos_) hand_step_h_m_ = input.hand_pos_h_m - hand_pos_h_m_;
  hand_pos_h_m_ = input.hand_pos_h_m;
  has_hand_pos_ = true;
  if (hand_step_h_m_.norm() > config_.trip_velocity_m_s * dt_s) latched_ |= kFaultVelocityTrip;
}

}  // namespace telenano::station

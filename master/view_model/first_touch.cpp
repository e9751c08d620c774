#include "telenano/master/view_model/first_touch.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "telenano/master/station/station.h"
#include "telenano/master/view_model/status_text.h"

namespace telenano::view_model {
namespace {

station::Mode mode_of(const LiveSession& live) {
  return static_cast<station::Mode>(live.now().station_mode);
}

bool released(const LiveSession& live) {
  return live.force_curve().retract().state == ForceCurve::State::kDone;
}

}  // namespace

void FirstTouch::update(const LiveSession& live) {
  // Each step as soon as it is done; several at once where a person is fast.
  if (step_ == Step::kHold && mode_of(live) == station::Mode::kEngaged) step_ = Step::kApproach;
  if (step_ == Step::kApproach && live.gap_nm() < kNear_nm) step_ = Step::kTouch;
  if (step_ == Step::kTouch && live.contact()) step_ = Step::kPress;
  if (step_ == Step::kPress && live.now().force_w_nn[2] > kPress_nn) step_ = Step::kPullOff;
  // Who pulls back before having pressed has felt what this is about.
  const bool leaves = step_ == Step::kPress || step_ == Step::kPullOff;
  if (leaves && released(live)) step_ = Step::kDone;
  // Up again without that: the replies stopped on the way, and nothing was felt of it.
  if (step_ == Step::kPress) interrupted_ = false;
  if (leaves && step_ != Step::kDone && !live.contact() && live.gap_nm() > kAway_nm) {
    interrupted_ = true;
    step_ = Step::kApproach;
  }
}

std::string FirstTouch::title() const {
  if (step_ == Step::kDone) return "First touch: done";
  return fmt::format("First touch, step {} of {}", static_cast<int>(step_) + 1, kSteps);
}

std::string FirstTouch::words(const LiveSession& live, Hand hand, bool shows_force) const {
  if (mode_of(live) == station::Mode::kStopped && step_ != Step::kDone)
    return "Stopped: look why, then clear the stop (R)";
  const bool watch = hand == Hand::kSimulated;
  const std::string gap = length_text(std::max(live.gap_nm(), 0.0));
  switch (step_) {
    case Step::kHold:
      return hand == Hand::kMouse    ? "Press the left mouse button in this picture and keep it down"
             : hand == Hand::kDevice ? "Take the handle and keep its deadman button pressed"
                                     : "Watch: the simulated hand takes hold";
    case Step::kApproach:
      if (interrupted_)
        return watch ? "The session was held on the way up: pick the task once more"
                     : fmt::format("The session was held on the way up: once more, {} to the surface", gap);
      return watch                  ? fmt::format("It goes down: {} to the surface", gap)
             : hand == Hand::kMouse ? fmt::format("Drag down, slowly: {} to the surface", gap)
                                    : fmt::format("Go down, slowly: {} to the surface", gap);
    case Step::kTouch:
      return watch ? "It goes on until the sample pulls the tip in"
                   : "A little further, until the sample pulls the tip in";
    case Step::kPress:
      return watch ? "In contact: it presses a little" : "In contact. Press a little: go on down";
    case Step::kPullOff:
      return watch ? "It pulls back: the sample holds on, then lets go"
                   : "Now up again, slowly: the sample holds on, then lets go";
    case Step::kDone:
      break;
  }
  const auto pull = live.force_curve().pull_off();
  if (!pull) return "It let go without holding on: this sample does not adhere here. G closes this";
  const double nn = std::abs(pull->force_nn);
  if (!shows_force)
    return fmt::format("Pull-off: it held on with {} and let go. G closes this", force_text(nn));
  return fmt::format("Pull-off: it held on with {}, {:.2g} N at the hand, and let go. G closes this",
                     force_text(nn), nn * 1e-9 * live.now().force_scale);
}

}  // namespace telenano::view_model

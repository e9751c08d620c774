#pragma once

#include <cstdint>
#include <string>

#include "telenano/master/view_model/live_session.h"

namespace telenano::view_model {

/// Guides a person who has never touched a sample from the first grip to a pull-off, in five steps. What is
/// done is taken from what the loop reports; a person may also go ahead of the guide.
class FirstTouch {
 public:
  enum class Step : std::uint8_t { kHold, kApproach, kTouch, kPress, kPullOff, kDone };
  enum class Hand : std::uint8_t { kMouse, kDevice, kSimulated };
  static constexpr int kSteps = 5;
  /// Here a sample begins to be felt: van der Waals forces reach some nanometres.
  static constexpr double kNear_nm = 5;
  /// More than noise, less than what marks a soft sample.
  static constexpr double kPress_nn = 2;

  /// Here it is long let go.
  static constexpr double kAway_nm = 10;

  /// Once a frame.
  void update(const LiveSession& live);

  Step step() const noexcept { return step_; }
  /// "First touch, step 2 of 5", or that it is done.
  std::string title() const;
  /// What to do now, with how far it is. `shows_force`: the device has motors.
  std::string words(const LiveSession& live, Hand hand, bool shows_force) const;

 private:
  Step step_ = Step::kHold;
  bool interrupted_ = false;  ///< the last way up was not seen to its end
};

}  // namespace telenano::view_model

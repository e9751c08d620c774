#include "telenano/master/station/station.h"

namespace telenano::station {

control::Method usable_method(control::Method wanted, std::uint64_t features) noexcept {
  using control::Method;
  constexpr std::uint64_t kModelling = link::kFeatureLocalModel | link::kFeaturePortControl;
  if (wanted == Method::kTwin && (features & link::kFeatureStepLog) == 0) wanted = Method::kModel;
  if (wanted == Method::kModel && (features & kModelling) != kModelling) wanted = Method::kTank;
  if (control::needs_port_control(wanted) && !(features & link::kFeaturePortControl))
    wanted = Method::kKsClamp;
  return wanted;
}

/// A twin must be there too, of the scene that is served, and must not have been given up.
control::Method Station::usable(control::Method wanted) const noexcept {
  if (wanted == control::Method::kTwin && (!twin_ || !twin_->on())) wanted = control::Method::kModel;
  return usable_method(wanted, features_);
}

/// Where the hand's motion goes on. A server that has not executed all of a log which goes on stands where its
/// newest executed step led; the others come to it again, and then it stands where they lead. An anchor at the
/// former place would be a step back of the tip, and one of the force.
Vec3 Station::session_start_w_nm(const link::Welcome& welcome) const noexcept {
  const link::StepReport& steps = welcome.steps;
  const bool goes_on = (welcome.feature_bits & link::kFeatureStepLog) != 0 &&
                       (welcome.feature_bits & link::kFeatureSharing) == 0 && welcome.epoch == epoch_ &&
                       steps.executed < newest_step_ && steps.breaks <= step_breaks_;
  return goes_on ? last_step_w_nm_ : welcome.start_pos_w_nm;
}

void Station::begin_session(const link::Welcome& welcome, bool known_account) noexcept {
  mapping_.begin(session_start_w_nm(welcome), welcome.workspace_min_w_nm, welcome.workspace_max_w_nm);
  last_target_w_nm_ = mapping_.target_w_nm();
  has_reply_ = false;  // the last force may only fade until the new session answers
  newest_sequence_ = 0;
  if (mode_ == Mode::kEngaged) mode_ = Mode::kHeld;
  const bool new_epoch = welcome.epoch != epoch_;
  epoch_ = welcome.epoch;
  features_ = welcome.feature_bits;
  if (new_epoch || welcome.steps.executed > newest_step_) newest_step_ = welcome.steps.executed;
  step_breaks_ = welcome.steps.breaks;
  if (new_epoch) slave_sums_.reset();
  if (new_epoch && !known_account) slave_sums_.begin_with_next();
  scales_.begin_session(new_epoch);
  if (new_epoch) {
    sample_.reset();
    given_aj_ = 0;
  }
  well_aj_ = (features_ & link::kFeatureWell) != 0 ? welcome.well_aj : 0;
  tip_hold_ = 0;
  tip_up_ = waits_for_tip_ = false;
  const bool expected = expected_scene_ != 0 && welcome.scene_hash == expected_scene_;
  expected_scene_ = 0;
  if (has_scene_ && welcome.scene_hash != scene_hash_ && !expected) latched_ |= kFaultOtherScene;
  scene_hash_ = welcome.scene_hash;
  wells_.go_to(scene_hash_);
  has_scene_ = true;
  if (twin_) {
    if (logs_steps() && twin_->scene_hash() == welcome.scene_hash) {
      twin_->begin(welcome.steps, new_epoch || !has_scene_, 1e-3 * welcome.timeout_ms, last_tick_ns_,
                   shares_tip());
    } else {
      twin_->leave();
    }
  }
  const control::Method method = usable(config_.method);
  if (method != methods_.method()) methods_.change_to(method, method_config(), hand_pos_h_m_);
  methods_.now().begin_session(new_epoch);
  if (welcome.coupling_stiffness_n_m > slave_.coupling_stiffness_n_m ||
      welcome.coupling_damping_n_s_m > slave_.coupling_damping_n_s_m) {
    latched_ |= kFaultSlaveStiffer;
  }
}

}  // namespace telenano::station

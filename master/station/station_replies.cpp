#include "telenano/master/station/station.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace telenano::station {
namespace {

// Of the longest round trip: shorter than that, and forces come back.
constexpr double kYoungAgain = 0.8;

bool finite_reply(const link::Reply& reply) noexcept {
  return is_finite(reply.force_w_nn) && is_finite(reply.tip_pos_w_nm) && std::isfinite(reply.deflection_nm) &&
         std::isfinite(reply.energy_in_aj) && std::isfinite(reply.energy_out_aj) &&
         std::isfinite(reply.port.energy_sent_aj) && is_finite(reply.port.wave_sum) &&
         std::isfinite(reply.port.wave_energy_aj) && link::is_finite(reply.model);
}

}  // namespace

void Station::accept_reply(const StationInput& input) noexcept {
  const bool is_new = input.reply != nullptr && input.session_up && input.reply->sequence > newest_sequence_;
  stale_s_ = static_cast<double>(input.time_ns - last_reply_ns_) * 1e-9;
  if (is_new) {
    newest_sequence_ = input.reply->sequence;
    if (finite_reply(*input.reply)) {
      const bool resumes = !has_reply_ || stale_s_ > hold_s();
      reply_ = *input.reply;
      if (shares_tip()) on_tip_share(reply_.tip);
      on_tip_up();
      has_reply_ = true;
      if (logs_steps()) step_breaks_ = std::max(step_breaks_, reply_.steps.breaks);
      last_reply_ns_ = input.time_ns;
      stale_s_ = 0;
      bump_ahead_ = bump_ahead_ || resumes;
      if (twin_ && logs_steps()) {
        twin_->hold(tip_hold_);
        twin_->on_reply(reply_.steps, input.time_ns);
      }
      const link::ReceivedSums::News added = account_for_slave();
      if (holds_tip()) {
        tip_force_h_n_ = config_.scaling.hand_force_n(reply_.force_w_nn);
        update_method(added, price_j_aj_);
      }
    } else {
      faults_ |= kFaultReplyNonFinite;
      has_reply_ = false;
      tip_force_h_n_.setZero();
      ramp_ = 0;
    }
  }
  blind_s_ = stale_s_;
  if (shows_twin()) {
    const double beyond_s = twin_->lag_s(input.time_ns) - twin_->lag_most_s(input.rtt_s);
    if (beyond_s > 0) blind_s_ = std::max(blind_s_, hold_s() + beyond_s);
  }
  if (has_reply_ && blind_s_ > hold_s()) faults_ |= kFaultStale;
  watch_age(input);
}

/// Of a shared tip only the holder is moved by forces and moves it. Who gets it begins where it stands; who
/// loses it keeps the last force that was his, and lets it fade.
void Station::on_tip_share(const link::TipShare& tip) noexcept {
  const bool begins = tip.hold != tip_hold_ && tip.hold != 0;
  const bool stays = tip.hold == tip_hold_ && tip.hold != 0;
  tip_hold_ = tip.hold;
  if (stays) return;
  stand_at_tip(tip.pos_w_nm);
  if (begins) begin_anew();
}

/// A tip that is up shows no force and follows nobody; where it comes back, the target was not. Whatever the
/// hand did meanwhile moves nothing: it is anchored anew when the slave says that the tip is there.
void Station::on_tip_up() noexcept {
  const bool was_up = std::exchange(tip_up_, (reply_.fault_bits & link::kFaultRetracted) != 0);
  if (!holds_tip() || was_up == tip_up_) return;
  stand_at_tip(shares_tip() ? reply_.tip.pos_w_nm : reply_.tip_pos_w_nm);
  if (was_up) begin_anew();
}

/// Replies that come every millisecond are no news if each is of a second ago. Beyond the method's longest
/// round trip the force fades and the tip holds as in an outage that begins then, until it is well below.
void Station::watch_age(const StationInput& input) noexcept {
  const double most_s = config_.age_most_s(methods_.method());
  const bool was_old = old_;
  old_ = input.session_up && !shows_twin() && input.rtt_s > (was_old ? kYoungAgain * most_s : most_s);
  if (!old_) return;
  if (!was_old) old_since_ns_ = input.time_ns;
  faults_ |= kFaultOld;
  blind_s_ = std::max(blind_s_, hold_s() + 1e-9 * static_cast<double>(input.time_ns - old_since_ns_));
}

}  // namespace telenano::station

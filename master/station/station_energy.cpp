#include "telenano/master/station/station.h"

#include <algorithm>
#include <cmath>

namespace telenano::station {
namespace {

control::ContactPlane contact_plane(const link::LocalModel& m) noexcept {
  control::ContactPlane model;
  if (m.version == 0) return model;
  model.version = m.version;
  model.point_w_nm = m.point_w_nm;
  model.normal_w = m.normal_w;
  model.stiffness_n_m = m.stiffness_n_m;
  model.adhesion_nn = m.adhesion_nn;
  model.shear_stiffness_n_m = m.shear_stiffness_n_m;
  model.friction_nn = m.friction_nn;
  return model;
}

}  // namespace

/// What the newest reply has added to the slave's sums; of what came out, what may be credited.
link::ReceivedSums::News Station::account_for_slave() noexcept {
  link::ReceivedSums::News added = slave_sums_.update(reply_);
  given_aj_ += added.energy_out_aj - added.energy_in_aj;
  wells_.give(given_aj_);
  price_j_aj_ = scales_.answered(reply_.command_sequence, config_.scaling.hand_energy_j(1));
  sample_.put_in(added.energy_in_aj, price_j_aj_);
  added.energy_out_aj = sample_.take_out(added.energy_out_aj, price_j_aj_);
  return added;
}

/// What the newest reply says. Energies and waves come as sums; the method is told what has been added to
/// them, at the price that held then: nothing, when it hears the same reply again after a change.
void Station::update_method(const link::ReceivedSums::News& added, double price_j_aj) noexcept {
  const auto crossed_j = [price_j_aj](double energy_aj) {
    const double energy_j = price_j_aj * energy_aj;
    return std::isfinite(energy_j) ? energy_j : 0.0;  // two finite numbers may make one that is not
  };
  control::SlaveNews news;
  news.force_h_n = tip_force_h_n_;
  news.touching = reply_.contact_state == link::ContactState::kContact;
  news.energy_out_j = crossed_j(added.energy_out_aj);
  news.energy_sent_j = crossed_j(added.energy_sent_aj);
  news.wave_h = added.wave * std::sqrt(price_j_aj);
  if (!is_finite(news.wave_h)) news.wave_h.setZero();
  news.wave_j = crossed_j(added.wave_aj);
  const SampleCredit credit = sample_credit();
  news.well_j = credit.well_j;
  news.given_j = credit.given_j;
  news.model = contact_plane(reply_.model);
  news.answers = reply_.command_sequence;
  methods_.now().on_reply(news);
}

/// Of all samples so far: those that were left have given what they were believed, and give no more.
Station::SampleCredit Station::sample_credit() noexcept {
  const double well_now_j = well_j();
  const double given_now_j = std::min(config_.scaling.hand_energy_j(given_aj()), well_now_j);
  wells_.believe(given_now_j);
  const double others_j = wells_.of_others_j();
  return {others_j + well_now_j, others_j + given_now_j};
}

/// The sample's own energy, as slave and twin know of it: credited is the larger, once.
double Station::given_aj() const noexcept {
  return std::max(wells_.most_given_aj(), twin_ ? twin_->most_given_aj() : 0.0);
}

/// The deepest well that is believed: with a twin no more than the station has found in the scene itself.
/// That is known all the same when the twin was given up: a server must not gain by making it part.
double Station::well_j() const noexcept {
  const bool knows_scene = twin_ && has_scene_ && twin_->scene_hash() == scene_hash_;
  double believed_aj = knows_scene ? std::min(well_aj_, twin_->well_aj()) : well_aj_;
  // A companded sample is one whose well is so much deeper. That is the station's own doing, no server's word.
  if (knows_scene && methods_.method() == control::Method::kTwin)
    believed_aj += twin_->companding().most_ever_aj();
  if (!wells_.knows()) return 0;
  const double most_j = std::max(0.0, config_.well_max_j - wells_.of_others_j());
  return std::min(config_.scaling.hand_energy_j(believed_aj), most_j);
}

}  // namespace telenano::station

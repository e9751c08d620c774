#include "telenano/master/view_model/live_session.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/link/messages.h"
#include "telenano/master/view_model/nice_step.h"

namespace telenano::view_model {
namespace {

constexpr std::size_t kTrailPoints = 1500;
constexpr std::size_t kTouchedPoints = 20000;
constexpr double kTouchedCell_nm = 1;
constexpr double kLeastFull_nn = 5;
constexpr double kLeastFull_nm = 0.2;

// 1, 2, 5 · 10^n not less than the greatest of the window.
double full_scale(const Strip& sizes, double least_full) noexcept {
  double least = 0;
  double greatest = 0;
  if (!sizes.range(least, greatest)) return least_full;
  const double step = nice_step(greatest);
  return std::max(greatest <= step ? step : nice_step(step * 2.5), least_full);
}

}  // namespace

LiveSession::LiveSession(double trail_step_nm)
    : gap_strip_(kWindowS, kBins),
      tip_force_(kWindowS, kBins),
      force_size_(kWindowS, kBins),
      deflection_size_(kWindowS, kBins),
      raw_force_(kWindowS, kBins),
      limited_force_(kWindowS, kBins),
      applied_force_(kWindowS, kBins),
      energy_(kWindowS, kBins),
      damper_(kWindowS, kBins),
      trail_(kTrailPoints, trail_step_nm),
      touched_(kTouchedPoints, kTouchedCell_nm) {}

bool LiveSession::contact() const noexcept {
  return static_cast<link::ContactState>(now_.contact_state) == link::ContactState::kContact;
}

void LiveSession::take(const recording::Sample& sample, const Ground& ground) {
  now_ = sample;
  const auto& at = sample.particle_pos_w_nm;
  const link::Particle particle{{at[0], at[1], at[2]},
                                sample.particle_radius_nm,
                                static_cast<link::ParticleStatus>(sample.particle_state)};
  // A recording may hold anything.
  const bool known = sample.particle_state >= 0 &&
                     sample.particle_state <= static_cast<std::int64_t>(link::ParticleStatus::kLost);
  if (particle.radius_nm > 0 && known && is_finite(particle)) particle_ = particle;
  ++taken_;
  const double t = sample.time_s;
  raw_force_.add(t, sample.hand_force_scaled_h_n[2]);
  limited_force_.add(t, sample.hand_force_commanded_h_n[2]);
  applied_force_.add(t, sample.hand_force_applied_h_n[2]);
  energy_.add(t, 1e3 * sample.energy_j);
  damper_.add(t, sample.damper_n_s_m);
  if (sample.reply_sequence == 0) return;  // there is no tip yet
  const Vec3 tip(sample.tip_pos_w_nm[0], sample.tip_pos_w_nm[1], sample.tip_pos_w_nm[2]);
  const Vec3 force(sample.force_w_nn[0], sample.force_w_nn[1], sample.force_w_nn[2]);
  gap_nm_ = tip.z() - ground.height_w_nm(tip.x(), tip.y());
  gap_strip_.add(t, gap_nm_);
  tip_force_.add(t, force.z());
  force_size_.add(t, force.norm());
  deflection_size_.add(t, std::abs(sample.deflection_nm));
  force_curve_.take(sample, gap_nm_);
  if (sample.reply_sequence == reply_seen_) return;  // nothing new was heard
  reply_seen_ = sample.reply_sequence;
  if (sample.measurement_age_ms > 0) origin_ = Origin::kMeasured;
  if (origin_ == Origin::kUnknown) origin_ = Origin::kComputed;
  round_trips_.add(sample.rtt_us);
  trail_.add(tip, contact());
  if (contact()) touched_.add(tip);
}

double LiveSession::force_full_nn() const noexcept {
  return full_scale(force_size_, kLeastFull_nn);
}

double LiveSession::deflection_full_nm() const noexcept {
  return full_scale(deflection_size_, kLeastFull_nm);
}

}  // namespace telenano::view_model

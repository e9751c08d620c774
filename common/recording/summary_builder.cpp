#include "telenano/common/recording/summary_builder.h"

#include <algorithm>
#include <cmath>

namespace telenano::recording {
namespace {

// std::max and std::min with the new value second: a NaN in a row is passed over.

constexpr std::uint32_t kNonContact = 2;  // adhesive neck, the lowest state that counts as touching
constexpr double kStaysInPlaceNm = 1.0;

bool touches(const Sample& sample) noexcept {
  return sample.contact_state >= kNonContact;
}

double norm(const Xyz& v) noexcept {
  return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/// Never negative, NaN is 0, and far below the border of the integers.
std::int64_t nanoseconds(double us) noexcept {
  return us > 0 ? static_cast<std::int64_t>(std::min(us, 1e12) * 1e3) : 0;
}

/// The values of a bin are taken to be spread evenly over it, so that a narrow distribution is not reported
/// at the border of its bin.
double percentile_us(const rt::LogHistogram& histogram, double q) noexcept {
  const double wanted = q * static_cast<double>(histogram.count());
  double below = 0;
  for (std::size_t bin = 0; bin < rt::LogHistogram::kBins; ++bin) {
    const auto here = static_cast<double>(histogram.bin_count(bin));
    if (here > 0 && below + here >= wanted) {
      const double low = bin == 0 ? 0.0 : static_cast<double>(rt::LogHistogram::upper_ns(bin - 1));
      const double high = static_cast<double>(std::min(rt::LogHistogram::upper_ns(bin), histogram.max_ns()));
      return (low + (high - low) * (wanted - below) / here) * 1e-3;
    }
    below += here;
  }
  return static_cast<double>(histogram.max_ns()) * 1e-3;
}

Percentiles percentiles_us(const rt::LogHistogram& histogram) noexcept {
  return {percentile_us(histogram, 0.5), percentile_us(histogram, 0.99),
          static_cast<double>(histogram.max_ns()) * 1e-3};
}

}  // namespace

void SummaryBuilder::add(const Sample& sample) noexcept {
  if (so_far_.rows == 0) first_ = sample;
  add_contact(sample);
  add_hand(sample);
  add_link(sample);
  add_control(sample);
  lateness_.add(nanoseconds(sample.lateness_us));
  step_.add(nanoseconds(sample.step_us));
  so_far_.fault_bits |= sample.fault_bits;
  so_far_.station_faults |= sample.station_faults;
  last_ = sample;
  ++so_far_.rows;
}

void SummaryBuilder::add_contact(const Sample& sample) noexcept {
  const double force = sample.force_w_nn[2];
  so_far_.largest_attraction_nn = std::max(so_far_.largest_attraction_nn, -force);
  so_far_.peak_repulsion_nn = std::max(so_far_.peak_repulsion_nn, force);
  if (so_far_.rows == 0) target_min_nm_ = target_max_nm_ = sample.tip_target_w_nm;
  for (std::size_t i = 0; i < 3; ++i) {
    target_min_nm_[i] = std::min(target_min_nm_[i], sample.tip_target_w_nm[i]);
    target_max_nm_[i] = std::max(target_max_nm_[i], sample.tip_target_w_nm[i]);
  }
  if (!touches(sample)) return;
  const double z = sample.tip_pos_w_nm[2];
  so_far_.pull_off_force_nn = std::max(so_far_.pull_off_force_nn, -force);
  if (so_far_.rows == 0 || !touches(last_)) touch_z_nm_ = z;
  lowest_touching_z_nm_ = touching_ == 0 ? z : std::min(lowest_touching_z_nm_, z);
  depth_below_touch_nm_ = std::max(depth_below_touch_nm_, touch_z_nm_ - z);
  ++touching_;
}

void SummaryBuilder::add_hand(const Sample& sample) noexcept {
  const Xyz& force = sample.hand_force_applied_h_n;
  so_far_.peak_hand_force_n = std::max(so_far_.peak_hand_force_n, norm(force));
  so_far_.peak_scaled_force_n = std::max(so_far_.peak_scaled_force_n, norm(sample.hand_force_scaled_h_n));
  const double z_mm = sample.hand_pos_h_m[2] * 1e3;
  if (so_far_.rows == 0) {
    so_far_.hand_z_min_mm = so_far_.hand_z_max_mm = z_mm;
    return;
  }
  so_far_.hand_z_min_mm = std::min(so_far_.hand_z_min_mm, z_mm);
  so_far_.hand_z_max_mm = std::max(so_far_.hand_z_max_mm, z_mm);
  const Xyz& before = last_.hand_force_applied_h_n;
  for (std::size_t i = 0; i < 3; ++i) force_step_sum_n2_ += (force[i] - before[i]) * (force[i] - before[i]);
}

void SummaryBuilder::add_link(const Sample& sample) noexcept {
  const std::int64_t before = so_far_.rows == 0 ? 0 : last_.reply_sequence;
  if (sample.reply_sequence != before && sample.rtt_us > 0) rtt_.add(nanoseconds(sample.rtt_us));
  if (sample.force_age_ms > 0) force_age_.add(nanoseconds(sample.force_age_ms * 1e3));
  // A new session after a lost server counts its replies from the start.
  if (sample.reply_sequence < before) replies_of_past_epochs_ += before;
}

void SummaryBuilder::add_control(const Sample& sample) noexcept {
  so_far_.energy_least_j =
      so_far_.rows == 0 ? sample.energy_j : std::min(so_far_.energy_least_j, sample.energy_j);
  so_far_.damper_max_n_s_m = std::max(so_far_.damper_max_n_s_m, sample.damper_n_s_m);
  const bool by_damper = sample.damper_n_s_m > 0 || (sample.limit_flags & kLimitDamper) != 0;
  const bool by_clamp = (sample.limit_flags & kLimitClamp) != 0;
  damped_ += by_damper ? 1 : 0;
  clamped_ += by_clamp ? 1 : 0;
  acted_ += by_damper || by_clamp ? 1 : 0;
  limited_ += (sample.limit_flags & (kLimitForce | kLimitSlew)) != 0 ? 1 : 0;
  so_far_.stale_ticks += (sample.limit_flags & kLimitStale) != 0 ? 1 : 0;
}

Summary SummaryBuilder::finish() const noexcept {
  Summary s = so_far_;
  if (s.rows == 0) return s;
  const auto fraction = [&](std::uint64_t ticks) {
    return static_cast<double>(ticks) / static_cast<double>(s.rows);
  };
  s.duration_s = last_.time_s - first_.time_s;

  const bool in_place = target_max_nm_[0] - target_min_nm_[0] < kStaysInPlaceNm &&
                        target_max_nm_[1] - target_min_nm_[1] < kStaysInPlaceNm;
  s.depth_below_surface = context_.surface_z_w_nm.has_value() && in_place;
  s.greatest_depth_nm = depth_below_touch_nm_;
  if (s.depth_below_surface) {
    s.greatest_depth_nm =
        touching_ == 0 ? 0.0 : std::max(0.0, *context_.surface_z_w_nm - lowest_touching_z_nm_);
  }
  s.contact_fraction = fraction(touching_);
  if (s.rows > 1) s.force_step_rms_n = std::sqrt(force_step_sum_n2_ / static_cast<double>(s.rows - 1));

  s.rtt_us = percentiles_us(rtt_);
  s.replies = replies_of_past_epochs_ + last_.reply_sequence;
  s.lost = last_.lost;
  s.reordered = last_.reordered;
  s.duplicates = last_.duplicates;
  s.dropped = last_.dropped;
  if (s.replies > 0) s.loss_fraction = static_cast<double>(s.lost) / static_cast<double>(s.replies);

  s.jitter_us = last_.jitter_us;
  s.clock_drift_ppm = last_.clock_drift_ppm;
  s.rtt_min_us = last_.rtt_min_us;
  s.force_age_us = percentiles_us(force_age_);
  s.commands_sent = last_.commands_sent;
  s.commands_lost = last_.commands_lost;
  s.playout_late = last_.playout_late;

  s.energy_end_j = last_.energy_j;
  s.energy_in_j = last_.energy_in_j;
  s.energy_out_j = last_.energy_out_j;
  s.slave_energy_net_aj = last_.slave_energy_in_aj - last_.slave_energy_out_aj;
  s.controller_duty = fraction(acted_);
  s.damper_duty = fraction(damped_);
  s.clamp_duty = fraction(clamped_);
  s.force_limit_duty = fraction(limited_);

  s.lateness_us = percentiles_us(lateness_);
  s.step_us = percentiles_us(step_);
  s.overruns = last_.overruns;
  // Deadlines are absolute, so the periods that have passed are right to one whatever the jitter; a late last
  // tick must not count as a missed one. Ticks that were run but not recorded are in the tick numbers.
  const double periods = (s.duration_s - (last_.lateness_us - first_.lateness_us) * 1e-6) * context_.rate_hz;
  if (std::abs(periods) < 1e15) {
    s.missed_ticks = std::max<std::int64_t>(0, std::llround(periods) - (last_.tick - first_.tick));
  }
  return s;
}

}  // namespace telenano::recording

#include "telenano/nve_server/afm/signal_watch.h"

#include <algorithm>
#include <cmath>

namespace telenano::afm {
namespace {

constexpr double kChance = 1e-13;       // of a live signal that looks frozen
constexpr int kLeastRepeats = 5;        // a float that repeats so often is no float of a converter
constexpr double kSurelyRests = 0.999;  // more than this, and a signal may well rest for minutes
constexpr double kPart = 0.1;           // of the contact's stiffness that must show
constexpr double kWrongPart = 0.3;
constexpr double kContactNoise = 6;   // of it, over the force of contact
constexpr double kEnd = 0.999;        // of the range
constexpr double kLateralPart = 0.5;  // of what the deflection should show: no crosstalk
constexpr std::int64_t kAnchorNs = 500'000'000;

}  // namespace

std::string_view name(SignalFault fault) noexcept {
  constexpr std::string_view kNames[] = {"good",
                                         "it repeats the same value, bit for bit: frozen",
                                         "it stands at an end of its range",
                                         "it is far noisier than when the tip was free",
                                         "it does not follow the motion of the lever in contact",
                                         "the lateral signal shows what the deflection should: swapped"};
  return kNames[static_cast<std::size_t>(fault)];
}

void SignalWatch::limit() noexcept {
  most_repeats_ = kNoLimit;
  if (!(sigma_v_ > 0) || spread_v_ < 1.5 * quantum_v_) return;
  const double sigma = std::max(0.5 * sigma_v_, 0.25 * quantum_v_);
  const double p = std::erf(quantum_v_ / (2 * std::sqrt(2.0) * sigma));
  if (p > kSurelyRests) return;
  const double n = p > 0 ? std::log(kChance) / std::log(p) : 0;
  most_repeats_ = std::max(kLeastRepeats, static_cast<int>(std::ceil(n)));
}

void SignalWatch::learn(std::span<const double> volts) noexcept {
  if (volts.size() < 3) return;
  double squares = 0, low = volts[0], high = volts[0];
  for (std::size_t i = 1; i < volts.size(); ++i) {
    const double d = std::fabs(volts[i] - volts[i - 1]);
    squares += d * d;
    if (d > 0 && (quantum_v_ == 0 || d < quantum_v_)) quantum_v_ = d;
    low = std::min(low, volts[i]);
    high = std::max(high, volts[i]);
  }
  // By neighbours: what moves slowly is no noise.
  sigma_v_ = std::sqrt(squares / (2 * static_cast<double>(volts.size() - 1)));
  spread_v_ = high - low;
  limit();
}

void SignalWatch::learn_lateral(std::span<const double> volts) noexcept {
  if (volts.size() < 3) return;
  double squares = 0, sum = volts[0];
  for (std::size_t i = 1; i < volts.size(); ++i) {
    squares += (volts[i] - volts[i - 1]) * (volts[i] - volts[i - 1]);
    sum += volts[i];
  }
  lateral_sigma_v_ = std::sqrt(squares / (2 * static_cast<double>(volts.size() - 1)));
  lateral_free_v_ = sum / static_cast<double>(volts.size());
  lateral_known_ = true;
}

void SignalWatch::begin() noexcept {
  any_ = before_last_known_ = anchored_ = lateral_anchored_ = false;
  repeats_ = strikes_ = 0;
  odd_.fill(false);
}

double SignalWatch::scatter_nn() const noexcept {
  return rig_.nn_v * (8 * sigma_v_ + 4 * quantum_v_);
}

SignalFault SignalWatch::add(const Reading& r) noexcept {
  if (std::fabs(r.volts) >= kEnd * rig_.range_v || std::fabs(r.lateral_volts) >= kEnd * rig_.range_v)
    return SignalFault::kAtEnd;
  const bool repeats = any_ && r.volts == last_.volts;
  const double change_v = any_ ? std::fabs(r.volts - last_.volts) : 0;
  if (change_v > 0 && (quantum_v_ == 0 || change_v < quantum_v_)) {
    quantum_v_ = change_v;
    limit();
  }
  SignalFault fault = SignalFault::kNone;
  if (!repeats) {
    repeats_ = 0;
    highest_nm_ = r.highest_nm;
    run_low_nm_ = r.highest_nm;
    run_high_nm_ = r.lowest_nm;
    run_across_nm_ = 0;
    counted_ns_ = r.time_ns;
  } else {
    highest_nm_ = std::max(highest_nm_, r.highest_nm);
    // Between two windows that do not overlap it has surely moved; within one the average may be of any part.
    run_low_nm_ = std::min(run_low_nm_, r.highest_nm);
    run_high_nm_ = std::max(run_high_nm_, r.lowest_nm);
    run_across_nm_ += r.across_nm;
    // Two answers within one period may be of the same average.
    if (r.time_ns - counted_ns_ >= rig_.period_ns * 3 / 4) {
      counted_ns_ = r.time_ns;
      ++repeats_;
    }
    const double way_nm = run_high_nm_ - run_low_nm_ - rig_.step_nm;
    const bool moved = r.stiffness_n_m > 0 && r.force_nn > r.contact_nn && run_across_nm_ < rig_.step_nm &&
                       kPart * r.stiffness_n_m * way_nm > scatter_nn();
    if (repeats_ >= most_repeats_ || (repeats_ >= 3 && moved && way_nm > 0)) fault = SignalFault::kFrozen;
  }
  if (fault == SignalFault::kNone && lateral_known_ && swapped(r)) fault = SignalFault::kSwapped;
  if (fault == SignalFault::kNone && r.stiffness_n_m > 0) {
    if (any_ && noisy(r)) fault = SignalFault::kNoisy;
    if (fault == SignalFault::kNone && strikes(r)) fault = SignalFault::kNotFollowing;
  }
  before_last_ = last_;
  before_last_known_ = any_;
  last_ = r;
  any_ = true;
  return fault;
}

bool SignalWatch::exchanged(const Reading& r, const Reading& before, double way_nm,
                            double across_nm) const noexcept {
  const double way_v = rig_.lever_n_m * way_nm / rig_.nn_v;
  const double noise_v = 8 * std::sqrt(2.0) * sigma_v_ + 3 * quantum_v_;
  const double lateral_noise_v = 8 * std::sqrt(2.0) * lateral_sigma_v_ + 3 * quantum_v_;
  // What moves along Z alone changes the one and not the other.
  const double may_v = noise_v + way_v;
  const double lateral_may_v = lateral_noise_v + (across_nm > 0 ? way_v : 0);
  // And what does not change has gone nowhere.
  const double apart_v = std::fabs(before.volts - before.lateral_volts);
  if (std::fabs(r.lateral_volts - before.lateral_volts) < 0.5 * apart_v ||
      std::fabs(r.volts - before.volts) < 0.5 * apart_v)
    return false;
  return apart_v > 2 * (noise_v + lateral_noise_v + (across_nm > 0 ? way_v : 0)) &&
         std::fabs(r.volts - before.lateral_volts) < lateral_may_v &&
         std::fabs(r.lateral_volts - before.volts) < may_v;
}

bool SignalWatch::swapped(const Reading& r) noexcept {
  // The reading in which it happened may be half of the one and half of the other.
  if (any_ && exchanged(r, last_, r.way_nm, r.across_nm)) return true;
  if (before_last_known_ &&
      exchanged(r, before_last_, r.way_nm + last_.way_nm, r.across_nm + last_.across_nm))
    return true;
  const double shows_nn = rig_.sign * rig_.nn_v * (r.lateral_volts - lateral_free_v_);
  if (r.still_across && std::fabs(r.force_nn) < r.contact_nn && std::fabs(shows_nn) > 0.5 * rig_.limit_nn)
    return true;
  return r.stiffness_n_m > 0 && lateral_follows(r);
}

bool SignalWatch::lateral_follows(const Reading& r) noexcept {
  const auto anchor = [&] {
    lateral_anchored_ = true;
    lateral_low_nm_ = r.lowest_nm;
    lateral_high_nm_ = r.highest_nm;
    lateral_anchor_v_ = r.lateral_volts;
    lateral_anchor_nn_ = r.force_nn;
    lateral_anchor_ns_ = r.time_ns;
    return false;
  };
  if (!lateral_anchored_ || r.across_nm > 0 ||
      r.time_ns - lateral_anchor_ns_ > std::max(kAnchorNs, 4 * rig_.period_ns))
    return anchor();
  const double down_nm =
      std::max(lateral_low_nm_ - r.highest_nm, 0.0) - std::max(r.lowest_nm - lateral_high_nm_, 0.0);
  const double noise_nn = rig_.nn_v * (8 * lateral_sigma_v_ + 4 * quantum_v_);
  const double least_nm =
      std::max(2 * rig_.step_nm, noise_nn / (kLateralPart * r.stiffness_n_m) + rig_.step_nm);
  if (std::fabs(down_nm) < least_nm) return false;
  const double full_nn = r.stiffness_n_m * down_nm;
  const double lateral_part = rig_.sign * rig_.nn_v * (r.lateral_volts - lateral_anchor_v_) / full_nn;
  const double part = (r.force_nn - lateral_anchor_nn_) / full_nn;
  if (lateral_part > kLateralPart && std::fabs(part) < kPart) return true;
  return anchor();
}

bool SignalWatch::noisy(const Reading& r) noexcept {
  if (r.way_nm > 0.5 * rig_.step_nm) return false;  // what motion does is for strikes()
  const bool contact = std::fabs(r.force_nn) > r.contact_nn;
  const double may_nn = rig_.nn_v * (8 * std::sqrt(2.0) * sigma_v_ + 3 * quantum_v_) +
                        rig_.lever_n_m * (r.way_nm + (contact ? 0.5 : 0.1) * rig_.step_nm);
  odd_[odd_at_++ % odd_.size()] = std::fabs(r.force_nn - last_.force_nn) > may_nn;
  return std::count(odd_.begin(), odd_.end(), true) >= static_cast<std::ptrdiff_t>(odd_.size() / 2);
}

bool SignalWatch::strikes(const Reading& r) noexcept {
  // Surely in contact: noise alone does not lift a reading so high.
  const double contact_nn = r.contact_nn + kContactNoise * rig_.nn_v * sigma_v_;
  const auto anchor = [&] {
    anchored_ = std::fabs(r.force_nn) > contact_nn;
    anchor_low_nm_ = r.lowest_nm;
    anchor_high_nm_ = r.highest_nm;
    anchor_nn_ = r.force_nn;
    anchor_ns_ = r.time_ns;
    return false;
  };
  if (!anchored_ || r.across_nm > 0) {
    strikes_ = 0;
    return anchor();
  }
  // What changes over a longer time is drift and creep.
  if (r.time_ns - anchor_ns_ > std::max(kAnchorNs, 4 * rig_.period_ns)) return anchor();
  // What lies between the two windows is sure; within them a reading may be of any part.
  const double down_nm =
      std::max(anchor_low_nm_ - r.highest_nm, 0.0) - std::max(r.lowest_nm - anchor_high_nm_, 0.0);
  const double least_nm = std::max(2 * rig_.step_nm, scatter_nn() / (kPart * r.stiffness_n_m) + rig_.step_nm);
  if (std::fabs(down_nm) < least_nm) return false;
  const double part = (r.force_nn - anchor_nn_) / (r.stiffness_n_m * down_nm);
  const bool presses = r.force_nn > contact_nn && anchor_nn_ > contact_nn;
  const bool pulls = r.force_nn < -contact_nn && anchor_nn_ < -contact_nn;
  strikes_ = (presses && part < kPart) || (pulls && part < -kWrongPart) ? strikes_ + 1 : 0;
  anchor();
  return strikes_ >= 2;
}

}  // namespace telenano::afm

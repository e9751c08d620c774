#include "telenano/nve_server/afm/surface_tracker.h"

#include <algorithm>
#include <cmath>

namespace telenano::afm {
namespace {

constexpr std::array<double, 3> kCreep_s{4, 20, 100};
constexpr double kCreepPart = 0.003;      // standard deviation of each part, before anything is known
constexpr double kDrift_nm_s = 0.5;       // of the drift, before anything is known
constexpr double kPlaceNoise_nm = 0.006;  // per √s: a place moves across under the tip
constexpr double kLeastQ = 0.02 * 0.02;   // nm²/s³
constexpr double kMostQ = 0.06 * 0.06;
constexpr double kFirstQ = 0.02 * 0.02;
constexpr double kLearn = 0.1;        // of q, by one touch
constexpr double kOutside = 5;        // standard deviations: no error any more
constexpr double kCovers = 1.96;      // 95 % of a normal error
constexpr double kUnknown_nm2 = 1e6;  // variance

double seconds(std::int64_t ns) {
  return 1e-9 * static_cast<double>(ns);
}

}  // namespace

void SurfaceTracker::piezo(double height_nm, std::int64_t now_ns) noexcept {
  if (!piezo_known_) late_nm_.fill(height_nm);
  const double dt_s = piezo_known_ ? std::max(0.0, seconds(now_ns - piezo_ns_)) : 0;
  for (std::size_t i = 0; i < kCreeps; ++i)
    late_nm_[i] += (height_nm - late_nm_[i]) * dt_s / (kCreep_s[i] + dt_s);
  piezo_ns_ = now_ns;
  piezo_known_ = true;
}

SurfaceTracker::State SurfaceTracker::row(std::size_t place) const noexcept {
  State r{};
  r[0] = 1;
  for (std::size_t i = 0; i < kCreeps; ++i) r[2 + i] = late_nm_[i] - from_nm_;
  if (place > 0) r[kFirstPlace + place] = 1;
  return r;
}

void SurfaceTracker::begin(double x_nm, double y_nm, double height_nm, std::int64_t now_ns) noexcept {
  if (!begun_) {
    covariance_ = {};
    state_ = {};
    covariance_[1][1] = kDrift_nm_s * kDrift_nm_s;
    for (std::size_t i = 0; i < kCreeps; ++i) covariance_[2 + i][2 + i] = kCreepPart * kCreepPart;
    q_ = kFirstQ;
  } else {
    predict(now_ns);
    covariance_[1][1] = std::min(covariance_[1][1], kDrift_nm_s * kDrift_nm_s);
  }
  // Nothing is known of H, and nothing that goes along with it.
  const auto forget = [this](std::size_t i, double variance) {
    for (std::size_t j = 0; j < kStates; ++j) covariance_[i][j] = covariance_[j][i] = 0;
    covariance_[i][i] = variance;
  };
  forget(0, kUnknown_nm2);
  for (std::size_t i = kFirstPlace; i < kStates; ++i) {
    forget(i, 0);
    state_[i] = 0;
  }
  for (std::size_t i = 1; i < 1 + kCreeps; ++i) {
    for (std::size_t j = 1; j < i; ++j) {
      // A variance that was lowered may leave correlations beyond 1.
      const double most = std::sqrt(covariance_[i][i] * covariance_[j][j]);
      covariance_[i][j] = covariance_[j][i] = std::clamp(covariance_[i][j], -most, most);
    }
  }
  places_ = {};
  next_place_ = 1;
  from_nm_ = height_nm;
  state_[0] = height_nm;
  time_ns_ = now_ns;
  begun_ = true;
  places_[0] = {x_nm, y_nm, true};
  correct(0, height_nm, kTouch_nm * kTouch_nm);
}

void SurfaceTracker::predict(std::int64_t now_ns) noexcept {
  const double dt = std::max(0.0, seconds(now_ns - time_ns_));
  time_ns_ = now_ns;
  if (dt <= 0) return;
  state_[0] += dt * state_[1];
  // P ← F P Fᵀ + Q; F adds dt of row 1 to row 0.
  for (std::size_t j = 0; j < kStates; ++j) covariance_[0][j] += dt * covariance_[1][j];
  for (std::size_t i = 0; i < kStates; ++i) covariance_[i][0] += dt * covariance_[i][1];
  covariance_[0][0] += q_ * dt * dt * dt / 3;
  covariance_[0][1] += q_ * dt * dt / 2;
  covariance_[1][0] = covariance_[0][1];
  covariance_[1][1] += q_ * dt;
  for (std::size_t i = 1; i < kPlaces; ++i) {
    if (places_[i].known)
      covariance_[kFirstPlace + i][kFirstPlace + i] += kPlaceNoise_nm * kPlaceNoise_nm * dt;
  }
}

void SurfaceTracker::correct(std::size_t place, double height_nm, double variance) noexcept {
  const State r = row(place);
  State gain{};
  double predicted = 0, spread = variance;
  for (std::size_t i = 0; i < kStates; ++i) {
    predicted += r[i] * state_[i];
    for (std::size_t j = 0; j < kStates; ++j) gain[i] += covariance_[i][j] * r[j];
  }
  for (std::size_t i = 0; i < kStates; ++i) spread += r[i] * gain[i];
  const double error = height_nm - predicted;
  const double outside = error * error / spread;
  if (outside > kOutside * kOutside) {
    // At the start the height has jumped, elsewhere the ground's may be another.
    const std::size_t i = place > 0 ? kFirstPlace + place : 0;
    covariance_[i][i] += error * error;
    gain[i] += error * error;
    spread += error * error;
  } else if (spread < 0.1 * kUnknown_nm2) {
    q_ = std::clamp(q_ * std::exp(kLearn * (std::min(outside, 6.0) - 1)), kLeastQ, kMostQ);
  }
  for (std::size_t i = 0; i < kStates; ++i) {
    state_[i] += gain[i] * error / spread;
    for (std::size_t j = 0; j < kStates; ++j) covariance_[i][j] -= gain[i] * gain[j] / spread;
  }
  for (std::size_t i = 0; i < kStates; ++i) covariance_[i][i] = std::max(covariance_[i][i], 0.0);
}

void SurfaceTracker::touch(double x_nm, double y_nm, double height_nm, double spread_nm,
                           std::int64_t now_ns) noexcept {
  std::size_t nearest = kPlaces;
  double least = kSamePlace_nm;
  for (std::size_t i = 0; i < kPlaces; ++i) {
    const double away = std::hypot(x_nm - places_[i].x_nm, y_nm - places_[i].y_nm);
    if (!places_[i].known || away > least) continue;
    nearest = i;
    least = away;
  }
  if (nearest < kPlaces) {
    predict(now_ns);
    const double slope = kSlope * least;
    correct(nearest, height_nm, kTouch_nm * kTouch_nm + spread_nm * spread_nm + slope * slope);
    return;
  }
  // Of the places besides the start the oldest goes.
  predict(now_ns);
  const std::size_t place = next_place_;
  next_place_ = 1 + next_place_ % (kPlaces - 1);
  const std::size_t i = kFirstPlace + place;
  places_[place] = {x_nm, y_nm, true};
  for (std::size_t j = 0; j < kStates; ++j) covariance_[i][j] = covariance_[j][i] = 0;
  covariance_[i][i] = kUnknown_nm2;
  state_[i] = 0;
  State r = row(0);
  double predicted = 0;
  for (std::size_t j = 0; j < kStates; ++j) predicted += r[j] * state_[j];
  state_[i] = height_nm - predicted;
  correct(place, height_nm, kTouch_nm * kTouch_nm + spread_nm * spread_nm);
}

double SurfaceTracker::height_nm(std::int64_t now_ns) const noexcept {
  double h = state_[0] + state_[1] * std::max(0.0, seconds(now_ns - time_ns_));
  for (std::size_t i = 0; i < kCreeps; ++i) h += state_[2 + i] * (late_nm_[i] - from_nm_);
  return h;
}

double SurfaceTracker::bound_nm(std::int64_t now_ns) const noexcept {
  State r = row(0);
  const double dt = std::max(0.0, seconds(now_ns - time_ns_));
  r[1] = dt;
  double variance = q_ * dt * dt * dt / 3;
  for (std::size_t i = 0; i < kFirstPlace; ++i)
    for (std::size_t j = 0; j < kFirstPlace; ++j) variance += r[i] * covariance_[i][j] * r[j];
  return kCovers * std::sqrt(std::max(variance, 0.0));
}

double SurfaceTracker::drift_bound_nm_s() const noexcept {
  return kCovers * std::sqrt(std::max(covariance_[1][1], 0.0));
}

}  // namespace telenano::afm

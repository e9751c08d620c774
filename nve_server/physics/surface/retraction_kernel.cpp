#include "telenano/nve_server/physics/surface/retraction_kernel.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

namespace telenano::physics {
namespace {

constexpr double kStep = 0.34657359027997265;  // of ρ: half an octave
constexpr int kBelow = 14, kAbove = 8;         // columns to either side of the tip's radius
constexpr int kFine = 8;                       // of a bin
constexpr int kBinsOfWay = 14;                 // from no force to the greatest attraction
constexpr int kBinsOfRange = 8;                // from there to half of it
constexpr double kPressed = 2.5;               // of that way, before the greatest attraction

/// A foot's curve over gaps u0 + k du.
struct Curve {
  std::vector<double> force;
  int peak = 0;  // index of the greatest attraction
  int zero = 0;  // of no force before it
};

Curve sampled(const RetractionKernel::ForcePerRadius& force, double log_radius, double u0, double du,
              int count) {
  Curve curve;
  for (int k = 0; k < count; ++k) curve.force.push_back(force(u0 + k * du, log_radius));
  const auto least = std::min_element(curve.force.begin(), curve.force.end());
  curve.peak = static_cast<int>(least - curve.force.begin());
  curve.zero = curve.peak;
  while (curve.zero > 0 && curve.force[static_cast<std::size_t>(curve.zero)] < 0.0) --curve.zero;
  return curve;
}

}  // namespace

// Looked for within a radius, finer each time.
RetractionKernel::Scale RetractionKernel::scale(const ForcePerRadius& force, double tip_radius_nm) {
  constexpr int kRounds = 6, kSamples = 400;
  Scale scale;
  double low = -tip_radius_nm, high = tip_radius_nm;
  for (int round = 0; round < kRounds; ++round) {
    const double du = (high - low) / kSamples;
    const Curve curve = sampled(force, det_log(tip_radius_nm), low, du, kSamples + 1);
    const double least = curve.force[static_cast<std::size_t>(curve.peak)];
    if (!(least < 0.0)) return {};
    int half = curve.peak;
    while (half < kSamples && curve.force[static_cast<std::size_t>(half)] < 0.5 * least) ++half;
    scale = {low + curve.peak * du, std::max(1, curve.peak - curve.zero) * du, (half - curve.peak) * du};
    const double about = 6.0 * (scale.way + scale.range);
    low = std::max(low, scale.peak - about);
    high = std::min(high, scale.peak + about);
  }
  return scale;
}

RetractionKernel::RetractionKernel(const ForcePerRadius& force, double tip_radius_nm) {
  const Scale of = scale(force, tip_radius_nm);
  if (!(of.range > 0.0)) return;
  // Rigid bodies have no way to go, but a range.
  bin_ = std::max(of.way / kBinsOfWay, of.range / kBinsOfRange);
  float all_near = 0;
  for (int b = 0; b < kBins; ++b) {
    nearness_[b] = static_cast<float>(det_exp((kBinsAbove - b) * bin_ / of.way));
    if (b >= kBinsAbove) all_near += (b == kBinsAbove ? 0.5F : 1.0F) * nearness_[b];
  }
  for (float& near : nearness_) near /= all_near * static_cast<float>(kTwoPi * bin_);
  // Gap of the first bin of the reach: the first w, and areas above the top.
  const double first_gap_nm = of.peak - kPressed * of.way - kBinsAbove * bin_;
  first_ = det_log(tip_radius_nm) - kBelow * kStep;
  for (int c = 0; c <= kBelow + kAbove; ++c)
    columns_.push_back(column(force, first_ + c * kStep, first_gap_nm));
}

RetractionKernel::Column RetractionKernel::column(const ForcePerRadius& force, double log_radius,
                                                  double first_gap_nm) const {
  const double du = bin_ / kFine;
  constexpr int kMargin = 6 * kBinsOfWay * kFine;
  const Curve curve =
      sampled(force, log_radius, first_gap_nm - kMargin * du, du, (kReach + 2) * kFine + 2 * kMargin);
  const double sigma = kSmoothing * std::max(1, curve.peak - curve.zero);
  const int half = std::min(kMargin - kFine, static_cast<int>(5.0 * sigma) + 1);
  std::vector<double> weight(static_cast<std::size_t>(half) + 1);
  double all = 0;
  for (int k = 0; k <= half; ++k) {
    weight[static_cast<std::size_t>(k)] = det_exp(-0.5 * k * k / (sigma * sigma));
    all += (k == 0 ? 1.0 : 2.0) * weight[static_cast<std::size_t>(k)];
  }
  const auto smooth = [&](int at) {
    double sum = weight[0] * curve.force[static_cast<std::size_t>(at)];
    for (int k = 1; k <= half; ++k) {
      sum += weight[static_cast<std::size_t>(k)] *
             (curve.force[static_cast<std::size_t>(at - k)] + curve.force[static_cast<std::size_t>(at + k)]);
    }
    return sum / all;
  };
  // Mean over a bin: the sum over all bins is the force again.
  Column column{};
  for (int k = 0; k < kReach; ++k) {
    const int at = kMargin + k * kFine;
    const double fall = smooth(at - kFine / 2) - smooth(at + kFine / 2);
    column.q[k % 2][k / 2] = static_cast<float>(fall / (kTwoPi * bin_));
  }
  Areas areas = {};
  for (int b = kBinsAbove; b < kBins; ++b)
    areas[b] = static_cast<float>(kTwoPi * bin_ * (b == kBinsAbove ? 0.5 : 1.0));
  column.log_peak = log_peak(column, areas);
  return column;
}

double RetractionKernel::log_peak(const Column& column, const Areas& areas) noexcept {
  float force[kPlaces] = {};
  for (int b = 0; b < kBins; ++b) {
    if (areas[b] == 0.0F) continue;
    const float* const q = &column.q[b % 2][b / 2];
    for (int k = 0; k < kPlaces; ++k) force[k] += areas[b] * q[k];
  }
  int deepest = 1;
  for (int k = 2; k < kPlaces - 1; ++k) {
    if (force[k] < force[deepest]) deepest = k;
  }
  // A parabola through the three deepest.
  const double here = force[deepest], before = force[deepest - 1], after = force[deepest + 1];
  const double bend = before + after - 2.0 * here;
  const double tilt = after - before;
  const double peak = bend > 0.0 ? here - std::min(tilt * tilt / (8.0 * bend), 0.25 * std::fabs(here)) : here;
  return peak < 0.0 ? det_log(-peak) : -INFINITY;
}

double RetractionKernel::log_excess(const Areas& areas, double log_radius) const noexcept {
  const double at =
      std::clamp((log_radius - first_) / kStep, 0.0, static_cast<double>(columns_.size()) - 1.001);
  const auto c = static_cast<std::size_t>(at);
  const double f = at - static_cast<double>(c);
  const Column& one = columns_[c];
  const Column& two = columns_[c + 1];
  Column mixed;
  const auto part = static_cast<float>(f);
  for (std::size_t parity = 0; parity < 2; ++parity) {
    for (std::size_t k = 0; k < std::size(mixed.q[0]); ++k) {
      mixed.q[parity][k] = one.q[parity][k] + part * (two.q[parity][k] - one.q[parity][k]);
    }
  }
  return log_peak(mixed, areas) - (one.log_peak + f * (two.log_peak - one.log_peak)) - log_radius;
}

double RetractionKernel::log_rise(const Areas& areas, double log_radius) const noexcept {
  constexpr double kLeastShare = 0.4;
  float near = 0;
  for (int b = 0; b < kBins; ++b) near += nearness_[b] * areas[b];
  if (!(near > 0.0F)) return 0.0;
  const double share =
      std::clamp(1.0 - kShared * (det_log(near) - log_radius), kLeastShare, 1.0 / kLeastShare);
  return std::clamp(share * log_excess(areas, log_radius), -kMostRise, kMostRise);
}

std::uint64_t RetractionKernel::hash() const noexcept {
  if (!active()) return 0;
  std::uint64_t hash = 14695981039346656037ull;
  const auto add = [&](double value) {
    auto bits = std::bit_cast<std::uint64_t>(value);
    for (int byte = 0; byte < 8; ++byte, bits >>= 8) hash = (hash ^ (bits & 0xff)) * 1099511628211ull;
  };
  add(bin_);
  add(first_);
  for (const float near : nearness_) add(near);
  for (const Column& column : columns_) {
    for (const auto& parity : column.q) {
      for (const float q : parity) add(q);
    }
    add(column.log_peak);
  }
  return hash;
}

}  // namespace telenano::physics

#include "telenano/nve_server/fit/curve_check.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <sstream>

namespace telenano::fit {
namespace {

constexpr std::size_t kBins = 50;
constexpr double kTurns = 0.05;  // of the range: further back than a sensor's noise or a piezo's creep goes
constexpr double kWay = 0.1;     // of the other way's range: less is no way
constexpr double kStill = 0.1;   // of the usual speed
constexpr double kStillMost = 0.03;  // of the range, within a pause
constexpr double kTilt = 0.03;       // of a baseline, nm/nm, whatever the slope in contact
constexpr double kFree = 0.3;        // of the slope in contact: a baseline tilts less
constexpr double kFlat = 0.25;       // of the slope in contact: a clipped detector
constexpr double kFastest =
    1.1;  // deflection over base: 1 on a rigid sample, and an error of the calibration
constexpr std::size_t kEqual = 3;  // readings in a row

double range_of(const std::vector<double>& values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return *high - *low;
}

/// Points that a way takes for its range where it moves as it mostly does: by the median of what lies in equal parts of
/// the range, so that a pause counts for nothing.
double moving_points(const std::vector<double>& z) {
  const auto [low, high] = std::minmax_element(z.begin(), z.end());
  std::vector<std::size_t> count(kBins, 0);
  for (const double value : z) {
    const double part = (value - *low) / (*high - *low) * static_cast<double>(kBins);
    ++count[std::min(static_cast<std::size_t>(part), kBins - 1)];
  }
  std::nth_element(count.begin(), count.begin() + kBins / 2, count.end());
  return static_cast<double>(std::max<std::size_t>(count[kBins / 2], 1) * kBins);
}

std::vector<double> block_means(const std::vector<double>& z, std::size_t width) {
  std::vector<double> means;
  for (std::size_t i = 0; i + width <= z.size(); i += width) {
    double sum = 0;
    for (std::size_t k = 0; k < width; ++k) sum += z[i + k];
    means.push_back(sum / static_cast<double>(width));
  }
  return means;
}

struct Slope {
  double value = 0;  ///< of the deflection over the base's way towards the sample
  double error = 0;
  double spread_nm = 0;  ///< root of the sum of squares of z about its mean
  bool good = false;
};

/// Over [begin, end).
Slope slope_of(const PreparedSegment& segment, std::size_t begin, std::size_t end) {
  const auto n = static_cast<double>(end - begin);
  double z = 0;
  double d = 0;
  for (std::size_t i = begin; i < end; ++i) {
    z += segment.z_nm[i] / n;
    d += segment.deflection_nm[i] / n;
  }
  double zz = 0;
  double zd = 0;
  double dd = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const double a = segment.z_nm[i] - z;
    const double b = segment.deflection_nm[i] - d;
    zz += a * a;
    zd += a * b;
    dd += b * b;
  }
  if (!(zz > 0) || n < 4) return {};
  return {-zd / zz, std::sqrt(std::max(dd - zd * zd / zz, 0.0) / (n - 2) / zz), std::sqrt(zz), true};
}

/// The largest slope of a twentieth of the approach: of the contact, whatever sign the deflection has.
double contact_slope(const PreparedSegment& approach) {
  double largest = 0;
  const std::size_t n = approach.z_nm.size();
  const std::size_t width = std::max<std::size_t>(n / 20, 5);
  for (std::size_t end = n; end >= width; end -= width / 2) {
    // A leap takes a few points; where the contact is a small part of the curve, it looks like one.
    const std::optional<Leap>& leap = approach.leap;
    if (leap && leap->after - leap->before < width / 2 && end - width <= leap->after && end > leap->before)
      continue;
    const Slope slope = slope_of(approach, end - width, end);
    if (slope.good) largest = std::max(largest, std::abs(slope.value) - 3 * slope.error);
  }
  return largest;
}

/// Over the baseline of its way.
double height_nm(const PreparedCurve& curve, bool approach, std::size_t i) {
  const PreparedSegment& segment = approach ? curve.approach : curve.retract;
  const int way = approach ? 0 : 1;
  return segment.deflection_nm[i] - curve.offset_nm[way] -
         curve.tilt[way] * (segment.z_nm[i] - curve.z_middle_nm);
}

/// Pressed as at the deepest point, out of the noise.
bool is_pressed(const PreparedCurve& curve, bool approach, std::size_t i) {
  const double deepest = height_nm(curve, true, curve.approach.z_nm.size() - 1);
  return (deepest > 0 ? 1 : -1) * height_nm(curve, approach, i) > 6 * curve.noise_nm;
}

/// Of readings: what their changes are multiples of; next to nothing where they are not in steps.
double step_of(const std::vector<double>& readings) {
  std::vector<double> changes{0};
  for (std::size_t i = 1; i < readings.size(); ++i)
    changes.push_back(std::abs(readings[i] - readings[i - 1]));
  std::sort(changes.begin(), changes.end());
  const double rounding = 1e-6 * range_of(readings);
  double least = changes.back();
  for (std::size_t i = 1; i < changes.size(); ++i)
    if (changes[i] - changes[i - 1] > rounding) least = std::min(least, changes[i] - changes[i - 1]);
  return least;
}

/// Equal readings in contact for longer than the steps of the readings explain, and not where the deflection turns
/// smoothly, as before a pull-off. Both ways in time: what is clipped goes over the turn.
bool has_equal_readings(const PreparedCurve& curve, double contact) {
  std::vector<double> d = curve.approach.deflection_nm;
  std::vector<double> z = curve.approach.z_nm;
  const std::size_t in = d.size();
  d.insert(d.end(), curve.retract.deflection_nm.begin(), curve.retract.deflection_nm.end());
  z.insert(z.end(), curve.retract.z_nm.begin(), curve.retract.z_nm.end());
  const double step_nm = step_of(d);
  for (std::size_t begin = 0, end = 0; begin < d.size(); begin = end) {
    for (end = begin + 1; end < d.size() && d[end] == d[begin];) ++end;
    if (end - begin < kEqual) continue;
    const auto [low, high] = std::minmax_element(z.begin() + static_cast<std::ptrdiff_t>(begin),
                                                 z.begin() + static_cast<std::ptrdiff_t>(end));
    const bool approach = begin < in;
    const double limit_nm = 8 * step_nm + 6 * curve.noise_nm;
    if (!(std::abs(height_nm(curve, approach, approach ? begin : begin - in)) > limit_nm) ||
        !(contact * (*high - *low) > limit_nm))
      continue;
    const std::size_t beside = std::max<std::size_t>(4, end - begin);
    const auto steep = [&](std::size_t i, std::size_t j) {
      return i != j && std::abs(d[i] - d[j]) > kFree * contact * std::abs(z[i] - z[j]);
    };
    if (steep(begin - std::min(begin, beside), begin) ||
        steep(end - 1, std::min(end - 1 + beside, d.size() - 1)))
      return true;
  }
  return false;
}

double mean_of(const std::vector<double>& values, std::size_t begin, std::size_t count) {
  double sum = 0;
  for (std::size_t i = begin; i < begin + count; ++i) sum += values[i];
  return sum / static_cast<double>(count);
}

/// How far the mean of the deepest `width` points stays behind the line through twice as many before them.
struct Missing {
  double height_nm = 0;
  double flat_nm = 0;  ///< what it would be if the deepest points were all as the first of them
  double error_nm = 0;
};

Missing missing_at_the_turn(const PreparedSegment& segment, bool approach, std::size_t width,
                            double noise_nm) {
  const std::size_t n = segment.z_nm.size();
  const std::size_t begin = approach ? n - width : 0;
  const std::size_t before = approach ? n - 3 * width : width;
  const Slope slope = slope_of(segment, before, before + 2 * width);
  if (!slope.good) return {};
  const double sign = slope.value > 0 ? 1 : -1;
  const double z_nm = mean_of(segment.z_nm, begin, width);
  const double away_nm = z_nm - mean_of(segment.z_nm, before, 2 * width);
  const double line_nm = mean_of(segment.deflection_nm, before, 2 * width) - slope.value * away_nm;
  const double slope_error = std::max(slope.error, noise_nm / slope.spread_nm);
  return {sign * (line_nm - mean_of(segment.deflection_nm, begin, width)),
          std::abs(slope.value) * std::abs(z_nm - segment.z_nm[approach ? begin : width - 1]),
          std::hypot(slope_error * away_nm, noise_nm / std::sqrt(static_cast<double>(width)))};
}

/// The deepest part of both ways flat beside the contact's slope: over the same lengths, from two points on.
bool is_flat_at_the_turn(const PreparedCurve& curve, double contact) {
  const PreparedSegment* ways[2] = {&curve.approach, &curve.retract};
  double usual_nm[2];
  for (int i = 0; i < 2; ++i)
    usual_nm[i] = range_of(ways[i]->z_nm) / static_cast<double>(ways[i]->z_nm.size());
  for (double length_nm = 2 * std::max(usual_nm[0], usual_nm[1]);; length_nm *= 1.2) {
    bool flat = true;
    bool bends = true;
    double missing_nm = 0;
    double variance = 0;
    for (int i = 0; i < 2; ++i) {
      const PreparedSegment& way = *ways[i];
      const std::size_t n = way.z_nm.size();
      const auto width = static_cast<std::size_t>(length_nm / usual_nm[i]);
      if (3 * width > n) return false;
      const std::size_t begin = i == 0 ? n - width : 0;
      if (!is_pressed(curve, i == 0, i == 0 ? begin : width - 1)) return false;
      const double moved_nm = std::abs(way.z_nm[begin + width - 1] - way.z_nm[begin]);
      if (!(moved_nm > 0.5 * usual_nm[i] * static_cast<double>(width - 1))) flat = bends = false;
      const Slope slope = slope_of(way, begin, begin + width);
      flat = flat && width >= 8 && slope.good && std::abs(slope.value) + 3 * slope.error < kFlat * contact;
      const Missing missing = missing_at_the_turn(way, i == 0, width, curve.noise_nm);
      bends = bends && is_pressed(curve, i == 0, i == 0 ? n - 3 * width : 3 * width - 1) &&
              missing.height_nm > 2.5 * missing.error_nm &&
              missing.flat_nm > kFlat * contact * 0.5 * moved_nm && missing.height_nm > 0.6 * missing.flat_nm;
      missing_nm += missing.height_nm;
      variance += missing.error_nm * missing.error_nm;
    }
    if (flat || (bends && missing_nm > 4 * std::sqrt(variance))) return true;
  }
}

/// Without any noise away from the sample, and with noise in contact: what is less than a limit is not seen.
bool is_cut_off_when_free(const PreparedCurve& curve, double contact) {
  for (const PreparedSegment* way : {&curve.approach, &curve.retract}) {
    const auto begin = way->deflection_nm.begin() + static_cast<std::ptrdiff_t>(way->free_begin);
    const auto end = way->deflection_nm.begin() + static_cast<std::ptrdiff_t>(way->free_end);
    if (std::any_of(begin, end, [&](double d) { return d != *begin; })) return false;
  }
  std::vector<double> pressed;
  const PreparedSegment& a = curve.approach;
  for (std::size_t i = a.free_end; i < a.z_nm.size(); ++i)
    if (a.z_nm[i] < curve.touch_z_nm) pressed.push_back(a.deflection_nm[i]);
  const double step_nm = range_of(a.z_nm) / static_cast<double>(a.z_nm.size());
  // A computed curve is smooth; a base that shakes is seen in z.
  return rough_noise(pressed) >
         std::max({4 * step_of(a.deflection_nm), 0.005 * contact * step_nm, 3 * contact * curve.z_noise_nm});
}

/// The far quarter, which the baseline is found from, at its two ends.
bool is_in_contact(const PreparedSegment& segment, bool approach, double contact) {
  const std::size_t n = segment.z_nm.size();
  const std::size_t quarter =
      std::min(segment.free_end - segment.free_begin, std::max<std::size_t>(n / 4, 4));
  const std::size_t width = std::min(quarter, std::max<std::size_t>(n / 20, 5));
  const std::size_t first = approach ? segment.free_begin : segment.free_end - quarter;
  for (const std::size_t begin : {first, first + quarter - width}) {
    const Slope slope = slope_of(segment, begin, begin + width);
    if (slope.good && std::abs(slope.value) - 3 * slope.error > std::max(kFree * contact, kTilt)) return true;
  }
  return false;
}

}  // namespace

std::string wrong_motion(const std::vector<double>& approach_z_nm, const std::vector<double>& retract_z_nm) {
  const double in_nm = range_of(approach_z_nm);
  const double out_nm = range_of(retract_z_nm);
  if (!(in_nm > 0) && !(out_nm > 0)) return {};  // refused as what does not move
  if (!(in_nm > kWay * out_nm) || !(out_nm > kWay * in_nm))
    return "goes one way only: an approach and its retract are needed";
  const double towards = approach_z_nm.back() > approach_z_nm.front() ? 1 : -1;
  const std::vector<double>* ways[2] = {&approach_z_nm, &retract_z_nm};
  double usual_nm[2];  // a point
  for (int way = 0; way < 2; ++way) usual_nm[way] = (way == 0 ? in_nm : out_nm) / moving_points(*ways[way]);
  // Wide enough that the noise of z is little beside what a block goes at a usual speed.
  const double noise_nm = std::max(rough_noise(approach_z_nm), rough_noise(retract_z_nm));
  const double slower_nm = std::min(usual_nm[0], usual_nm[1]);
  const double fewer = std::min(in_nm / usual_nm[0], out_nm / usual_nm[1]);
  auto width = static_cast<std::size_t>(std::max(1.0, fewer / 100));
  const double noisy = 50 * noise_nm / slower_nm;
  while (static_cast<double>(width * width * width) < noisy * noisy && width < approach_z_nm.size() / 20)
    ++width;
  // Of the moves from block to block: the part of what it goes at the usual speed.
  std::vector<double> part;
  std::vector<double> place_nm;
  std::size_t turn = 0;
  for (int way = 0; way < 2; ++way) {
    const std::vector<double> means = block_means(*ways[way], width);
    double farthest = -1e300;
    const double sign = way == 0 ? towards : -towards;
    for (std::size_t i = 0; i < means.size(); ++i) {
      farthest = std::max(farthest, sign * means[i]);
      if (farthest - sign * means[i] > kTurns * std::max(in_nm, out_nm))
        return "has more than two segments: leave one approach and its retract in the file";
      place_nm.push_back(means[i]);
      if (i > 0)
        part.push_back(std::abs(means[i] - means[i - 1]) / (usual_nm[way] * static_cast<double>(width)));
    }
    if (way == 0) turn = part.size();
    if (way == 0) part.push_back(0);
  }
  for (std::size_t begin = 0, end = 0; begin < part.size(); begin = end + 1) {
    end = begin;
    while (end < part.size() && part[end] < kStill) ++end;
    // A wait away from the sample, before or after, does no harm.
    if (end == begin || begin == 0 || end == part.size()) continue;
    // Over the turn a block may go forth and back.
    const std::size_t over_turn = begin <= turn && turn < end ? 1 : 0;
    const double points = static_cast<double>((end - begin - over_turn) * width);
    const bool sudden =
        (begin < 2 || part[begin - 2] > 0.5) && (end + 1 >= part.size() || part[end + 1] > 0.5);
    const bool far = std::abs(place_nm[end] - place_nm[begin]) > kStillMost * std::max(in_nm, out_nm);
    if (!far && points >= 4 && points > (sudden ? 0.008 : 0.1) * fewer)
      return "has a pause (dwell) of some " + std::to_string(static_cast<long>(points)) +
             " points: leave out its rows, it belongs to neither way";
  }
  return {};
}

std::string wrong_deflection(const PreparedCurve& curve) {
  const double contact = contact_slope(curve.approach);
  if (!(contact > 0)) return {};
  if (is_in_contact(curve.approach, true, contact))
    return "begins in contact, or not far enough from the sample: a file needs an approach from far away, "
           "then "
           "its retract";
  if (is_in_contact(curve.retract, false, contact))
    return "ends in contact, or not far enough from the sample: a retract that goes far away is needed";
  if (has_equal_readings(curve, contact) || is_flat_at_the_turn(curve, contact) ||
      is_cut_off_when_free(curve, contact))
    return "has a constant deflection, as of a detector that clips: leave out what is clipped, or "
           "press less";
  const PreparedSegment& a = curve.approach;
  const std::size_t n = a.z_nm.size();
  const std::size_t width = std::max<std::size_t>(n / 20, 5);
  const Slope deepest = slope_of(a, n - width, n);
  // Slow noise is seen as a slope.
  const double slow = 2 * curve.noise_nm / std::abs(a.z_nm[n - width] - a.z_nm[n - 1]);
  if (deepest.good && deepest.value - std::max(3 * deepest.error, slow) > kFastest) {
    std::ostringstream text;
    text.precision(3);
    text << "has a deflection that grows " << deepest.value
         << " times as fast as its base moves: check the deflection sensitivity, the units, and which column "
            "is which";
    return text.str();
  }
  return {};
}

}  // namespace telenano::fit

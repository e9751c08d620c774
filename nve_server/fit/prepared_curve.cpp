#include "telenano/nve_server/fit/prepared_curve.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "telenano/nve_server/fit/curve_check.h"

namespace telenano::fit {
namespace {

constexpr double kStandsOut = 6.0;  // times the noise

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// y = at + slope·(x − x_mean) over [begin, end).
struct Line {
  double x_mean = 0;
  double at = 0;
  double slope = 0;
  double operator()(double x) const { return at + slope * (x - x_mean); }
};

Line line_through(const std::vector<double>& x, const std::vector<double>& y, std::size_t begin,
                  std::size_t end) {
  Line line;
  const auto n = static_cast<double>(end - begin);
  for (std::size_t i = begin; i < end; ++i) {
    line.x_mean += x[i] / n;
    line.at += y[i] / n;
  }
  double xx = 0;
  double xy = 0;
  for (std::size_t i = begin; i < end; ++i) {
    xx += (x[i] - line.x_mean) * (x[i] - line.x_mean);
    xy += (x[i] - line.x_mean) * (y[i] - line.at);
  }
  line.slope = xx > 0 ? xy / xx : 0;
  return line;
}

/// `sign`: −1 a leap down (snap-in), +1 up (pull-off).
std::optional<Leap> find_leap(const PreparedSegment& segment, double noise_nm, double sign) {
  const std::vector<double>& d = segment.deflection_nm;
  const std::size_t n = d.size();
  const std::size_t width = std::min<std::size_t>(std::max<std::size_t>(2, n / 400), 8);
  double largest = 0;
  std::size_t at = 0;
  std::vector<double> usual;
  for (std::size_t i = 0; i + width < n; ++i) {
    const double change = sign * (d[i + width] - d[i]);
    usual.push_back(std::abs(change));
    if (change > largest) {
      largest = change;
      at = i;
    }
  }
  // Beside the noise, a leap must stand out of how the deflection changes anywhere else.
  std::sort(usual.begin(), usual.end());
  const double steep = usual.empty() ? 0 : usual[usual.size() * 9 / 10];
  if (!(largest > std::max(8.0 * noise_nm, 3.0 * steep))) return std::nullopt;
  Leap leap;
  leap.before = at;
  leap.after = at + width;
  // To what still moves faster than noise and usual slope explain.
  const double slow = std::max(4.0 * noise_nm, 2.0 * steep / static_cast<double>(width));
  while (leap.before + 1 < leap.after && sign * (d[leap.before + 1] - d[leap.before]) < slow) ++leap.before;
  while (leap.after - 1 > leap.before && sign * (d[leap.after] - d[leap.after - 1]) < slow) --leap.after;
  while (leap.before > 0 && sign * (d[leap.before] - d[leap.before - 1]) > slow) --leap.before;
  while (leap.after + 1 < n && sign * (d[leap.after + 1] - d[leap.after]) > slow) ++leap.after;
  if (leap.after == leap.before) return std::nullopt;
  leap.height_nm = sign * (d[leap.after] - d[leap.before]);
  leap.z_nm = 0.5 * (segment.z_nm[leap.before] + segment.z_nm[leap.after]);
  leap.sigma_nm = 0.5 * std::abs(segment.z_nm[leap.after] - segment.z_nm[leap.before]) / std::sqrt(3.0);
  return leap;
}

/// How far the parabolas through `width` points before and after the middle of i and i + 1 are apart there,
/// towards the sample. By Lagrange's sums: the weights that a least-squares parabola of equal steps gives its
/// points for the value half a step beyond its end.
std::vector<double> parabola_weights(std::size_t width) {
  const auto n = static_cast<double>(width);
  // t from the window's middle: orthogonal polynomials 1, t, t² − m2.
  double m2 = 0;
  double m4 = 0;
  for (std::size_t i = 0; i < width; ++i) {
    const double t = static_cast<double>(i) - 0.5 * (n - 1);
    m2 += t * t / n;
    m4 += t * t * t * t / n;
  }
  const double at = 0.5 * n;
  std::vector<double> weights;
  for (std::size_t i = 0; i < width; ++i) {
    const double t = static_cast<double>(i) - 0.5 * (n - 1);
    weights.push_back((1.0 + at * t / m2 + (at * at - m2) * (t * t - m2) / (m4 - m2 * m2)) / n);
  }
  return weights;
}

std::optional<Leap> find_step(const PreparedSegment& segment, double noise_nm) {
  const std::vector<double>& d = segment.deflection_nm;
  const std::size_t n = d.size();
  const std::size_t width = std::clamp<std::size_t>(n / 100, 6, 12);
  if (n < 4 * width) return std::nullopt;
  const std::vector<double> weights = parabola_weights(width);
  double squares = 0;
  for (const double w : weights) squares += 2 * w * w;
  double largest = 0;
  std::size_t at = 0;
  for (std::size_t i = width - 1; i + width < n; ++i) {
    // Windows that a leap lies in say nothing.
    if (segment.leap && i + width > segment.leap->before && i < segment.leap->after + width) continue;
    double apart = 0;
    for (std::size_t k = 0; k < width; ++k) apart += weights[k] * (d[i + 1 - width + k] - d[i + width - k]);
    if (apart > largest) largest = apart, at = i;
  }
  if (!(largest > 7.0 * noise_nm * std::sqrt(squares))) return std::nullopt;
  Leap step;
  step.before = at;
  step.after = at + 1;
  step.height_nm = largest;
  step.z_nm = 0.5 * (segment.z_nm[at] + segment.z_nm[at + 1]);
  // The place itself is a guess of the noise, too: by one point where the step is not far above it.
  const double spacing = std::abs(segment.z_nm[at + 1] - segment.z_nm[at]);
  step.sigma_nm = spacing * std::hypot(0.5 / std::sqrt(3.0), 2.0 * noise_nm / largest);
  return step;
}

void smooth_slopes(PreparedSegment& segment) {
  const std::size_t n = segment.z_nm.size();
  constexpr std::size_t kHalf = 6;
  segment.slope.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t begin = i > kHalf ? i - kHalf : 0;
    std::size_t end = std::min(n, i + kHalf + 1);
    if (segment.leap) {
      if (i <= segment.leap->before) end = std::min(end, segment.leap->before + 1);
      if (i >= segment.leap->after) begin = std::max(begin, segment.leap->after);
    }
    segment.slope[i] =
        end - begin >= 4 ? line_through(segment.z_nm, segment.deflection_nm, begin, end).slope : 0.0;
    segment.slope[i] = std::clamp(segment.slope[i], -3.0, 3.0);
  }
}

/// Points of `segment` seen from its free end.
std::size_t from_far(const PreparedSegment& segment, bool approach, std::size_t i) {
  return approach ? i : segment.z_nm.size() - 1 - i;
}

void find_free_part(PreparedSegment& segment, bool approach, double noise_nm) {
  const std::size_t n = segment.z_nm.size();
  const std::size_t third = std::max<std::size_t>(n / 4, 4);
  const std::size_t begin = approach ? 0 : n - third;
  const Line line = line_through(segment.z_nm, segment.deflection_nm, begin, begin + third);
  double spread = 0;
  for (std::size_t i = begin; i < begin + third; ++i)
    spread += (segment.deflection_nm[i] - line(segment.z_nm[i])) *
              (segment.deflection_nm[i] - line(segment.z_nm[i]));
  spread = std::max(std::sqrt(spread / static_cast<double>(third)), noise_nm);
  std::size_t count = 0;
  int out = 0;
  for (; count < n && out < 3; ++count) {
    const std::size_t i = from_far(segment, approach, count);
    // A line that was made of a third is known worse further on: its noise is allowed to grow with the
    // distance.
    const double far = std::max(1.0, static_cast<double>(count) / static_cast<double>(third));
    out =
        std::abs(segment.deflection_nm[i] - line(segment.z_nm[i])) > kStandsOut * spread * far ? out + 1 : 0;
  }
  const std::optional<Leap>& first = approach && segment.step ? segment.step : segment.leap;
  if (first) {
    const std::size_t to_leap = approach ? first->before : n - 1 - first->after;
    count = std::min(count, to_leap);
  }
  count = std::max<std::size_t>(count * 9 / 10, 4);
  segment.free_begin = approach ? 0 : n - count;
  segment.free_end = approach ? count : n;
}

void fit_baseline(PreparedCurve& curve) {
  const PreparedSegment* segments[2] = {&curve.approach, &curve.retract};
  Line lines[2];
  for (int segment = 0; segment < 2; ++segment) {
    const PreparedSegment& l = *segments[segment];
    lines[segment] = line_through(l.z_nm, l.deflection_nm, l.free_begin, l.free_end);
  }
  curve.z_middle_nm = 0.5 * (lines[0].x_mean + lines[1].x_mean);
  for (int segment = 0; segment < 2; ++segment) {
    curve.offset_nm[segment] = lines[segment](curve.z_middle_nm);
    curve.tilt[segment] = lines[segment].slope;
  }
}

/// Of the free parts, about their baselines. Returns how many points they have.
double take_noise(PreparedCurve& curve) {
  const std::size_t n = curve.approach.z_nm.size();
  const std::size_t all = n + curve.retract.z_nm.size();
  std::vector<double> series(all, 0.0);
  std::vector<char> used(all, 0);
  std::vector<std::vector<double>> design(4, std::vector<double>(all, 0.0));
  const double length = std::abs(curve.approach.z_nm.front() - curve.approach.z_nm.back());
  double sum = 0;
  double count = 0;
  for (std::size_t segment = 0; segment < 2; ++segment) {
    const PreparedSegment& l = segment == 0 ? curve.approach : curve.retract;
    for (std::size_t i = l.free_begin; i < l.free_end; ++i) {
      const std::size_t at = segment * n + i;
      const double along = l.z_nm[i] - curve.z_middle_nm;
      series[at] = l.deflection_nm[i] - curve.offset_nm[segment] - curve.tilt[segment] * along;
      used[at] = 1;
      design[segment][at] = 1;
      design[2 + segment][at] = along / length;
      sum += series[at] * series[at];
      count += 1;
    }
  }
  curve.noise_nm = std::sqrt(sum / std::max(count - 4.0, 1.0));
  curve.noise = estimate_noise(series, used, design);
  return count;
}

/// Where the base is at touch, roughly: at the snap-in, but for the reach of the attraction; else where the
/// deflection passes its baseline, seen from the deepest point.
double find_touch(const PreparedCurve& curve) {
  const PreparedSegment& segment = curve.approach;
  if (segment.leap) return segment.leap->z_nm;
  for (std::size_t i = segment.z_nm.size(); i-- > 0;) {
    const double bend =
        segment.deflection_nm[i] - curve.offset_nm[0] - curve.tilt[0] * (segment.z_nm[i] - curve.z_middle_nm);
    if (bend <= 2.0 * curve.noise_nm) return segment.z_nm[i];
  }
  return segment.z_nm.back();
}

void take_signs(PreparedCurve& curve) {
  PreparedSegment& a = curve.approach;
  if (a.z_nm.back() > a.z_nm.front()) {
    for (PreparedSegment* segment : {&curve.approach, &curve.retract})
      for (double& z : segment->z_nm) z = -z;
    curve.notes.push_back("z grows towards the sample in this file: its sign is changed");
  }
  const std::size_t n = a.z_nm.size();
  const std::size_t tenth = std::max<std::size_t>(n / 20, 5);
  const Line deepest = line_through(a.z_nm, a.deflection_nm, n - tenth, n);
  const Line farthest = line_through(a.z_nm, a.deflection_nm, 0, tenth);
  if (deepest.slope - farthest.slope > 0) {
    for (PreparedSegment* segment : {&curve.approach, &curve.retract})
      for (double& d : segment->deflection_nm) d = -d;
    curve.notes.push_back("deflection falls where the tip is pressed in this file: its sign is changed");
  }
}

std::string number(double value) {
  std::ostringstream text;
  text.precision(4);
  text << value;
  return text.str();
}

}  // namespace

double rough_noise(const std::vector<double>& y) {
  std::vector<double> size;
  for (std::size_t i = 3; i < y.size(); ++i)
    size.push_back(std::abs(y[i] - 3 * y[i - 1] + 3 * y[i - 2] - y[i - 3]));
  return 1.4826 * median(std::move(size)) / std::sqrt(20.0);
}

PreparedCurve prepare(const RawCurve& raw, const Preparation& how) {
  PreparedCurve curve;
  curve.error = raw.error;
  if (!curve.error.empty()) return curve;
  double to_nm = 1;
  if (raw.unit == DeflectionUnit::kNanonewton) to_nm = 1.0 / how.stiffness_n_m;
  if (raw.unit == DeflectionUnit::kVolt) {
    curve.invols_nm_v = how.invols_nm_v ? how.invols_nm_v : raw.invols_nm_v;
    if (!curve.invols_nm_v && !how.invols_from_stiff) {
      curve.error = "has its deflection in volts: give its sensitivity by --invols-nm-v, as a number";
      return curve;
    }
    to_nm = how.invols_from_stiff ? 1.0 : *curve.invols_nm_v;
  } else if (how.invols_nm_v || how.invols_from_stiff) {
    if (!how.invols_from_stiff && raw.invols_nm_v) {
      to_nm = *how.invols_nm_v / *raw.invols_nm_v;
      curve.invols_nm_v = how.invols_nm_v;
    } else if (!how.invols_from_stiff) {
      curve.error =
          "already has its deflection in nm and does not say with which sensitivity: omit --invols-nm-v";
      return curve;
    }
  }
  const auto take = [&](const RawSegment& from, PreparedSegment& to) {
    to.z_nm = from.z_nm;
    to.deflection_nm = from.deflection;
    for (double& d : to.deflection_nm) d *= to_nm;
  };
  take(raw.approach, curve.approach);
  take(raw.retract, curve.retract);
  PreparedSegment& a = curve.approach;
  curve.error = wrong_motion(a.z_nm, curve.retract.z_nm);
  if (!curve.error.empty()) return curve;
  take_signs(curve);
  const auto range = [](const std::vector<double>& v) {
    const auto [low, high] = std::minmax_element(v.begin(), v.end());
    return *high - *low;
  };
  if (!(range(a.z_nm) > 0) || !(range(a.deflection_nm) > 0) || !(range(curve.retract.z_nm) > 0)) {
    curve.error = "does not move: height or deflection are constant";
    return curve;
  }
  const std::size_t n = a.z_nm.size();
  const std::size_t tenth = std::max<std::size_t>(n / 20, 5);
  if (how.invols_from_stiff) {
    const double slope = -line_through(a.z_nm, a.deflection_nm, n - tenth, n).slope;
    if (!(slope > 1e-9)) {
      curve.error = "has no deepest part in which the deflection grows: give --invols-nm-v as a number";
      return curve;
    }
    for (PreparedSegment* segment : {&curve.approach, &curve.retract})
      for (double& d : segment->deflection_nm) d /= slope;
    if (raw.unit == DeflectionUnit::kVolt) curve.invols_nm_v = 1.0 / slope;
    curve.notes.push_back(
        "deflection sensitivity from the deepest part, as if the sample were rigid: no interval holds if it "
        "is not");
  }
  for (PreparedSegment* segment : {&curve.approach, &curve.retract}) {
    const double noise = rough_noise(segment->deflection_nm);
    segment->leap = find_leap(*segment, noise, segment == &curve.approach ? -1.0 : 1.0);
    if (how.bridge_step && segment == &curve.approach) {
      segment->step = find_step(*segment, noise);
      // The bridge forms farther out than the tip leaps without it.
      if (segment->step && segment->leap && segment->step->before > segment->leap->before)
        std::swap(segment->step, segment->leap);
    }
    find_free_part(*segment, segment == &curve.approach, noise);
  }
  fit_baseline(curve);
  // A curve without any noise is a computed one: its rounding is what is left.
  const double floor_nm = 1e-6 * range(a.deflection_nm);
  const double count = take_noise(curve);
  curve.noise_nm = std::max(curve.noise_nm, floor_nm);
  curve.noise.white = std::max(curve.noise.white, floor_nm * floor_nm);
  curve.z_noise_nm = rough_noise(a.z_nm);
  for (PreparedSegment* segment : {&curve.approach, &curve.retract}) {
    smooth_slopes(*segment);
    // The lever's thermal motion, too, tips it over early or late: by about its amplitude, √(k_B T/k).
    const double thermal_nm = std::sqrt(4.11e-3 / how.stiffness_n_m);
    for (std::optional<Leap>* leap : {&segment->leap, &segment->step}) {
      if (!*leap) continue;
      (*leap)->sigma_nm = std::hypot((*leap)->sigma_nm, thermal_nm, curve.z_noise_nm + curve.noise_nm);
    }
  }
  curve.touch_z_nm = find_touch(curve);
  curve.deepest_slope = -line_through(a.z_nm, a.deflection_nm, n - tenth, n).slope;
  if (count < 50)
    curve.notes.push_back("fewer than 50 points without force: the noise is known only roughly");
  const double rise =
      a.deflection_nm.back() - curve.offset_nm[0] - curve.tilt[0] * (a.z_nm.back() - curve.z_middle_nm);
  if (!(rise > kStandsOut * curve.noise_nm) && !a.leap && !curve.retract.leap)
    curve.error = "shows no contact: its deepest point is within " + number(kStandsOut) + " times the noise";
  else
    curve.error = wrong_deflection(curve);
  return curve;
}

ReferenceSlope reference_slope(const PreparedCurve& curve) {
  double slope[2] = {0, 0};
  double variance = 0;
  for (int way = 0; way < 2; ++way) {
    const PreparedSegment& segment = way == 0 ? curve.approach : curve.retract;
    const std::size_t n = segment.z_nm.size();
    const double deepest = way == 0 ? segment.z_nm.back() : segment.z_nm.front();
    const double half = deepest + 0.5 * std::max(curve.touch_z_nm - deepest, 0.0);
    std::size_t count = 0;
    while (count < n && segment.z_nm[way == 0 ? n - 1 - count : count] < half) ++count;
    count = std::max<std::size_t>(count, std::min<std::size_t>(n, 5));
    const std::size_t begin = way == 0 ? n - count : 0;
    const Line line = line_through(segment.z_nm, segment.deflection_nm, begin, begin + count);
    slope[way] = -line.slope;
    double xx = 0;
    double rest = 0;
    for (std::size_t i = begin; i < begin + count; ++i) {
      xx += (segment.z_nm[i] - line.x_mean) * (segment.z_nm[i] - line.x_mean);
      const double residual = segment.deflection_nm[i] - line(segment.z_nm[i]);
      rest += residual * residual;
    }
    if (xx > 0) variance += 0.25 * rest / (static_cast<double>(count) - 2.0) / xx;
  }
  return {0.5 * (slope[0] + slope[1]), std::max(std::sqrt(variance), 0.25 * std::abs(slope[0] - slope[1]))};
}

}  // namespace telenano::fit

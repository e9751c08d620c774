#include "telenano/master/calibration/axis_dynamics.h"

#include <Eigen/Core>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <numbers>
#include <vector>

#include "telenano/master/calibration/filled_positions.h"

namespace telenano::calibration {
namespace {

using Complex = std::complex<double>;

constexpr double kWindow_s = 1.0;
constexpr double kHop_s = 0.5;
constexpr double kLongestPause_s = 0.005;  // of positions that are filled
// A force changes by up to 10 mN a tick and is late or early by half of the call: to 0.2 % of a window's sum.
constexpr double kLongestCommand_s = 0.02;
constexpr int kPeriods = 8;                         // of w's carrier in a window
constexpr int kEdges = 2;                           // sin^4 has harmonics up to this one
constexpr int kOrders = kPeriods + 2 * kEdges + 1;  // of e^{2 pi i q u}: q = -2 ... 10
constexpr int kRows = 1 + 2 * kPeriods;
constexpr int kStretches = 16;
constexpr double kStudent = 2.131;  // 97.5 %, 15 degrees of freedom
constexpr double kForceNoise_n = 0.01;
constexpr double kSlopeReach_s = 0.004;
constexpr double kStandsStill_m_s = 3e-4;
constexpr double kLatencyMost_s = 0.012;
constexpr double kLatencyGrid_s = 0.002;
constexpr double kLatencyStep_s = 0.0005;  // of the difference that its slope is

constexpr double kLeastMotion_m = 5e-4;
constexpr double kLeastMotionInQuanta = 30;
constexpr double kHandStiffness_n_m = 15;  // an arm that rests on the handle has some hundred
constexpr double kMostUnexplained = 0.1;
constexpr double kHalvesDiffer = 5;  // standard errors (by chance once in 5000: 14 degrees of freedom), and
constexpr double kHalvesDifferPart = 0.1;
constexpr double kHalvesDifferDamping_n_s_m = 0.05;

// sin^4(pi u) = 3/8 - (e^{2 pi i u} + c.c.)/4 + (e^{4 pi i u} + c.c.)/16.
constexpr std::array<double, 2 * kEdges + 1> kEnvelope = {1.0 / 16, -1.0 / 4, 3.0 / 8, -1.0 / 4, 1.0 / 16};

double omega(int order) {
  return 2 * std::numbers::pi * order / kWindow_s;
}

// m, b, f_c, k, k x0: what is linear beside the latency.
constexpr int kLaw = 5;
constexpr int kUnknowns = kLaw + 1;
using Rows = Eigen::Matrix<double, kRows, kUnknowns>;
using Column = Eigen::Matrix<double, kRows, 1>;
using Normal = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;

/// The integrals over a window of f e^{2 pi i q u}, q from -2 on.
using Orders = std::array<Complex, kOrders>;

/// One row for w = sin^4 times cos or sin of p periods, as `factor` (of each order) makes it of the orders.
template <class Factor>
void put_rows(const Orders& orders, const Factor& factor, Column& rows) {
  for (int p = 0; p <= kPeriods; ++p) {
    Complex sum = 0;
    for (int j = 0; j < static_cast<int>(kEnvelope.size()); ++j) {
      const int q = p + j - kEdges;
      sum +=
          kEnvelope[static_cast<std::size_t>(j)] * factor(q) * orders[static_cast<std::size_t>(q + kEdges)];
    }
    if (p == 0) {
      rows(0) = sum.real();
    } else {
      rows(2 * p - 1) = sum.real();
      rows(2 * p) = sum.imag();
    }
  }
}

double velocity_at(std::span<const TimedPosition> positions, std::size_t i) {
  std::size_t before = i;
  std::size_t after = i;
  while (before > 0 && positions[i].time_s - positions[before].time_s < kSlopeReach_s) --before;
  while (after + 1 < positions.size() && positions[after].time_s - positions[i].time_s < kSlopeReach_s)
    ++after;
  const double dt = positions[after].time_s - positions[before].time_s;
  return dt > 0 ? (positions[after].position_m - positions[before].position_m) / dt : 0;
}

/// Of the velocity at each position.
std::vector<double> signs_of(std::span<const TimedPosition> positions) {
  std::vector<double> sign(positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i)
    sign[i] = std::clamp(velocity_at(positions, i) / kStandsStill_m_s, -1.0, 1.0);
  return sign;
}

/// A window of the track, and what of (1) does not depend on the latency.
class Window {
 public:
  /// `positions` and their velocities' signs are those of the window, `track` is all of it.
  Window(std::span<const DynamicsSample> track, std::span<const TimedPosition> positions,
         std::span<const double> sign, double start_s)
      : track_(track), start_s_(start_s) {
    Orders x{};
    Orders s{};
    Orders one{};
    for (std::size_t i = 0; i + 1 < positions.size(); ++i) {
      // Trapezoids: each position has half of the intervals beside it.
      const double before = i > 0 ? positions[i].time_s - positions[i - 1].time_s : 0;
      const double dt = 0.5 * (before + positions[i + 1].time_s - positions[i].time_s);
      const Complex turn = std::polar(1.0, omega(1) * (positions[i].time_s - start_s));
      Complex wave = dt * std::conj(turn * turn);
      for (std::size_t q = 0; q < kOrders; ++q, wave *= turn) {
        x[q] += positions[i].position_m * wave;
        s[q] += sign[i] * wave;
        one[q] += wave;
      }
    }
    const Complex i(0, 1);
    Column column;
    put_rows(
        x, [&](int q) { return -omega(q) * omega(q); }, column);
    rows_.col(0) = column;
    put_rows(
        x, [&](int q) { return -i * omega(q); }, column);
    rows_.col(1) = column;
    const auto as_it_is = [](int) { return Complex(1); };
    put_rows(s, as_it_is, column);
    rows_.col(2) = column;
    put_rows(x, as_it_is, column);
    rows_.col(3) = column;
    put_rows(one, as_it_is, column);
    rows_.col(4) = column;
    rows_.col(5).setZero();
  }

  /// The right side of (1).
  Column force(double latency_s) const {
    Orders f{};
    // The first that reaches into the window.
    const auto after = std::upper_bound(
        track_.begin(), track_.end(), start_s_ - latency_s,
        [](double time_s, const DynamicsSample& sample) { return time_s < sample.force_time_s; });
    std::size_t i = after == track_.begin() ? 0 : static_cast<std::size_t>(after - track_.begin() - 1);
    for (; i < track_.size(); ++i) {
      const double end_s = i + 1 < track_.size() ? track_[i + 1].force_time_s : track_[i].force_time_s;
      const double from_s = std::clamp(track_[i].force_time_s + latency_s - start_s_, 0.0, kWindow_s);
      const double to_s = std::clamp(end_s + latency_s - start_s_, 0.0, kWindow_s);
      if (track_[i].force_time_s + latency_s - start_s_ > kWindow_s) break;
      const Complex turn_from = std::polar(1.0, omega(1) * from_s);
      const Complex turn_to = std::polar(1.0, omega(1) * to_s);
      Complex wave_from = std::conj(turn_from * turn_from);
      Complex wave_to = std::conj(turn_to * turn_to);
      for (int q = -kEdges; q < kOrders - kEdges; ++q, wave_from *= turn_from, wave_to *= turn_to) {
        const Complex part = q == 0 ? Complex(to_s - from_s) : (wave_to - wave_from) / Complex(0, omega(q));
        f[static_cast<std::size_t>(q + kEdges)] += track_[i].force_n * part;
      }
    }
    Column rows;
    put_rows(
        f, [](int) { return Complex(1); }, rows);
    return rows;
  }

  const Rows& rows() const { return rows_; }

 private:
  std::span<const DynamicsSample> track_;
  double start_s_;
  Rows rows_;
};

/// What noise each row has: an encoder step in x w″ and x w′, 10 mN in w; all of w sin^4 with a mean square
/// of 35/128, or half of that with a carrier.
Column weights_of(double mass_kg, double damping_n_s_m, double quantum_m, double period_s) {
  Column weights;
  const double step_m = std::max(quantum_m, 1e-8) / std::sqrt(12.0);
  for (int row = 0; row < kRows; ++row) {
    const int p = (row + 1) / 2;
    const double w = p == 0 ? omega(1) : omega(p + 1);  // about; the envelope widens it by an order
    const double position = step_m * (mass_kg * w * w + damping_n_s_m * w);
    const double variance = position * position * period_s + kForceNoise_n * kForceNoise_n * 0.05;
    weights(row) = 1 / variance;
  }
  return weights;
}

/// Sums of products, by stretch of the track.
struct Sums {
  Normal left = Normal::Zero();
  Unknowns right = Unknowns::Zero();
  double force = 0;  // weighted square

  void add(const Rows& rows, const Column& force_rows, const Column& weights) {
    // Loops, here and in solve(): the compiler unrolls Eigen's products of these sizes, which takes it long.
    for (int row = 0; row < kRows; ++row) {
      for (int i = 0; i < kUnknowns; ++i) {
        const double weighted = rows(row, i) * weights(row);
        for (int j = 0; j < kUnknowns; ++j) left(i, j) += weighted * rows(row, j);
        right(i) += weighted * force_rows(row);
      }
      force += force_rows(row) * weights(row) * force_rows(row);
    }
  }
  Sums& operator+=(const Sums& other) {
    left += other.left;
    right += other.right;
    force += other.force;
    return *this;
  }
  Sums without(const Sums& other) const {
    Sums rest = *this;
    rest.left -= other.left;
    rest.right -= other.right;
    rest.force -= other.force;
    return rest;
  }
  /// The smallest solution: an unknown whose row and column are zero is 0. One size for all, because each size of the
  /// decomposition costs seconds to compile.
  Unknowns solve() const {
    // Columns of very different size: scaled to ones on the diagonal.
    const Unknowns scale = left.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Normal scaled;
    for (int i = 0; i < kUnknowns; ++i) {
      for (int j = 0; j < kUnknowns; ++j) scaled(i, j) = scale(i) * left(i, j) * scale(j);
    }
    const Unknowns right_side = scale.cwiseProduct(right);
    const Unknowns found = scaled.completeOrthogonalDecomposition().solve(right_side);
    return scale.cwiseProduct(found);
  }
  double residual(const Unknowns& unknowns) const {
    return std::max(0.0, force - 2 * unknowns.dot(right) + unknowns.dot(left * unknowns));
  }
};

std::vector<Window> windows_of(std::span<const DynamicsSample> track) {
  const std::vector<TimedPosition> positions = filled_positions(track);
  const std::vector<double> sign = signs_of(positions);
  const auto paused = [&](std::size_t first, std::size_t end) {
    // With what is between its first and last positions and those outside.
    for (std::size_t i = std::max<std::size_t>(first, 1); i < std::min(end + 1, positions.size()); ++i) {
      if (positions[i].time_s - positions[i - 1].time_s > kLongestPause_s) return true;
    }
    return false;
  };
  const auto command_hung = [&](double start_s) {
    return std::any_of(track.begin(), track.end(), [&](const DynamicsSample& sample) {
      return sample.command_took_s > kLongestCommand_s && sample.force_time_s > start_s - kLongestCommand_s &&
             sample.force_time_s < start_s + kWindow_s + kLongestCommand_s;
    });
  };
  std::vector<Window> windows;
  const double last_s = track.back().time_s - kLatencyMost_s;
  std::size_t first = 0;
  for (double start_s = track.front().time_s + kLatencyMost_s; start_s + kWindow_s <= last_s;
       start_s += kHop_s) {
    while (first < positions.size() && positions[first].time_s < start_s) ++first;
    std::size_t end = first;
    while (end < positions.size() && positions[end].time_s <= start_s + kWindow_s) ++end;
    if (end - first <= 4 * kOrders || paused(first, end) || command_hung(start_s)) continue;
    windows.emplace_back(track, std::span(positions).subspan(first, end - first),
                         std::span(sign).subspan(first, end - first), start_s);
  }
  return windows;
}

/// The least step between positions, if the small ones are whole numbers of it.
double quantum_of(std::span<const DynamicsSample> track) {
  constexpr double kOfRounding_m = 1e-9;
  constexpr double kSmall = 10.5;
  constexpr double kNearWhole = 0.1;
  const auto step = [&](std::size_t i) { return std::fabs(track[i].position_m - track[i - 1].position_m); };
  double least = 0;
  for (std::size_t i = 1; i < track.size(); ++i) {
    if (step(i) > kOfRounding_m && (least == 0 || step(i) < least)) least = step(i);
  }
  int small = 0;
  int whole = 0;
  for (std::size_t i = 1; i < track.size(); ++i) {
    const double times = least > 0 ? step(i) / least : 0;
    if (times < 0.5 || times > kSmall) continue;
    ++small;
    whole += std::fabs(times - std::round(times)) < kNearWhole ? 1 : 0;
  }
  return small > 20 && whole > 0.9 * small ? least : 0;
}

double motion_rms(std::span<const DynamicsSample> track) {
  double sum = 0;
  double squares = 0;
  for (const DynamicsSample& sample : track) {
    sum += sample.position_m;
    squares += sample.position_m * sample.position_m;
  }
  const double count = static_cast<double>(track.size());
  return std::sqrt(std::max(0.0, squares / count - sum / count * (sum / count)));
}

/// Everything of a track that a fit needs.
class Fit {
 public:
  Fit(std::span<const DynamicsSample> track, std::vector<Window> windows, double quantum_m)
      : windows_(std::move(windows)), quantum_m_(quantum_m) {
    const double duration_s = track.back().time_s - track.front().time_s;
    period_s_ = duration_s / static_cast<double>(track.size() - 1);
    weights_ = weights_of(0.3, 1, quantum_m, period_s_);
  }

  /// Best latency, then all unknowns with it.
  void run() {
    double least = -1;
    double best_s = 0;
    for (double latency_s = 0; latency_s <= kLatencyMost_s; latency_s += kLatencyGrid_s) {
      const Sums sums = total_without_latency(latency_s);
      const double residual = sums.residual(sums.solve());
      if (least < 0 || residual < least) {
        least = residual;
        best_s = latency_s;
      }
    }
    latency_s_ = best_s;
    const Unknowns found = refine();
    weights_ = weights_of(std::max(found(0), 1e-3), std::max(found(1), 0.0), quantum_m_, period_s_);
    whole_ = refine();
  }

  const Unknowns& whole() const { return whole_; }
  double latency_s() const { return latency_s_; }
  const std::array<Sums, kStretches>& stretches() const { return stretches_; }
  Sums total() const {
    Sums all;
    for (const Sums& stretch : stretches_) all += stretch;
    return all;
  }

 private:
  Sums total_without_latency(double latency_s) const {
    Sums sums;
    for (const Window& window : windows_) sums.add(window.rows(), window.force(latency_s), weights_);
    return sums;
  }

  /// Linear in the latency about its last value, twice.
  Unknowns refine() {
    Unknowns found = Unknowns::Zero();
    for (int round = 0; round < 2; ++round) {
      stretches_ = {};
      for (std::size_t i = 0; i < windows_.size(); ++i) {
        const Column here = windows_[i].force(latency_s_);
        const Column later = windows_[i].force(latency_s_ + kLatencyStep_s);
        const Column sooner = windows_[i].force(latency_s_ - kLatencyStep_s);
        Rows rows = windows_[i].rows();
        rows.col(5) = -(later - sooner) / (2 * kLatencyStep_s);
        stretches_[i * kStretches / windows_.size()].add(rows, here, weights_);
      }
      found = total().solve();
      if (round == 0) latency_s_ = std::clamp(latency_s_ + found(5), -kLatencyStep_s, kLatencyMost_s);
    }
    return found;
  }

  std::vector<Window> windows_;
  double quantum_m_;
  double period_s_ = 1e-3;
  Column weights_;
  double latency_s_ = 0;
  std::array<Sums, kStretches> stretches_{};
  Unknowns whole_ = Unknowns::Zero();
};

struct Estimate {
  Unknowns value = Unknowns::Zero();
  Unknowns error = Unknowns::Zero();  // standard, by the jackknife over the stretches
};

Estimate estimate(std::span<const Sums> stretches) {
  const double count = static_cast<double>(stretches.size());
  Sums all;
  for (const Sums& stretch : stretches) all += stretch;
  std::array<Unknowns, kStretches> without;
  Unknowns mean = Unknowns::Zero();
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    without[i] = all.without(stretches[i]).solve();
    mean += without[i] / count;
  }
  Unknowns squares = Unknowns::Zero();
  for (std::size_t i = 0; i < stretches.size(); ++i) squares += (without[i] - mean).cwiseAbs2();
  return {all.solve(), (squares * (count - 1) / count).cwiseSqrt()};
}

// Each half with its own errors: those of the whole would hold the change that is looked for.
bool halves_differ(const Fit& fit) {
  const std::span<const Sums> stretches(fit.stretches());
  const Estimate one = estimate(stretches.first(kStretches / 2));
  const Estimate other = estimate(stretches.last(kStretches / 2));
  const auto differ = [&](int unknown, double part_of) {
    const double difference = std::fabs(one.value(unknown) - other.value(unknown));
    return difference > kHalvesDiffer * std::hypot(one.error(unknown), other.error(unknown)) &&
           difference > part_of;
  };
  const double mass = fit.whole()(0);
  const double damping = fit.whole()(1);
  return differ(0, kHalvesDifferPart * mass) ||
         differ(1, kHalvesDifferPart * damping + kHalvesDifferDamping_n_s_m) || differ(3, kHandStiffness_n_m);
}

Interval interval(double value, double error) {
  return {value, value - kStudent * error, value + kStudent * error};
}

DynamicsVerdict judge(const AxisDynamics& found, const Fit& fit) {
  if (found.stiffness_n_m.value > kHandStiffness_n_m || found.stiffness_n_m.value < -kHandStiffness_n_m)
    return DynamicsVerdict::kHeld;
  if (halves_differ(fit)) return DynamicsVerdict::kChanges;
  if (found.unexplained > kMostUnexplained) return DynamicsVerdict::kNotOfThisKind;
  return DynamicsVerdict::kGood;
}

}  // namespace

const char* verdict_text(DynamicsVerdict verdict) noexcept {
  switch (verdict) {
    case DynamicsVerdict::kGood:
      return "";
    case DynamicsVerdict::kTooShort:
      return "too little was measured: the machine paused too often; close other programs, or give a larger "
             "--seconds";
    case DynamicsVerdict::kDoesNotMove:
      return "the handle hardly moves: take hands and objects off it, and check that the motors are on";
    case DynamicsVerdict::kHeld:
      return "something as stiff as a hand holds the handle: let go of it";
    case DynamicsVerdict::kChanges:
      return "the device's dynamics changed during the measurement: keep hands off until the end";
    case DynamicsVerdict::kNotOfThisKind:
      return "its motion is not that of a mass with a damper and friction: is something in its way?";
  }
  return "";
}

AxisDynamics identify_axis(std::span<const DynamicsSample> track) {
  AxisDynamics found;
  if (track.size() < 2) return found;
  found.quantum_m = quantum_of(track);
  found.motion_rms_m = motion_rms(track);
  std::vector<Window> windows = windows_of(track);
  if (windows.size() < kStretches) return found;
  if (found.motion_rms_m < std::max(kLeastMotion_m, kLeastMotionInQuanta * found.quantum_m)) {
    found.verdict = DynamicsVerdict::kDoesNotMove;
    return found;
  }
  Fit fit(track, std::move(windows), found.quantum_m);
  fit.run();
  const Unknowns errors = estimate(fit.stretches()).error;
  const Unknowns& whole = fit.whole();
  found.mass_kg = interval(whole(0), errors(0));
  found.damping_n_s_m = interval(whole(1), errors(1));
  found.friction_n = interval(whole(2), errors(2));
  found.stiffness_n_m = interval(whole(3), errors(3));
  found.latency_s = interval(fit.latency_s() + whole(5), errors(5));
  const Sums all = fit.total();
  found.unexplained = std::sqrt(all.residual(whole) / std::max(all.force, 1e-300));
  found.verdict = judge(found, fit);
  return found;
}

}  // namespace telenano::calibration

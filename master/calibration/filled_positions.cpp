#include "telenano/master/calibration/filled_positions.h"

#include <array>
#include <cstddef>

namespace telenano::calibration {
namespace {

constexpr double kLongestReading_s = 0.001;
constexpr double kGapFrom_s = 0.003;
constexpr double kGapTo_s = 0.020;
constexpr double kFill_s = 0.001;
constexpr double kSide_s = 0.008;
constexpr std::size_t kLeastOnASide = 4;

/// The cubic of least squares, by polynomials that are orthogonal over its points: P_{k+1} = (u − a_k) P_k − b_k P_{k−1}
/// (Forsythe, J. SIAM 5, 1957), which needs no system of equations.
class Cubic {
 public:
  explicit Cubic(std::span<const TimedPosition> points) : origin_s_(points.front().time_s) {
    std::vector<double> before(points.size(), 0);
    std::vector<double> now(points.size(), 1);
    double square_before = 0;
    for (std::size_t k = 0; k < coefficient_.size(); ++k) {
      double square = 0;
      double moment = 0;
      double product = 0;
      for (std::size_t i = 0; i < points.size(); ++i) {
        square += now[i] * now[i];
        moment += u(points[i]) * now[i] * now[i];
        product += points[i].position_m * now[i];
      }
      coefficient_[k] = product / square;
      shift_[k] = moment / square;
      back_[k] = k == 0 ? 0 : square / square_before;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double next = (u(points[i]) - shift_[k]) * now[i] - back_[k] * before[i];
        before[i] = now[i];
        now[i] = next;
      }
      square_before = square;
    }
  }

  double at(double time_s) const {
    double before = 0;
    double now = 1;
    double sum = 0;
    for (std::size_t k = 0; k < coefficient_.size(); ++k) {
      sum += coefficient_[k] * now;
      const double next = ((time_s - origin_s_) / kSide_s - shift_[k]) * now - back_[k] * before;
      before = now;
      now = next;
    }
    return sum;
  }

 private:
  double u(const TimedPosition& point) const { return (point.time_s - origin_s_) / kSide_s; }

  double origin_s_;
  std::array<double, 4> coefficient_{};
  std::array<double, 4> shift_{};
  std::array<double, 4> back_{};
};

}  // namespace

std::vector<TimedPosition> filled_positions(std::span<const DynamicsSample> track) {
  std::vector<TimedPosition> seen;
  seen.reserve(track.size());
  for (const DynamicsSample& sample : track) {
    if (sample.reading_took_s <= kLongestReading_s) seen.push_back({sample.time_s, sample.position_m});
  }
  std::vector<TimedPosition> filled;
  filled.reserve(track.size());
  for (std::size_t i = 0; i < seen.size(); ++i) {
    filled.push_back(seen[i]);
    if (i + 1 == seen.size()) break;
    const double from_s = seen[i].time_s;
    const double to_s = seen[i + 1].time_s;
    if (to_s - from_s <= kGapFrom_s || to_s - from_s > kGapTo_s) continue;
    std::size_t first = i;
    std::size_t end = i + 2;
    while (first > 0 && from_s - seen[first - 1].time_s <= kSide_s) --first;
    while (end < seen.size() && seen[end].time_s - to_s <= kSide_s) ++end;
    if (i + 1 - first < kLeastOnASide || end - i - 1 < kLeastOnASide) continue;
    const Cubic cubic{std::span(seen).subspan(first, end - first)};
    for (double time_s = from_s + kFill_s; time_s < to_s - 0.5 * kFill_s; time_s += kFill_s)
      filled.push_back({time_s, cubic.at(time_s)});
  }
  return filled;
}

}  // namespace telenano::calibration

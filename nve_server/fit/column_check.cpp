#include "telenano/nve_server/fit/column_check.h"

#include <cstddef>
#include <vector>

namespace telenano::fit {
namespace {

constexpr double kBent = 0.05;  // a sine's half is 0.014 off its line
constexpr double kStraighter = 0.1;

/// How far `y` is from a straight line in time: the part of its variance that the line by least squares leaves.
double off_line(const std::vector<double>& y) {
  const auto n = static_cast<double>(y.size());
  double mean = 0;
  for (const double value : y) mean += value / n;
  double yy = 0;
  double tt = 0;
  double ty = 0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double t = static_cast<double>(i) - 0.5 * (n - 1);
    yy += (y[i] - mean) * (y[i] - mean);
    tt += t * t;
    ty += t * (y[i] - mean);
  }
  return yy > 0 && tt > 0 ? 1.0 - ty * ty / tt / yy : 1.0;
}

}  // namespace

bool columns_look_exchanged(const PreparedCurve& curve) {
  for (const PreparedSegment* segment : {&curve.approach, &curve.retract}) {
    const double z = off_line(segment->z_nm);
    if (!(z > kBent && off_line(segment->deflection_nm) < kStraighter * z)) return false;
  }
  return true;
}

}  // namespace telenano::fit

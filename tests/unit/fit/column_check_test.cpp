// Tables whose header names z and deflection the wrong way round, made of curves in closed form.
#include "telenano/nve_server/fit/column_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "tests/unit/fit/closed_curve.h"

namespace telenano::fit {
namespace {

TEST(ColumnCheck, ExchangedColumnsAreSeen) {
  const fit_test::Sample sample;
  RawCurve raw = fit_test::curve_of(sample, {}, {.white_nm = 0.05}, 4);
  const auto exchanged = [&](const RawCurve& of) {
    Preparation how;
    how.stiffness_n_m = sample.stiffness_n_m;
    const PreparedCurve curve = prepare(of, how);
    EXPECT_EQ(curve.approach.z_nm.size(), of.approach.z_nm.size());
    return columns_look_exchanged(curve);
  };
  EXPECT_FALSE(exchanged(raw));
  // A base that is driven by a sine is no straight line, and still the base.
  RawCurve sine = raw;
  for (RawSegment* segment : {&sine.approach, &sine.retract}) {
    const std::vector<double> z = segment->z_nm;
    const std::vector<double> d = segment->deflection;
    const auto last = static_cast<double>(z.size() - 1);
    for (std::size_t i = 0; i < z.size(); ++i) {
      const double part = 0.5 * (1 - std::cos(fit_test::kPi * static_cast<double>(i) / last));
      const auto from = static_cast<std::size_t>(part * last);
      segment->z_nm[i] = z[from];
      segment->deflection[i] = d[from];
    }
  }
  EXPECT_FALSE(exchanged(sine));
  for (RawSegment* segment : {&raw.approach, &raw.retract}) std::swap(segment->z_nm, segment->deflection);
  EXPECT_TRUE(exchanged(raw));
}

}  // namespace
}  // namespace telenano::fit

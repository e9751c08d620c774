#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/surface/contact_fields.h"
#include "telenano/nve_server/physics/surface/height_grid.h"
#include "tests/source_dir.h"

/// What tests of fields of the apex have in common.
namespace telenano::support {

/// A square of `count` samples of a real scan from (column, row) on.
inline physics::HeightGrid piece_of(const std::string& name, int column, int row, int count) {
  const physics::HeightGrid scan =
      surface::read_gsf(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/" + name).grid;
  physics::HeightGrid piece{count, count, scan.dx_nm, scan.dy_nm, 0.0, 0.0, {}};
  for (int j = 0; j < count; ++j) {
    for (int i = 0; i < count; ++i) {
      piece.z_nm.push_back(scan.z_nm[static_cast<std::size_t>((row + j) * scan.columns + column + i)]);
    }
  }
  return piece;
}

/// First and second derivatives at `at` against differences over h of the values and of the gradient.
/// `of_second` is relative to 1 + their size.
template <class JetAt>
void expect_derivatives(const JetAt& jet_at, const Vec3& at, double h, double of_first, double of_second) {
  const physics::ContactJet jet = jet_at(at);
  for (int k = 0; k < 3; ++k) {
    const physics::ContactJet more = jet_at(at + h * Vec3::Unit(k)), less = jet_at(at - h * Vec3::Unit(k));
    ASSERT_NEAR((more.overlap_nm - less.overlap_nm) / (2 * h), jet.overlap_grad[k], of_first) << k;
    ASSERT_NEAR((more.log_radius - less.log_radius) / (2 * h), jet.log_radius_grad_per_nm[k], of_first) << k;
    for (int i = 0; i < 3; ++i) {
      const double overlap = (more.overlap_grad[i] - less.overlap_grad[i]) / (2 * h);
      const double radius = (more.log_radius_grad_per_nm[i] - less.log_radius_grad_per_nm[i]) / (2 * h);
      ASSERT_NEAR(overlap, jet.overlap_hess_per_nm(i, k), of_second * (1 + std::abs(overlap))) << i << k;
      ASSERT_NEAR(radius, jet.log_radius_hess_per_nm2(i, k), of_second * (1 + std::abs(radius))) << i << k;
    }
  }
  const Mat3 turned = jet.overlap_hess_per_nm - jet.overlap_hess_per_nm.transpose();
  ASSERT_LE(turned.cwiseAbs().maxCoeff(), 1e-13 * (1 + jet.overlap_hess_per_nm.cwiseAbs().maxCoeff()));
}

}  // namespace telenano::support

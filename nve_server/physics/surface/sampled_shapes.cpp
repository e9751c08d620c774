#include "telenano/nve_server/physics/surface/sampled_shapes.h"

#include <cmath>
#include <initializer_list>
#include <string>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"

namespace telenano::physics {
namespace {

constexpr double kSamplesPerPeriod = 16.0;
constexpr double kSamplesPerEdge = 8.0;

void expect_finite(const char* shape, std::initializer_list<double> values) {
  for (const double value : values) {
    if (!std::isfinite(value)) throw UserError(std::string(shape) + ": expected finite numbers");
  }
}

void expect_positive(const char* what, double value) {
  if (!(value > 0.0 && std::isfinite(value)))
    throw UserError(std::string(what) + ": expected a positive number");
}

void expect_fine(const char* what, double spacing_nm, double finest_nm, double samples) {
  // A hair more than the ratio, which a person gives in decimals.
  if (!(spacing_nm * samples <= finest_nm * (1.0 + 1e-9))) {
    throw UserError(std::string(what) + ": too narrow for the grid's spacing, expected at least " +
                    std::to_string(static_cast<int>(samples)) + " spacings");
  }
}

HeightGrid empty_grid(const SampledArea& area) {
  expect_finite("surface", {area.x_first_nm, area.y_first_nm});
  expect_positive("surface width", area.width_nm);
  expect_positive("surface length", area.length_nm);
  expect_positive("surface spacing", area.spacing_nm);
  const double across = std::ceil(area.width_nm / area.spacing_nm * (1.0 - 1e-12));
  const double along = std::ceil(area.length_nm / area.spacing_nm * (1.0 - 1e-12));
  if (!((across + 1.0) * (along + 1.0) <= kMaxSamples)) {
    throw UserError("surface: more than " + std::to_string(kMaxSamples) +
                    " samples, expected a wider spacing or a smaller extent");
  }
  HeightGrid grid;
  grid.columns = static_cast<int>(across) + 1;
  grid.rows = static_cast<int>(along) + 1;
  grid.dx_nm = area.width_nm / across;
  grid.dy_nm = area.length_nm / along;
  grid.x_first_nm = area.x_first_nm;
  grid.y_first_nm = area.y_first_nm;
  grid.z_nm.resize(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
  return grid;
}

// Heights that depend on s, the way along a direction from a point, only.
template <class Profile>
HeightGrid sample_profile(const SampledArea& area, double x_nm, double y_nm, double direction_rad,
                          const Profile& profile) {
  HeightGrid grid = empty_grid(area);
  const SinCos direction = det_sin_cos(direction_rad);
  std::size_t i = 0;
  for (int row = 0; row < grid.rows; ++row) {
    const double y = grid.y_first_nm + row * grid.dy_nm - y_nm;
    for (int column = 0; column < grid.columns; ++column) {
      const double x = grid.x_first_nm + column * grid.dx_nm - x_nm;
      grid.z_nm[i++] = profile(direction.cos * x + direction.sin * y);
    }
  }
  return grid;
}

// From 0 to 1 as s goes from −width/2 to width/2.
double edge(double s, double width) {
  const double t = s / width + 0.5;
  if (t <= 0.0) return 0.0;
  if (t >= 1.0) return 1.0;
  return t * t * t * (10.0 + t * (6.0 * t - 15.0));
}

}  // namespace

HeightGrid sample_level(const SampledArea& area, double height_nm) {
  expect_finite("level", {height_nm});
  HeightGrid grid = empty_grid(area);
  grid.z_nm.assign(grid.z_nm.size(), height_nm);
  return grid;
}

HeightGrid sample_step(const SampledArea& area, const StepShape& shape) {
  expect_finite("step", {shape.x_nm, shape.y_nm, shape.direction_rad});
  expect_positive("step height", shape.height_nm);
  expect_positive("step width", shape.width_nm);
  expect_fine("step width", area.spacing_nm, shape.width_nm, kSamplesPerEdge);
  return sample_profile(area, shape.x_nm, shape.y_nm, shape.direction_rad,
                        [&](double s) { return shape.height_nm * edge(s, shape.width_nm); });
}

HeightGrid sample_grating(const SampledArea& area, const GratingShape& shape) {
  expect_finite("grating", {shape.x_nm, shape.y_nm, shape.direction_rad});
  expect_positive("grating height", shape.height_nm);
  expect_positive("grating period", shape.period_nm);
  expect_fine("grating period", area.spacing_nm, shape.period_nm, kSamplesPerPeriod);
  // Where in the period, from −½ to ½ of it.
  const auto phase = [&](double s) {
    const double periods = s / shape.period_nm;
    return (periods - std::floor(periods + 0.5)) * shape.period_nm;
  };
  if (shape.profile == GratingProfile::kSinusoid) {
    return sample_profile(area, shape.x_nm, shape.y_nm, shape.direction_rad, [&](double s) {
      return 0.5 * shape.height_nm * (1.0 - det_sin_cos(2.0 * kPi * phase(s) / shape.period_nm).cos);
    });
  }
  expect_positive("grating edge", shape.edge_nm);
  expect_fine("grating edge", area.spacing_nm, shape.edge_nm, kSamplesPerEdge);
  if (!(shape.edge_nm <= 0.5 * shape.period_nm)) {
    throw UserError("grating edge: expected at most half a period");
  }
  return sample_profile(area, shape.x_nm, shape.y_nm, shape.direction_rad, [&](double s) {
    return shape.height_nm * edge(std::abs(phase(s)) - 0.25 * shape.period_nm, shape.edge_nm);
  });
}

}  // namespace telenano::physics

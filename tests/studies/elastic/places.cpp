#include "tests/studies/elastic/places.h"

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/surface/bicubic_spline.h"

namespace telenano::elastic {
namespace {

double mirrored(double x, double first, double last) {
  if (x < first) x = 2 * first - x;
  if (x > last) x = 2 * last - x;
  return x;
}

/// Lines with # and the heading are left out.
std::vector<std::vector<double>> read_table(const std::string& path, std::size_t columns) {
  std::ifstream file(path);
  if (!file) throw RunError(path + ": cannot be read");
  std::vector<std::vector<double>> rows;
  std::string line;
  while (std::getline(file, line)) {
    if (line.empty() || line[0] == '#' || line[0] == 'p') continue;
    std::vector<double> fields;
    std::stringstream stream(line);
    std::string field;
    while (std::getline(stream, field, ','))
      fields.push_back(field.empty() ? 0.0 : std::strtod(field.c_str(), nullptr));
    if (fields.size() != columns) {
      throw RunError(path + ": expected " + std::to_string(columns) + " columns in \"" + line + "\"");
    }
    rows.push_back(fields);
  }
  return rows;
}

}  // namespace

Ground ground_of(const Probe& probe, const surface::HeightGrid& scan, double x_nm, double y_nm) {
  const auto height = physics::BicubicSpline::interpolating(scan);
  const testing::ElasticPatch patch(probe.elements, probe.elements * probe.spacing_nm, probe.modulus_gpa);
  return ground_of(probe, patch, [&](double x, double y) {
    return height
        .jet(mirrored(x_nm + x, height.x_first_nm(), height.x_last_nm()),
             mirrored(y_nm + y, height.y_first_nm(), height.y_last_nm()))
        .z;
  });
}

namespace {

/// Half as much again, by gap, as a sphere has without load after Johnson, Kendall and Roberts:
/// a³ = 6πwR²/K, K = 4E*/3. What is too far away comes off at the first height.
testing::ElasticPatch::Touching wide_contact(const Probe& probe, const Ground& ground) {
  const double pi = 3.14159265358979323846, r = probe.radius_nm;
  const double a = std::cbrt(6 * pi * probe.adhesion.work_n_per_m * r * r / (4.0 / 3 * probe.modulus_gpa));
  testing::ElasticPatch::Touching touching;
  for (const double gap : ground.gap) touching.element.push_back(gap < 0.75 * a * a / r ? 1 : 0);
  touching.pull_gpa.assign(ground.gap.size(), 0.0);
  return touching;
}

}  // namespace

std::vector<State> follow(const Probe& probe, const Ground& ground, const std::vector<double>& z_nm) {
  const testing::ElasticPatch patch(probe.elements, probe.elements * probe.spacing_nm, probe.modulus_gpa);
  std::vector<State> states;
  std::vector<double> u(ground.gap.size(), 0.0), gap(ground.gap.size());
  testing::ElasticPatch::Touching touching;
  if (probe.short_range) touching = wide_contact(probe, ground);
  for (const double z : z_nm) {
    for (std::size_t k = 0; k < gap.size(); ++k) gap[k] = ground.gap[k] + z;
    states.push_back({z, probe.short_range ? patch.stick(gap, probe.adhesion.work_n_per_m, touching)
                                           : patch.adhere(gap, probe.adhesion, u)});
  }
  return states;
}

std::vector<LineState> along_line(const Probe& probe, const surface::HeightGrid& scan, double x_nm,
                                  double y_nm, double length_nm, double step_nm, double depth_nm) {
  const auto height = physics::BicubicSpline::interpolating(scan);
  const testing::ElasticPatch patch(probe.elements, probe.elements * probe.spacing_nm, probe.modulus_gpa);
  const double area = patch.spacing_nm() * patch.spacing_nm();
  std::vector<double> slope;
  const auto ground_at = [&](double x) {
    slope.clear();
    return ground_of(probe, patch, [&](double dx, double dy) {
      const auto jet = height.jet(mirrored(x + dx, height.x_first_nm(), height.x_last_nm()),
                                  mirrored(y_nm + dy, height.y_first_nm(), height.y_last_nm()));
      slope.push_back(jet.zx);
      return jet.z;
    });
  };
  const double z = ground_at(x_nm).touch_nm - depth_nm;
  std::vector<LineState> states;
  std::vector<double> u(slope.size(), 0.0);
  const int half = static_cast<int>(std::lround(0.5 * length_nm / step_nm));
  for (int k = -half; k <= half; ++k) {
    LineState state{k * step_nm, 0, z, 0, 0};
    Ground ground = ground_at(x_nm + state.along_nm);
    state.touch_nm = ground.touch_nm;
    for (double& gap : ground.gap) gap += z - ground.touch_nm;
    state.force_nn = patch.adhere(ground.gap, probe.adhesion, u);
    const std::vector<double> pull = testing::ElasticPatch::pull_gpa(ground.gap, probe.adhesion, u);
    for (std::size_t i = 0; i < pull.size(); ++i) state.lateral_nn += area * pull[i] * slope[i];
    states.push_back(state);
  }
  return states;
}

double Place::pull_off_nn() const {
  std::size_t k = 0;
  for (std::size_t i = 0; i < states.size(); ++i) {
    if (states[i].force_nn < states[k].force_nn) k = i;
  }
  if (k == 0 || k + 1 >= states.size()) return -states[k].force_nn;
  const double a = states[k].z_nm - states[k - 1].z_nm, b = states[k + 1].z_nm - states[k].z_nm;
  const double before = (states[k].force_nn - states[k - 1].force_nn) / a;
  const double after = (states[k + 1].force_nn - states[k].force_nn) / b;
  const double bend = (after - before) / (a + b);
  const double slope = before + bend * a;
  return -(states[k].force_nn - slope * slope / (4 * bend));
}

std::vector<Line> read_lines(const std::string& path) {
  std::vector<Line> lines;
  for (const std::vector<double>& row : read_table(path, 8)) {
    const int number = static_cast<int>(row[0]);
    if (lines.empty() || lines.back().number != number) {
      lines.push_back({number, static_cast<int>(row[1]), static_cast<int>(row[2]), {}});
    }
    lines.back().states.push_back({row[3], row[4], row[5], row[6], row[7]});
  }
  return lines;
}

std::vector<Place> read_places(const std::string& path) {
  std::vector<Place> places;
  for (const std::vector<double>& fields : read_table(path, 6)) {
    const int number = static_cast<int>(fields[0]);
    if (places.empty() || places.back().number != number) {
      places.push_back({number, static_cast<int>(fields[1]), static_cast<int>(fields[2]), fields[3], {}});
    }
    places.back().states.push_back({fields[4], fields[5]});
  }
  return places;
}

}  // namespace telenano::elastic

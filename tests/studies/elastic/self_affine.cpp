#include "tests/studies/elastic/self_affine.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace telenano::elastic {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kWaves = 400;

// The same numbers with every library: std::uniform_real_distribution is not.
double uniform(std::mt19937_64& draw) {
  return static_cast<double>(draw() >> 11) * 0x1p-53;
}

std::vector<double> dilated(const surface::HeightGrid& grid, double radius) {
  const int reach = static_cast<int>(radius / grid.dx_nm);
  std::vector<double> seen(grid.z_nm.size(), -1e300);
  for (int j = 0; j < grid.rows; ++j) {
    for (int i = 0; i < grid.columns; ++i) {
      double& highest = seen[static_cast<std::size_t>(j * grid.columns + i)];
      for (int dj = std::max(-reach, -j); dj <= std::min(reach, grid.rows - 1 - j); ++dj) {
        for (int di = std::max(-reach, -i); di <= std::min(reach, grid.columns - 1 - i); ++di) {
          const double r2 = (di * di + dj * dj) * grid.dx_nm * grid.dx_nm;
          if (r2 >= radius * radius) continue;
          const double z = grid.z_nm[static_cast<std::size_t>((j + dj) * grid.columns + i + di)];
          highest = std::max(highest, z + std::sqrt(radius * radius - r2) - radius);
        }
      }
    }
  }
  return seen;
}

}  // namespace

surface::HeightGrid self_affine(const SelfAffine& ground) {
  struct Wave {
    double qx, qy, phase, amplitude;
  };
  std::mt19937_64 draw(ground.seed);
  std::vector<Wave> waves;
  // Even in ln q: a wave stands for 2π q² C(q) d ln q of the heights' variance, and q² times that of the slopes'.
  const double least = 2 * kPi / ground.roll_off_nm, most = kPi / ground.pixel_nm;
  double slope2 = 0;
  for (int k = 0; k < kWaves; ++k) {
    const double q = least * std::pow(most / least, uniform(draw));
    const double direction = 2 * kPi * uniform(draw), phase = 2 * kPi * uniform(draw);
    const double amplitude = std::pow(q, -ground.hurst);
    waves.push_back({q * std::cos(direction), q * std::sin(direction), phase, amplitude});
    slope2 += 0.5 * amplitude * amplitude * q * q;
  }
  const double scale = ground.rms_slope / std::sqrt(slope2);
  surface::HeightGrid grid{ground.pixels, ground.pixels, ground.pixel_nm, ground.pixel_nm, 0, 0, {}};
  for (int j = 0; j < ground.pixels; ++j) {
    for (int i = 0; i < ground.pixels; ++i) {
      double z = 0;
      for (const Wave& wave : waves) {
        z += wave.amplitude * std::cos((wave.qx * i + wave.qy * j) * ground.pixel_nm + wave.phase);
      }
      grid.z_nm.push_back(scale * z);
    }
  }
  if (ground.dilated_nm > 0) grid.z_nm = dilated(grid, ground.dilated_nm);
  return grid;
}

const std::vector<SelfAffine>& tabled_grounds() {
  static const std::vector<SelfAffine> grounds = {
      {.seed = 1, .pixel_nm = 2, .hurst = 0.8, .rms_slope = 0.15, .roll_off_nm = 60},
      {.seed = 2, .pixel_nm = 1.5, .hurst = 0.6, .rms_slope = 0.35, .roll_off_nm = 50, .dilated_nm = 8},
      {.seed = 3, .pixel_nm = 4, .hurst = 0.8, .rms_slope = 0.2, .roll_off_nm = 150},
      {.seed = 4, .pixel_nm = 2.5, .hurst = 0.8, .rms_slope = 0.25, .roll_off_nm = 80, .dilated_nm = 10}};
  return grounds;
}

}  // namespace telenano::elastic

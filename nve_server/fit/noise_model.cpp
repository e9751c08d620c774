#include "telenano/nve_server/fit/noise_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/fit/decompositions.h"

namespace telenano::fit {
namespace {

constexpr double kFirstMemory = 3.0;  // points
constexpr double kMemoryRatio = 4.0;

const std::array<double, kMemories>& keeps() {
  static const std::array<double, kMemories> kKeeps = [] {
    std::array<double, kMemories> keep{};
    double memory = kFirstMemory;
    for (double& k : keep) {
      k = det_exp(-1.0 / memory);
      memory *= kMemoryRatio;
    }
    return keep;
  }();
  return kKeeps;
}

/// `steep`: ln of the ratio of variances from one memory to the next.
NoiseModel model_of(double share, double steep) {
  NoiseModel model;
  model.white = 1;
  for (std::size_t k = 0; k < kMemories; ++k)
    model.variance[k] = share * det_exp(steep * (static_cast<double>(k) - 0.5 * (kMemories - 1)));
  return model;
}

struct Likelihood {
  double minus_log = std::numeric_limits<double>::infinity();
  double scale = 1;  // what the model's variances must be multiplied by
};

Likelihood likelihood(const NoiseModel& model, const std::vector<double>& series,
                      const std::vector<char>& used, const std::vector<std::vector<double>>& design) {
  const std::vector<double> none(series.size(), 0.0);
  const Whitener whitener(model, none, used);
  const auto n = static_cast<Eigen::Index>(series.size());
  const auto columns = static_cast<Eigen::Index>(design.size());
  Matrix x(n, columns);
  Vector y(n);
  whitener.apply(series, y.data());
  for (Eigen::Index i = 0; i < columns; ++i)
    whitener.apply(design[static_cast<std::size_t>(i)], x.col(i).data());
  Vector pivots;
  const Vector beta = solve_symmetric(x.transpose() * x, x.transpose() * y, &pivots);
  const double rest = (y - x * beta).squaredNorm();
  const double free =
      static_cast<double>(std::count(used.begin(), used.end(), 1)) - static_cast<double>(columns);
  double determinant = 0;
  for (const double d : pivots) determinant += d > 0 ? det_log(d) : 0.0;
  Likelihood found;
  if (!(free > 0) || !(rest > 0)) return found;
  found.scale = rest / free;
  found.minus_log = 0.5 * (free * det_log(found.scale) + whitener.log_determinant() + determinant);
  return found;
}

}  // namespace

double NoiseModel::sigma() const noexcept {
  double sum = white;
  for (const double v : variance) sum += v;
  return std::sqrt(sum);
}

Whitener::Whitener(const NoiseModel& model, const std::vector<double>& more, const std::vector<char>& used)
    : gain_(used.size()), scale_(used.size(), 0.0) {
  const auto& keep = keeps();
  double p[kMemories][kMemories] = {};
  for (std::size_t k = 0; k < kMemories; ++k) p[k][k] = model.variance[k];
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (i > 0) {
      for (std::size_t a = 0; a < kMemories; ++a) {
        for (std::size_t b = 0; b < kMemories; ++b) p[a][b] *= keep[a] * keep[b];
        p[a][a] += (1.0 - keep[a] * keep[a]) * model.variance[a];
      }
    }
    gain_[i].fill(0.0);
    if (used[i] == 0) continue;
    double column[kMemories];
    double s = model.white + more[i];
    for (std::size_t a = 0; a < kMemories; ++a) {
      column[a] = 0;
      for (std::size_t b = 0; b < kMemories; ++b) column[a] += p[a][b];
      s += column[a];
    }
    for (std::size_t a = 0; a < kMemories; ++a) gain_[i][a] = column[a] / s;
    for (std::size_t a = 0; a < kMemories; ++a)
      for (std::size_t b = 0; b < kMemories; ++b) p[a][b] -= column[a] * column[b] / s;
    scale_[i] = 1.0 / std::sqrt(s);
    log_determinant_ += det_log(s);
  }
}

void Whitener::apply(const std::vector<double>& series, double* out) const {
  const auto& keep = keeps();
  std::array<double, kMemories> state{};
  for (std::size_t i = 0; i < scale_.size(); ++i) {
    double expected = 0;
    for (std::size_t k = 0; k < kMemories; ++k) {
      state[k] *= keep[k];
      expected += state[k];
    }
    out[i] = 0;
    if (scale_[i] == 0) continue;
    const double surprise = series[i] - expected;
    out[i] = surprise * scale_[i];
    for (std::size_t k = 0; k < kMemories; ++k) state[k] += gain_[i][k] * surprise;
  }
}

NoiseModel estimate_noise(const std::vector<double>& series, const std::vector<char>& used,
                          const std::vector<std::vector<double>>& design) {
  // White noise alone, then a grid of shares and steepnesses, then finer round the best.
  double best_share = 0;
  double best_steep = 0;
  Likelihood best = likelihood(model_of(0, 0), series, used, design);
  const auto attempt = [&](double share, double steep) {
    const Likelihood found = likelihood(model_of(share, steep), series, used, design);
    if (!(found.minus_log < best.minus_log)) return false;
    best = found;
    best_share = share;
    best_steep = steep;
    return true;
  };
  for (const double share : {1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0})
    for (const double steep : {-1.0, 0.0, 1.0}) attempt(share, steep);
  double factor = 2.5;
  double tilt = 0.5;
  for (int i = 0; i < 8 && best_share > 0; ++i) {
    const double share = best_share;
    const double steep = best_steep;
    bool better = attempt(share * factor, steep);
    better = attempt(share / factor, steep) || better;
    better = (steep + tilt <= 1.5 && attempt(best_share, steep + tilt)) || better;
    better = (steep - tilt >= -1.5 && attempt(best_share, steep - tilt)) || better;
    if (better) continue;
    factor = std::sqrt(factor);
    tilt *= 0.5;
  }
  NoiseModel model = model_of(best_share, best_steep);
  const double scale = std::isfinite(best.minus_log) ? best.scale : 0.0;
  model.white *= scale;
  for (double& v : model.variance) v *= scale;
  return model;
}

}  // namespace telenano::fit

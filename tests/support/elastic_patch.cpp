#include "tests/support/elastic_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace telenano::testing {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kRimConstant = 0.473;

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace

double sphere_profile(double radius_nm, double x_nm, double y_nm) {
  const double r2 = x_nm * x_nm + y_nm * y_nm;
  const double q2 = radius_nm * radius_nm - r2;
  return q2 > 0 ? r2 / (radius_nm + std::sqrt(q2)) : 1e3 * radius_nm;
}

ElasticPatch::ElasticPatch(int n, double side_nm, double modulus_gpa)
    : n_(n), side_(side_nm), modulus_(modulus_gpa) {
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const double kx = 2 * kPi / side_nm * std::min(i, n - i), ky = 2 * kPi / side_nm * std::min(j, n - j);
      stiffness_.push_back(0.5 * modulus_gpa * std::hypot(kx, ky));
    }
  }
  stiffness_[0] = 0.8055 * modulus_gpa / side_nm;
  for (int i = 0; i < n / 2; ++i) turn_.push_back(std::polar(1.0, -2 * kPi * i / n));
}

// Radix two, along x, transposed, along the other: the transform comes out transposed, which the stiffness,
// being symmetric in x and y, does not see.
void ElasticPatch::transform(std::vector<std::complex<double>>& a, bool back) const {
  const auto n = static_cast<std::size_t>(n_);
  for (int side = 0; side < 2; ++side) {
    for (std::size_t row = 0; row < n; ++row) {
      std::complex<double>* line = &a[row * n];
      for (std::size_t i = 1, j = 0; i < n; ++i) {
        std::size_t bit = n >> 1;
        for (; j & bit; bit >>= 1) j ^= bit;
        j ^= bit;
        if (i < j) std::swap(line[i], line[j]);
      }
      for (std::size_t half = 1; half < n; half *= 2) {
        const std::size_t stride = n / (2 * half);
        for (std::size_t start = 0; start < n; start += 2 * half) {
          for (std::size_t k = 0; k < half; ++k) {
            const std::complex<double> w = turn_[k * stride];
            const double wi = back ? -w.imag() : w.imag();
            const std::complex<double> b = line[start + k + half];
            const std::complex<double> turned(b.real() * w.real() - b.imag() * wi,
                                              b.real() * wi + b.imag() * w.real());
            line[start + k + half] = line[start + k] - turned;
            line[start + k] += turned;
          }
        }
      }
    }
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t i = 0; i < j; ++i) std::swap(a[j * n + i], a[i * n + j]);
    }
  }
}

template <class F>
void ElasticPatch::filter(const std::vector<double>& in, std::vector<double>& out, const F& f) const {
  std::vector<std::complex<double>> a(in.begin(), in.end());
  transform(a, false);
  const double scale = 1.0 / (static_cast<double>(n_) * n_);
  for (std::size_t k = 0; k < a.size(); ++k) a[k] *= scale * f(stiffness_[k]);
  transform(a, true);
  out.resize(in.size());
  for (std::size_t k = 0; k < a.size(); ++k) out[k] = a[k].real();
}

double ElasticPatch::press(const std::vector<double>& gap) const {
  const std::size_t count = gap.size();
  std::vector<double> p(count), g, r(count), d(count), ad, z;  // p: pressure, >= 0
  for (std::size_t k = 0; k < count; ++k) p[k] = gap[k] < 0 ? -gap[k] * modulus_ / (0.1 * side_) : 0.0;
  double last = 1;
  bool restart = true;
  double force = 0;
  for (int iteration = 0; iteration < 2000; ++iteration) {
    filter(p, g, [](double k) { return 1 / k; });
    for (std::size_t k = 0; k < count; ++k) g[k] += gap[k];  // gap as deformed
    double square = 0;
    for (std::size_t k = 0; k < count; ++k) square += p[k] > 0 ? g[k] * g[k] : 0.0;
    for (std::size_t k = 0; k < count; ++k) {
      d[k] = p[k] > 0 ? g[k] + (restart ? 0.0 : square / last * d[k]) : 0.0;
    }
    last = square;
    filter(d, ad, [](double k) { return 1 / k; });
    double upper = 0, lower = 0;
    for (std::size_t k = 0; k < count; ++k) {
      if (p[k] > 0) {
        upper += g[k] * d[k];
        lower += ad[k] * d[k];
      }
    }
    const double step = lower > 0 ? upper / lower : 0.0;
    restart = false;
    for (std::size_t k = 0; k < count; ++k) {
      if (p[k] > 0) p[k] = std::max(0.0, p[k] - step * d[k]);
    }
    for (std::size_t k = 0; k < count; ++k) {
      if (p[k] == 0.0 && g[k] < 0) {
        p[k] = -step * g[k];
        restart = true;
      }
    }
    double sum = 0;
    for (const double one : p) sum += one;
    const double now = sum * spacing_nm() * spacing_nm();
    if (iteration > 20 && !restart && std::abs(now - force) < 1e-9 * now &&
        square < 1e-16 * static_cast<double>(count)) {
      return now;
    }
    force = now;
  }
  return force;
}

std::vector<double> ElasticPatch::pull_gpa(const std::vector<double>& gap, const Adhesion& adhesion,
                                           const std::vector<double>& u) {
  const double scale = 8 * adhesion.work_n_per_m / (3 * adhesion.range_nm);
  std::vector<double> pull;
  for (std::size_t k = 0; k < gap.size(); ++k) {
    const double x = adhesion.range_nm / (gap[k] - u[k]), x3 = x * x * x;
    pull.push_back(scale * (x3 - x3 * x3 * x3));
  }
  return pull;
}

double ElasticPatch::adhere(const std::vector<double>& gap, const Adhesion& adhesion,
                            std::vector<double>& u) const {
  const std::size_t count = gap.size();
  const double z0 = adhesion.range_nm;
  const double scale = 8 * adhesion.work_n_per_m / (3 * z0);
  u.resize(count);
  std::vector<double> pull(count), rate(count), ku, r(count), z, az(count), d(count), ad(count), step(count);
  double residual = 0;
  // Traction and its derivative −dp/du, elastic force K u; the balance is K u = p.
  const auto evaluate = [&](const std::vector<double>& at) {
    filter(at, ku, [](double k) { return k; });
    residual = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const double g = gap[k] - at[k];
      if (!(g > 0.3 * z0)) return false;
      const double x = z0 / g, x3 = x * x * x;
      pull[k] = scale * (x3 - x3 * x3 * x3);
      rate[k] = scale * (9 * x3 * x3 * x3 - 3 * x3) / g;
      r[k] = pull[k] - ku[k];
      residual += r[k] * r[k];
    }
    return true;
  };
  for (std::size_t k = 0; k < count; ++k) u[k] = std::min(u[k], gap[k] - 0.6 * z0);
  if (!evaluate(u)) return std::numeric_limits<double>::quiet_NaN();
  for (int newton = 0; newton < 80; ++newton) {
    if (residual < 1e-8 * static_cast<double>(count) * 1e-4) break;
    // (K + rate) step = r by conjugate gradients, preconditioned by waves (K + d)⁻¹; with z = (K + d)⁻¹ r the
    // product A z = r + (rate − d) z needs no transform of its own. Stopped where the matrix is not positive:
    // then the step so far goes down.
    double mean = 0, most = 0;
    for (const double one : rate) {
      mean += std::max(0.0, one) / static_cast<double>(count);
      most = std::max(most, one);
    }
    const double shift = std::max({0.02 * most, mean, stiffness_[0]});
    std::fill(step.begin(), step.end(), 0.0);
    std::vector<double> rest = r;
    double rz = 0;
    const double aim = residual * std::min(1e-3, residual);
    for (int iteration = 0; iteration < 300; ++iteration) {
      filter(rest, z, [shift](double k) { return 1 / (k + shift); });
      for (std::size_t k = 0; k < count; ++k) az[k] = rest[k] + (rate[k] - shift) * z[k];
      const double now = dot(rest, z);
      const double beta = iteration == 0 ? 0.0 : now / rz;
      rz = now;
      for (std::size_t k = 0; k < count; ++k) {
        d[k] = z[k] + beta * d[k];
        ad[k] = az[k] + beta * ad[k];
      }
      const double bend = dot(d, ad);
      if (!(bend > 0)) {
        if (iteration == 0) step = z;
        break;
      }
      const double alpha = rz / bend;
      double left = 0;
      for (std::size_t k = 0; k < count; ++k) {
        step[k] += alpha * d[k];
        rest[k] -= alpha * ad[k];
        left += rest[k] * rest[k];
      }
      if (left < std::max(aim, 1e-14 * static_cast<double>(count))) break;
    }
    // No element moves more than a fifth of its gap.
    double factor = 1;
    for (std::size_t k = 0; k < count; ++k) {
      const double most_up = 0.2 * (gap[k] - u[k]);
      if (step[k] * factor > most_up) factor = most_up / step[k];
      if (-step[k] * factor > 0.1) factor = 0.1 / -step[k];
    }
    for (std::size_t k = 0; k < count; ++k) u[k] += factor * step[k];
    if (!evaluate(u)) return std::numeric_limits<double>::quiet_NaN();
  }
  if (!(residual < 1e-6 * static_cast<double>(count))) return std::numeric_limits<double>::quiet_NaN();
  double sum = 0;
  for (const double one : pull) sum += one;
  return -sum * spacing_nm() * spacing_nm();
}

double ElasticPatch::stick(const std::vector<double>& gap, double work_n_per_m, Touching& state) const {
  const std::size_t count = gap.size();
  state.element.resize(count, 0);
  state.pull_gpa.resize(count, 0.0);
  std::vector<char>& touching = state.element;
  std::vector<double>& pull = state.pull_gpa;
  const double limit = std::sqrt(modulus_ * work_n_per_m / (kRimConstant * spacing_nm()));
  std::vector<double> u, r(count), d(count), ad;
  const auto residual = [&] {
    filter(pull, u, [](double k) { return 1 / k; });
    double square = 0;
    for (std::size_t k = 0; k < count; ++k) {
      r[k] = touching[k] != 0 ? gap[k] - u[k] : 0.0;
      square += r[k] * r[k];
    }
    return square;
  };
  for (int round = 0; round < 2000; ++round) {
    // u = gap where it touches, by conjugate gradients.
    double square = residual();
    d = r;
    const double aim = 1e-14 * static_cast<double>(count);
    for (int iteration = 0; iteration < 500 && square > aim; ++iteration) {
      filter(d, ad, [](double k) { return 1 / k; });
      double bend = 0;
      for (std::size_t k = 0; k < count; ++k) bend += touching[k] != 0 ? d[k] * ad[k] : 0.0;
      const double alpha = square / bend;
      double next = 0;
      for (std::size_t k = 0; k < count; ++k) {
        if (touching[k] == 0) continue;
        pull[k] += alpha * d[k];
        r[k] -= alpha * ad[k];
        next += r[k] * r[k];
      }
      for (std::size_t k = 0; k < count; ++k) d[k] = touching[k] != 0 ? r[k] + next / square * d[k] : 0.0;
      square = next;
    }
    residual();
    bool changed = false;
    for (std::size_t k = 0; k < count; ++k) {
      if (touching[k] != 0 ? pull[k] > limit : gap[k] - u[k] < -1e-9) {
        touching[k] = touching[k] != 0 ? 0 : 1;
        if (touching[k] == 0) pull[k] = 0;
        changed = true;
      }
    }
    if (changed) continue;
    double sum = 0;
    for (const double one : pull) sum += one;
    return -sum * spacing_nm() * spacing_nm();
  }
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace telenano::testing

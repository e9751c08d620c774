#include "telenano/nve_server/physics/surface/dilation.h"

#include <immintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "telenano/common/base/det_math.h"
#include "telenano/common/base/error.h"
#include "telenano/nve_server/physics/numerics/numbers.h"

namespace telenano::physics {
namespace {

constexpr double kLeftOut = 25.0;  // e^−25 of the largest term
constexpr double kParaboloidFrom = 1.0 / 20.0;
// e^{h/t} of a window over its highest point: e^−600 leaves room for the kernel's part in a double. A sum
// below kLeastSum may have lost terms.
constexpr double kRoom = 600.0;
constexpr double kLeastSum = 1e-280;
constexpr int kLeastPart = 8;
// A foot nearer than 0.9 R is the ball's own; real scans have few beyond, so that looking costs them little.
constexpr double kFarFoot = 0.9;
// What the ball's cosine may be more by; on planes of 45 degrees it is at most 0.03.
constexpr double kFlatter = 0.1;

int floor_div(int a, int b) {
  return a >= 0 ? a / b : -((b - 1 - a) / b);
}

/// Index of the sample that the mirrored scan has at i, `last` being the far rim.
int mirrored(int i, int last) {
  const int period = 2 * last;
  int k = i % period;
  if (k < 0) k += period;
  return k <= last ? k : period - k;
}

}  // namespace

DilationLattice dilation_lattice(const BicubicSpline& height, double node_nm, double sample_nm) {
  const double width = height.x_last_nm() - height.x_first_nm();
  const double length = height.y_last_nm() - height.y_first_nm();
  const auto parts = [](double extent, double spacing) {
    return std::max(3, static_cast<int>(std::ceil(extent / spacing - 1e-9)));
  };
  DilationLattice lattice;
  const int across = parts(width, node_nm);
  const int along = parts(length, node_nm);
  lattice.x_first_nm = height.x_first_nm();
  lattice.y_first_nm = height.y_first_nm();
  lattice.columns = across + 1;
  lattice.rows = along + 1;
  lattice.node_dx_nm = width / across;
  lattice.node_dy_nm = length / along;
  lattice.m = sub_samples(lattice, sample_nm);
  return lattice;
}

int sub_samples(const DilationLattice& lattice, double sample_nm) noexcept {
  const double wider = std::max(lattice.node_dx_nm, lattice.node_dy_nm);
  const int m = std::max(1, static_cast<int>(std::ceil(wider / sample_nm - 1e-9)));
  return m > 2 ? (m + 3) / 4 * 4 : m;  // few alignments of nodes and blocks
}

/// The sub-samples that the nodes of a tile reach, in blocks of 4 × 4, heights above `reference`.
struct Dilation::Window {
  int first_block_x = 0, first_block_y = 0;
  int blocks_x = 0, blocks_y = 0;
  double reference = 0, relief = 0;
  std::vector<double> height;   // 16 a block
  std::vector<double> boosted;  // e^{height/t}
  std::vector<float> most;      // of the height, a block
};

double Dilation::profile_at(double r2) const noexcept {
  return paraboloid_ ? -0.5 * r2 / radius_ : ball_profile_at(r2);
}

double Dilation::ball_profile_at(double r2) const noexcept {
  const double q2 = radius_ * radius_ - r2;
  const double cone_q = kConeCosine * radius_;
  if (q2 > cone_q * cone_q) return -r2 / (radius_ + std::sqrt(q2));
  const double sine = std::sqrt(1.0 - kConeCosine * kConeCosine);
  return -radius_ * (1.0 - kConeCosine) - sine / kConeCosine * (std::sqrt(r2) - sine * radius_);
}

// On the sphere n_z = q/R = 1 + ψ/R.
void Dilation::weight_at(double psi, double& weight, double& moment) const noexcept {
  if (paraboloid_) {
    weight = 1.0;
    moment = -2.0 * radius_ * psi;  // r²
    return;
  }
  moment = std::max(1.0 + psi / radius_, kConeCosine);
  weight = 1.0 / moment;
}

Dilation::Dilation(const BicubicSpline& height, const DilationLattice& lattice, double tip_radius_nm,
                   double softening_nm, double relief_nm, Lanes lanes, const RetractionKernel* kernel)
    : height_(&height),
      lattice_(lattice),
      radius_(tip_radius_nm),
      t_(softening_nm),
      lanes_(lanes),
      pull_off_(kernel != nullptr && kernel->active() ? kernel : nullptr),
      level_(relief_nm == 0.0),
      paraboloid_(softening_nm > kParaboloidFrom * tip_radius_nm),
      dx_(lattice.node_dx_nm / lattice.m),
      dy_(lattice.node_dy_nm / lattice.m) {
  if (!(tip_radius_nm > 0.0 && std::isfinite(tip_radius_nm)) ||
      !(softening_nm > 0.0 && std::isfinite(softening_nm)) ||
      !(relief_nm >= 0.0 && std::isfinite(relief_nm))) {
    throw UserError("dilation: expected a positive tip radius and softening, and finite heights");
  }
  // An element further out than where ψ is less than −(relief + 27 t) cannot reach a node's largest term,
  // which is at least the ground under the node.
  const double depth = relief_nm + kLeftOut * t_;
  double far = std::sqrt(2.0 * radius_ * depth);
  if (!paraboloid_) {
    const double sine = std::sqrt(1.0 - kConeCosine * kConeCosine);
    const double cone = radius_ * (1.0 - kConeCosine);
    far = depth <= cone ? std::sqrt((2.0 * radius_ - depth) * depth)
                        : sine * radius_ + (depth - cone) * kConeCosine / sine;
  }
  reach_ = static_cast<int>(far / (kBlock * std::min(dx_, dy_))) + 1;
  alignments_ = kBlock / std::gcd(lattice_.m, kBlock);
  const int across = 2 * reach_ + 1;
  const std::size_t blocks = static_cast<std::size_t>(alignments_) * static_cast<std::size_t>(alignments_) *
                             static_cast<std::size_t>(across) * static_cast<std::size_t>(across);
  kernel_.resize(blocks);
  most_.resize(blocks);
  least_.resize(blocks);
  std::size_t b = 0;
  const int step = kBlock / alignments_;
  for (int ay = 0; ay < alignments_; ++ay) {
    for (int ax = 0; ax < alignments_; ++ax) {
      for (int by = -reach_; by <= reach_; ++by) {
        for (int bx = -reach_; bx <= reach_; ++bx, ++b) {
          Block& block = kernel_[b];
          double most = -INFINITY, least = 0;
          for (int k = 0; k < 16; ++k) {
            const double x = (kBlock * bx + k % 4 - step * ax) * dx_;
            const double y = (kBlock * by + k / 4 - step * ay) * dy_;
            const double psi = profile_at(x * x + y * y);
            double weight, moment;
            weight_at(psi, weight, moment);
            block.weight[k] = weight * det_exp(psi / t_);
            block.moment[k] = moment * block.weight[k];
            block.profile[k] = psi;
            most = std::max(most, psi);
            least = std::min(least, psi);
          }
          most_[b] = static_cast<float>(most);
          least_[b] = static_cast<float>(least);
        }
      }
    }
  }
}

Dilation::Nodes Dilation::Nodes::common(const Nodes& other) const noexcept {
  const int left = std::max(i0, other.i0), low = std::max(j0, other.j0);
  return {left, low, std::min(i0 + nx, other.i0 + other.nx) - left,
          std::min(j0 + ny, other.j0 + other.ny) - low};
}

// Heights of the whole part, for its reference, unless that is known; the rest where the wanted nodes reach.
void Dilation::fill_window(const Nodes& part, const PartExtremes::Part& id, const Nodes& wanted,
                           Window& window) const {
  PartExtremes::Extremes extremes;
  const bool known = extremes_ && extremes_->find(id, extremes);
  const Nodes& seen = known ? wanted : part;
  const int m = lattice_.m;
  const auto first_block = [&](int i) { return floor_div(i * m, kBlock) - reach_; };
  const auto last_block = [&](int i, int count) { return floor_div((i + count - 1) * m, kBlock) + reach_; };
  window.first_block_x = first_block(seen.i0);
  window.first_block_y = first_block(seen.j0);
  window.blocks_x = last_block(seen.i0, seen.nx) - window.first_block_x + 1;
  window.blocks_y = last_block(seen.j0, seen.ny) - window.first_block_y + 1;
  const int sx = window.blocks_x * kBlock;
  const int sy = window.blocks_y * kBlock;
  // Heights of the mirrored spline: along x for each row of coefficients in reach, then along y.
  struct Line {
    int first;
    double weight[4];
  };
  const auto line_of = [](const BicubicSpline::Stencil& stencil, bool across) {
    Line line{across ? stencil.column : stencil.row, {}};
    for (int k = 0; k < 4; ++k) line.weight[k] = across ? stencil.x_value[k] : stencil.y_value[k];
    return line;
  };
  std::vector<Line> across(static_cast<std::size_t>(sx)), along(static_cast<std::size_t>(sy));
  const int last_x = (lattice_.columns - 1) * m;
  const int last_y = (lattice_.rows - 1) * m;
  int low = height_->rows(), high = -1;
  for (int i = 0; i < sx; ++i) {
    const int k = mirrored(window.first_block_x * kBlock + i, last_x);
    across[static_cast<std::size_t>(i)] =
        line_of(height_->stencil(lattice_.x_first_nm + k * dx_, lattice_.y_first_nm), true);
  }
  for (int j = 0; j < sy; ++j) {
    const int k = mirrored(window.first_block_y * kBlock + j, last_y);
    const Line line = line_of(height_->stencil(lattice_.x_first_nm, lattice_.y_first_nm + k * dy_), false);
    along[static_cast<std::size_t>(j)] = line;
    low = std::min(low, line.first);
    high = std::max(high, line.first + 3);
  }
  std::vector<double> rows(static_cast<std::size_t>(high - low + 1) * static_cast<std::size_t>(sx));
  for (int r = low; r <= high; ++r) {
    double* row = &rows[static_cast<std::size_t>(r - low) * static_cast<std::size_t>(sx)];
    for (int i = 0; i < sx; ++i) {
      const Line& line = across[static_cast<std::size_t>(i)];
      double z = 0;
      for (int k = 0; k < 4; ++k) z += line.weight[k] * height_->coefficient(line.first + k, r);
      row[i] = z;
    }
  }
  const std::size_t count = static_cast<std::size_t>(sx) * static_cast<std::size_t>(sy);
  window.height.resize(count);
  window.boosted.resize(count);
  window.most.resize(count / 16);
  // Four columns at a time, each with its own extremes: as a block has them, and as compilers have lanes.
  double most_of[kBlock], least_of[kBlock];
  std::fill_n(most_of, kBlock, -INFINITY);
  std::fill_n(least_of, kBlock, INFINITY);
  for (int j = 0; j < sy; ++j) {
    const Line& line = along[static_cast<std::size_t>(j)];
    const double* row[4];
    for (int k = 0; k < 4; ++k) {
      row[k] = &rows[static_cast<std::size_t>(line.first - low + k) * static_cast<std::size_t>(sx)];
    }
    double* to = &window.height[static_cast<std::size_t>(j / kBlock) * static_cast<std::size_t>(sx) * kBlock +
                                static_cast<std::size_t>(j % kBlock * kBlock)];
    for (int i = 0; i < sx; i += kBlock, to += kBlock * kBlock) {
      for (int k = 0; k < kBlock; ++k) {
        const double z = (line.weight[0] * row[0][i + k] + line.weight[1] * row[1][i + k]) +
                         (line.weight[2] * row[2][i + k] + line.weight[3] * row[3][i + k]);
        to[k] = z;
        most_of[k] = most_of[k] > z ? most_of[k] : z;
        least_of[k] = least_of[k] < z ? least_of[k] : z;
      }
    }
  }
  if (!known) {
    extremes = {*std::max_element(most_of, most_of + kBlock), *std::min_element(least_of, least_of + kBlock)};
    if (extremes_) extremes_->keep(id, extremes);
  }
  const double highest = extremes.highest;
  window.reference = highest;
  window.relief = highest - extremes.lowest;
  const int left = first_block(wanted.i0) - window.first_block_x;
  const int right = last_block(wanted.i0, wanted.nx) - window.first_block_x;
  const int bottom = first_block(wanted.j0) - window.first_block_y;
  const int top = last_block(wanted.j0, wanted.ny) - window.first_block_y;
  for (int row = bottom; row <= top; ++row) {
    for (int column = left; column <= right; ++column) {
      const auto block = static_cast<std::size_t>(row) * static_cast<std::size_t>(window.blocks_x) +
                         static_cast<std::size_t>(column);
      double most = -INFINITY;
      for (std::size_t k = 16 * block; k < 16 * block + 16; ++k) {
        window.height[k] -= highest;
        window.boosted[k] = window.height[k] / t_;
        most = std::max(most, window.height[k]);
      }
      det_exp_each(&window.boosted[16 * block], 16, &window.boosted[16 * block]);
      window.most[block] = static_cast<float>(most);
    }
  }
}

// The blocks that may hold a term above e^−25 of a node's largest, in a fixed order: use(ground block, kernel
// block).
template <class Use>
void Dilation::each_block(const Window& window, int i, int j, const Use& use) const {
  const int m = lattice_.m;
  const int step = kBlock / alignments_;
  const int qx = floor_div(i * m, kBlock), qy = floor_div(j * m, kBlock);
  const int ax = (i * m - qx * kBlock) / step, ay = (j * m - qy * kBlock) / step;
  const auto across = static_cast<std::size_t>(2 * reach_ + 1);
  const std::size_t table = static_cast<std::size_t>(ay * alignments_ + ax) * across * across;
  const std::size_t corner = static_cast<std::size_t>(qy - reach_ - window.first_block_y) *
                                 static_cast<std::size_t>(window.blocks_x) +
                             static_cast<std::size_t>(qx - reach_ - window.first_block_x);
  const auto blocks_x = static_cast<std::size_t>(window.blocks_x);
  // The largest term is at least this: in each block the highest sub-sample with the lowest of ψ.
  __m128 floors = _mm_set1_ps(-INFINITY);
  float floor_of_largest = -INFINITY;
  for (std::size_t row = 0; row < across; ++row) {
    const float* most = &window.most[corner + row * blocks_x];
    const float* least = &least_[table + row * across];
    std::size_t b = 0;
    for (; b + 4 <= across; b += 4) {
      floors = _mm_max_ps(floors, _mm_add_ps(_mm_loadu_ps(most + b), _mm_loadu_ps(least + b)));
    }
    for (; b < across; ++b) floor_of_largest = std::max(floor_of_largest, most[b] + least[b]);
  }
  float four[4];
  _mm_storeu_ps(four, floors);
  for (const float one : four) floor_of_largest = std::max(floor_of_largest, one);
  const float cut = floor_of_largest - static_cast<float>(kLeftOut * t_);
  const __m128 cuts = _mm_set1_ps(cut);
  for (std::size_t row = 0; row < across; ++row) {
    const std::size_t on = corner + row * blocks_x;
    const std::size_t of = table + row * across;
    std::size_t b = 0;
    for (; b + 4 <= across; b += 4) {
      const __m128 reach = _mm_add_ps(_mm_loadu_ps(&window.most[on + b]), _mm_loadu_ps(&most_[of + b]));
      unsigned in = static_cast<unsigned>(_mm_movemask_ps(_mm_cmpge_ps(reach, cuts)));
      for (; in != 0; in &= in - 1) {
        const auto k = b + static_cast<std::size_t>(std::countr_zero(in));
        use(on + k, of + k);
      }
    }
    for (; b < across; ++b) {
      if (window.most[on + b] + most_[of + b] >= cut) use(on + b, of + b);
    }
  }
}

// Terms k, k + 4, k + 8 … have a sum of their own for each k of four, whichever registers hold them: four
// chains of additions for each quantity in two registers or one.
void Dilation::sum_two(const Pair* pairs, std::size_t count, Sums& sums) noexcept {
  __m128d s[2], phi[2], moment[2], moment_phi[2];
  for (int half = 0; half < 2; ++half)
    s[half] = phi[half] = moment[half] = moment_phi[half] = _mm_setzero_pd();
  for (std::size_t n = 0; n < count; ++n) {
    const Pair& pair = pairs[n];
    for (int k = 0; k < 16; k += 2) {
      const int half = k / 2 % 2;
      const __m128d boost = _mm_loadu_pd(pair.boosted + k);
      const __m128d f = _mm_add_pd(_mm_loadu_pd(pair.height + k), _mm_loadu_pd(pair.kernel->profile + k));
      const __m128d p = _mm_mul_pd(boost, _mm_loadu_pd(pair.kernel->weight + k));
      const __m128d m = _mm_mul_pd(boost, _mm_loadu_pd(pair.kernel->moment + k));
      s[half] = _mm_add_pd(s[half], p);
      phi[half] = _mm_add_pd(phi[half], _mm_mul_pd(p, f));
      moment[half] = _mm_add_pd(moment[half], m);
      moment_phi[half] = _mm_add_pd(moment_phi[half], _mm_mul_pd(m, f));
    }
  }
  const auto total = [](const __m128d(&v)[2]) {
    const __m128d two = _mm_add_pd(v[0], v[1]);
    return _mm_cvtsd_f64(two) + _mm_cvtsd_f64(_mm_unpackhi_pd(two, two));
  };
  sums = {total(s), total(phi), total(moment), total(moment_phi)};
}

// In a section of its own, so that a test can look for such instructions in all other code.
__attribute__((target("avx"), section("dispatched_avx"))) void Dilation::sum_four(const Pair* pairs,
                                                                                  std::size_t count,
                                                                                  Sums& sums) noexcept {
  __m256d s = _mm256_setzero_pd(), phi = s, moment = s, moment_phi = s;
  for (std::size_t n = 0; n < count; ++n) {
    const Pair& pair = pairs[n];
    for (int k = 0; k < 16; k += 4) {
      const __m256d boost = _mm256_loadu_pd(pair.boosted + k);
      const __m256d f =
          _mm256_add_pd(_mm256_loadu_pd(pair.height + k), _mm256_loadu_pd(pair.kernel->profile + k));
      const __m256d p = _mm256_mul_pd(boost, _mm256_loadu_pd(pair.kernel->weight + k));
      const __m256d m = _mm256_mul_pd(boost, _mm256_loadu_pd(pair.kernel->moment + k));
      s = _mm256_add_pd(s, p);
      phi = _mm256_add_pd(phi, _mm256_mul_pd(p, f));
      moment = _mm256_add_pd(moment, m);
      moment_phi = _mm256_add_pd(moment_phi, _mm256_mul_pd(m, f));
    }
  }
  __m256d all[4] = {s, phi, moment, moment_phi};
  double totals[4];
  for (int i = 0; i < 4; ++i) {
    const __m128d two = _mm_add_pd(_mm256_castpd256_pd128(all[i]), _mm256_extractf128_pd(all[i], 1));
    totals[i] = _mm_cvtsd_f64(two) + _mm_cvtsd_f64(_mm_unpackhi_pd(two, two));
  }
  sums = {totals[0], totals[1], totals[2], totals[3]};
}

Lanes widest_lanes() noexcept {
  return __builtin_cpu_supports("avx") ? Lanes::kFour : Lanes::kTwo;
}

Dilation::Sums Dilation::sum_node(const Window& window, int i, int j, std::vector<Pair>& pairs) const {
  pairs.clear();
  each_block(window, i, j, [&](std::size_t on, std::size_t of) {
    pairs.push_back({&window.height[16 * on], &window.boosted[16 * on], &kernel_[of]});
  });
  Sums sums;
  (lanes_ == Lanes::kFour ? sum_four : sum_two)(pairs.data(), pairs.size(), sums);
  return sums;
}

// For a relief of hundreds of t, where e^{h/t} of the tile has no room in a double: the node has its own
// reference, and each term its own exponential.
Dilation::Sums Dilation::sum_slowly(const Window& window, int i, int j, double& reference) const {
  double largest = -INFINITY;
  each_block(window, i, j, [&](std::size_t on, std::size_t of) {
    for (std::size_t k = 0; k < 16; ++k) {
      largest = std::max(largest, window.height[16 * on + k] + kernel_[of].profile[k]);
    }
  });
  Sums sums;
  each_block(window, i, j, [&](std::size_t on, std::size_t of) {
    for (std::size_t k = 0; k < 16; ++k) {
      const double psi = kernel_[of].profile[k];
      const double f = window.height[16 * on + k] + psi - largest;
      if (f < -kLeftOut * t_) continue;
      double weight, moment;
      weight_at(psi, weight, moment);
      const double p = weight * det_exp(f / t_);
      sums.s += p;
      sums.phi += p * f;
      sums.moment += p * moment;
      sums.moment_phi += p * moment * f;
    }
  });
  reference = window.reference + largest;
  return sums;
}

DilatedNode Dilation::fields_of(const Sums& sums, double reference, bool paraboloid) const {
  const double mean_phi = sums.phi / sums.s;
  const double mean = sums.moment / sums.s;
  const double moment = mean + (sums.moment_phi / sums.s - mean * mean_phi) / t_;  // led to t = 0
  const double above = mean_phi + t_;
  DilatedNode node;
  // e^{−H/t} with H above the reference; the area of a sub-sample in S. Of a paraboloid S = 2πR t e^{H/t}
  // on every plane, without c.
  const double log_s = det_log(sums.s * dx_ * dy_ / (kTwoPi * t_)) - above / t_;
  if (paraboloid) {
    const double s2 = std::clamp(moment / (radius_ * radius_), 0.0, 1.0 / (kConeCosine * kConeCosine) - 1.0);
    const double secant = std::sqrt(1.0 + s2);
    node.cosine = 1.0 / secant;
    // R (secant − 1) − R s²/2 without cancellation: secant − 1 = s²/(1 + secant).
    node.height_nm = reference + above + radius_ * s2 * (1.0 / (1.0 + secant) - 0.5);
    node.log_radius = log_s;
  } else {
    node.cosine = std::clamp(moment, kConeCosine, 1.0);
    node.height_nm = reference + above;
    node.log_radius = log_s - det_log(node.cosine);
  }
  return node;
}

// The tip's areas by their normal depth below the top, each shared by the two bins beside it.
double Dilation::pull_off_rise(const std::vector<Pair>& pairs, double height, const DilatedNode& node) const {
  constexpr int kBins = RetractionKernel::kBins;
  alignas(16) float areas[kBins] = {};
  const double per_nm = node.cosine / pull_off_->bin_nm();
  const __m128 scale = _mm_set1_ps(static_cast<float>(per_nm));
  const __m128 top = _mm_set1_ps(static_cast<float>(height * per_nm + RetractionKernel::kBinsAbove));
  const __m128 last = _mm_set1_ps(kBins - 1);
  const __m128 area = _mm_set1_ps(static_cast<float>(dx_ * dy_));
  const __m128 one = _mm_set1_ps(1.0F);
  const __m128 per_radius = _mm_set1_ps(static_cast<float>(paraboloid_ ? 0.0 : 1.0 / radius_));
  const __m128 least_cosine = _mm_set1_ps(static_cast<float>(kConeCosine));
  const auto floats = [](const double* four) {
    return _mm_movelh_ps(_mm_cvtpd_ps(_mm_loadu_pd(four)), _mm_cvtpd_ps(_mm_loadu_pd(four + 2)));
  };
  for (const Pair& pair : pairs) {
    for (int k = 0; k < kBlock * kBlock; k += 4) {
      const __m128 psi = floats(pair.kernel->profile + k);
      const __m128 phi = _mm_add_ps(floats(pair.height + k), psi);
      const __m128 at = _mm_max_ps(_mm_sub_ps(top, _mm_mul_ps(phi, scale)), _mm_setzero_ps());
      auto in = static_cast<unsigned>(_mm_movemask_ps(_mm_cmplt_ps(at, last)));
      if (in == 0) continue;
      // The tip's own area: R/q of what lies below it (weight_at).
      const __m128 cosine = _mm_max_ps(_mm_add_ps(one, _mm_mul_ps(psi, per_radius)), least_cosine);
      const __m128 here = _mm_div_ps(area, cosine);
      const __m128i bins = _mm_cvttps_epi32(at);
      const __m128 beyond = _mm_mul_ps(here, _mm_sub_ps(at, _mm_cvtepi32_ps(bins)));
      alignas(16) int bin[4];
      alignas(16) float less[4], more[4];
      _mm_store_si128(reinterpret_cast<__m128i*>(bin), bins);
      _mm_store_ps(less, _mm_sub_ps(here, beyond));
      _mm_store_ps(more, beyond);
      for (; in != 0; in &= in - 1) {
        const int lane = std::countr_zero(in);
        areas[bin[lane]] += less[lane];
        areas[bin[lane] + 1] += more[lane];
      }
    }
  }
  return pull_off_->log_rise(areas, node.log_radius);
}

// What the ball itself feels, where the paraboloid has met what the ball cannot reach.
DilatedNode Dilation::within_ball(const Window& window, int i, int j, const DilatedNode& node) const {
  const int m = lattice_.m;
  const int from_x = window.first_block_x * kBlock, from_y = window.first_block_y * kBlock;
  const int far = reach_ * kBlock;
  const auto each = [&](const auto& use) {
    for (int dy = -far; dy <= far; ++dy) {
      const int y = j * m + dy - from_y;
      for (int dx = -far; dx <= far; ++dx) {
        const int x = i * m + dx - from_x;
        const std::size_t block =
            static_cast<std::size_t>(y / kBlock) * static_cast<std::size_t>(window.blocks_x) +
            static_cast<std::size_t>(x / kBlock);
        const double across = dx * dx_, along = dy * dy_;
        use(window.height[16 * block + static_cast<std::size_t>(y % kBlock * kBlock + x % kBlock)],
            ball_profile_at(across * across + along * along));
      }
    }
  };
  double highest = -INFINITY;
  each([&](double height, double psi) { highest = std::max(highest, height + psi); });
  Sums sums;
  each([&](double height, double psi) {
    const double f = height + psi - highest;
    if (f < -kLeftOut * t_) return;
    const double n_z = std::max(1.0 + psi / radius_, kConeCosine);
    const double p = det_exp(f / t_) / n_z;
    sums.s += p;
    sums.phi += p * f;
    sums.moment += p * n_z;
    sums.moment_phi += p * n_z * f;
  });
  const DilatedNode ball = fields_of(sums, window.reference + highest, false);
  const double apart = std::fabs(node.height_nm - window.reference - highest) / t_ - 1.0;
  const double flatter = (ball.cosine - node.cosine) / kFlatter - 1.0;
  const double x = std::clamp(std::max(apart, flatter), 0.0, 1.0);
  const double part = x * x * (3.0 - 2.0 * x);
  const auto mixed = [part](double a, double b) { return a + part * (b - a); };
  return {mixed(node.height_nm, ball.height_nm), mixed(node.log_radius, ball.log_radius),
          mixed(node.cosine, ball.cosine)};
}

void Dilation::make_tile(int tile_column, int tile_row, std::vector<DilatedNode>& nodes) const {
  const int i0 = tile_column * kTile, j0 = tile_row * kTile;
  const Nodes tile{i0, j0, std::min(kTile, lattice_.columns - i0), std::min(kTile, lattice_.rows - j0)};
  nodes.resize(static_cast<std::size_t>(tile.nx) * static_cast<std::size_t>(tile.ny));
  make_part(tile, {tile_number(tile_column, tile_row), 0}, tile, nodes.data());
}

// Of each tile, and each part of it, what is wanted: its window's reference is the tile's.
void Dilation::make_rectangle(int first_column, int first_row, int columns, int rows,
                              std::vector<DilatedNode>& nodes) const {
  nodes.resize(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  const Nodes wanted{first_column, first_row, columns, rows};
  if (level_) {
    DilatedNode node;
    make_part({0, 0, 1, 1}, {}, {0, 0, 1, 1}, &node);
    std::fill(nodes.begin(), nodes.end(), node);
    return;
  }
  for (int tj = first_row / kTile; tj <= (first_row + rows - 1) / kTile; ++tj) {
    for (int ti = first_column / kTile; ti <= (first_column + columns - 1) / kTile; ++ti) {
      make_part({ti * kTile, tj * kTile, std::min(kTile, lattice_.columns - ti * kTile),
                 std::min(kTile, lattice_.rows - tj * kTile)},
                {tile_number(ti, tj), 0}, wanted, nodes.data());
    }
  }
}

void Dilation::remember_tiles() {
  extremes_ = std::make_unique<PartExtremes>(static_cast<std::size_t>(tile_columns()) *
                                             static_cast<std::size_t>(tile_rows()));
}

void Dilation::make_part(const Nodes& part, const PartExtremes::Part& id, const Nodes& wanted,
                         DilatedNode* nodes) const {
  const Nodes here = part.common(wanted);
  if (here.nx <= 0 || here.ny <= 0) return;
  // Steep ground: smaller parts have less relief, so that few nodes or none must be summed slowly.
  const bool parts = std::min(part.nx, part.ny) >= 2 * kLeastPart;
  const auto steep = [&](double relief) { return parts && relief > kRoom * t_; };
  const auto by_quarters = [&] {
    const int half_x = part.nx / 2, half_y = part.ny / 2;
    make_part({part.i0, part.j0, half_x, half_y}, id.quarter(0), wanted, nodes);
    make_part({part.i0 + half_x, part.j0, part.nx - half_x, half_y}, id.quarter(1), wanted, nodes);
    make_part({part.i0, part.j0 + half_y, half_x, part.ny - half_y}, id.quarter(2), wanted, nodes);
    make_part({part.i0 + half_x, part.j0 + half_y, part.nx - half_x, part.ny - half_y}, id.quarter(3), wanted,
              nodes);
  };
  PartExtremes::Extremes known;
  if (extremes_ && extremes_->find(id, known) && steep(known.highest - known.lowest)) return by_quarters();
  Window window;
  fill_window(part, id, here, window);
  if (steep(window.relief)) return by_quarters();
  std::vector<Pair> pairs;
  pairs.reserve(static_cast<std::size_t>(2 * reach_ + 1) * static_cast<std::size_t>(2 * reach_ + 1));
  for (int j = here.j0; j < here.j0 + here.ny; ++j) {
    for (int i = here.i0; i < here.i0 + here.nx; ++i) {
      double reference = window.reference;
      Sums sums = sum_node(window, i, j, pairs);
      if (!(sums.s > kLeastSum)) sums = sum_slowly(window, i, j, reference);
      DilatedNode node = fields_of(sums, reference, paraboloid_);
      if (paraboloid_ && 1.0 - node.cosine * node.cosine > kFarFoot * kFarFoot * node.cosine * node.cosine)
        node = within_ball(window, i, j, node);
      if (pull_off_ != nullptr)
        node.log_radius += pull_off_rise(pairs, node.height_nm - window.reference, node);
      nodes[static_cast<std::ptrdiff_t>(j - wanted.j0) * wanted.nx + (i - wanted.i0)] = node;
    }
  }
}

std::vector<DilatedNode> Dilation::make_all(const std::function<void(double)>& made) const {
  std::vector<DilatedNode> all(static_cast<std::size_t>(lattice_.columns) *
                               static_cast<std::size_t>(lattice_.rows));
  if (level_) {
    DilatedNode node;
    make_part({0, 0, 1, 1}, {}, {0, 0, 1, 1}, &node);
    std::fill(all.begin(), all.end(), node);
    return all;
  }
  std::vector<DilatedNode> tile;
  for (int tj = 0; tj < tile_rows(); ++tj) {
    for (int ti = 0; ti < tile_columns(); ++ti) {
      make_tile(ti, tj, tile);
      const int nx = std::min(kTile, lattice_.columns - ti * kTile);
      const int ny = std::min(kTile, lattice_.rows - tj * kTile);
      for (int j = 0; j < ny; ++j) {
        std::copy_n(
            &tile[static_cast<std::size_t>(j * nx)], nx,
            &all[static_cast<std::size_t>(tj * kTile + j) * static_cast<std::size_t>(lattice_.columns) +
                 static_cast<std::size_t>(ti * kTile)]);
      }
      if (made) made(static_cast<double>(tj * tile_columns() + ti + 1) / (tile_rows() * tile_columns()));
    }
  }
  return all;
}

}  // namespace telenano::physics

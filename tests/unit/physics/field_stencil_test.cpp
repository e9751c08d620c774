// The stencils of fields in whatever registers, against the sum that they are, term by term, in long double.
#include "telenano/nve_server/physics/surface/field_stencil.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <vector>

namespace telenano::physics {
namespace {

constexpr int kColumns = 9, kRows = 7;

struct Nodes {
  int lanes;
  std::vector<double> values;
  std::ptrdiff_t stride() const { return kColumns * lanes; }
};

Nodes random_nodes(std::mt19937_64& random, int lanes) {
  std::uniform_real_distribution<double> any(-3.0, 3.0);
  Nodes nodes{lanes, std::vector<double>(static_cast<std::size_t>(kColumns * kRows * lanes))};
  for (double& value : nodes.values) value = any(random);
  return nodes;
}

/// ∂^a/∂x^a ∂^b/∂y^b of the cubic B-spline that B(t) = Σ_k (−1)^k (4 over k) (t + 2 − k)₊³/6 makes of a lane,
/// at (u, v) in the cell of the corner: no weights of ours.
long double spline_at(const double* corner, std::ptrdiff_t stride, int lanes, double u, double v, int a,
                      int b, double inv_x, double inv_y) {
  const auto basis = [](long double t, int order) {
    constexpr int kOver[5] = {1, 4, 6, 4, 1};
    long double sum = 0;
    for (int k = 0; k < 5; ++k) {
      const long double s = t + 2 - k;
      if (!(s > 0)) continue;
      const long double power = order == 0 ? s * s * s / 6 : (order == 1 ? s * s / 2 : s);
      sum += (k % 2 == 0 ? 1 : -1) * kOver[k] * power;
    }
    return sum;
  };
  long double sum = 0;
  for (int j = 0; j < 4; ++j) {
    for (int i = 0; i < 4; ++i) {
      sum += basis(u + 1 - i, a) * basis(v + 1 - j, b) * corner[j * stride + i * lanes];
    }
  }
  return sum * std::pow(static_cast<long double>(inv_x), a) * std::pow(static_cast<long double>(inv_y), b);
}

TEST(FieldStencil, IsTheSplineAndTheChainRule) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  constexpr int kOrderX[6] = {0, 1, 0, 2, 1, 0}, kOrderY[6] = {0, 0, 1, 0, 1, 2};
  for (const StencilKernel* kernel : {&narrow_kernel(), wide_kernel()}) {
    if (!kernel) continue;
    for (int trial = 0; trial < 50; ++trial) {
      const Nodes fine = random_nodes(random, 6), coarse = random_nodes(random, 4);
      const double u[2] = {any(random), any(random)}, v[2] = {any(random), any(random)};
      const double inv_x[2] = {0.9, 0.4}, inv_y[2] = {1.1, 0.5};
      CubicWeights wx[2], wy[2];
      for (int g = 0; g < 2; ++g) {
        wx[g] = cubic_weights(u[g], inv_x[g]);
        wy[g] = cubic_weights(v[g], inv_y[g]);
      }
      // Both levels of one grid, of which the last reaches its last coefficient, and one of another.
      const std::ptrdiff_t last = (kRows - 4) * fine.stride() + (kColumns - 4) * 6;
      StencilLevel levels[3] = {{fine.values.data() + last, fine.stride(), 6, 0, &wx[0], &wy[0]},
                                {fine.values.data() + last, fine.stride(), 6, 3, &wx[0], &wy[0]},
                                {coarse.values.data(), coarse.stride(), 4, 0, &wx[1], &wy[1]}};
      long double jets[3][3][6];  // of level and field
      double finest[6];
      for (int k = 0; k < 3; ++k) {
        levels[k].weight = any(random);
        levels[k].slope_per_nm = any(random) - 0.5;
        levels[k].bend_per_nm2 = any(random) - 0.5;
        const int g = k / 2;
        for (int field = 0; field < 3; ++field) {
          for (int d = 0; d < 6; ++d) {
            jets[k][field][d] =
                spline_at(levels[k].corner + levels[k].first_lane + field, levels[k].stride, levels[k].lanes,
                          u[g], v[g], kOrderX[d], kOrderY[d], inv_x[g], inv_y[g]);
          }
        }
      }
      kernel->one(levels[0].corner, fine.stride(), 6, wx[0], wy[0], finest);
      // Sums of 16 terms of order 3.
      constexpr double kRounding = 1e-13;
      for (int d = 0; d < 6; ++d) EXPECT_NEAR(finest[d], static_cast<double>(jets[0][0][d]), kRounding) << d;
      FieldRows rows;
      constexpr int kPlain[kFieldRows] = {kValue, kX, kY, -1, kXx, kXy, -1, kYy, -1, -1};
      for (int k = 0; k < 3; ++k) {
        kernel->plain(levels[k], rows);
        for (int field = 0; field < 3; ++field) {
          for (int row = 0; row < kFieldRows; ++row) {
            const double expected = kPlain[row] < 0 ? 0.0 : static_cast<double>(jets[k][field][kPlain[row]]);
            EXPECT_NEAR(rows[row][field], expected, kRounding) << "level " << k << " row " << row;
          }
        }
      }
      // F(x, y, z) = Σ w_k(u) F_k with u = z − H_0: second derivatives from w', w'' and the jets.
      kernel->blend(levels, 3, finest, rows);
      for (int field = 0; field < 3; ++field) {
        long double first[3] = {0, 0, 0}, second[3][3] = {};
        const long double grad_u[3] = {-jets[0][0][kX], -jets[0][0][kY], 1};
        const long double hess_u[3][3] = {
            {-jets[0][0][kXx], -jets[0][0][kXy], 0}, {-jets[0][0][kXy], -jets[0][0][kYy], 0}, {0, 0, 0}};
        long double value = 0;
        for (int k = 0; k < 3; ++k) {
          const long double(&f)[6] = jets[k][field];
          const long double grad[3] = {f[kX], f[kY], 0};
          const long double hess[3][3] = {{f[kXx], f[kXy], 0}, {f[kXy], f[kYy], 0}, {0, 0, 0}};
          const long double w = levels[k].weight, w1 = levels[k].slope_per_nm, w2 = levels[k].bend_per_nm2;
          value += w * f[kValue];
          for (int i = 0; i < 3; ++i) {
            first[i] += w * grad[i] + w1 * grad_u[i] * f[kValue];
            for (int j = 0; j < 3; ++j) {
              second[i][j] += w * hess[i][j] + w1 * (grad_u[i] * grad[j] + grad_u[j] * grad[i]) +
                              (w2 * grad_u[i] * grad_u[j] + w1 * hess_u[i][j]) * f[kValue];
            }
          }
        }
        const long double expected[kFieldRows] = {value,        first[0],     first[1],     first[2],
                                                  second[0][0], second[0][1], second[0][2], second[1][1],
                                                  second[1][2], second[2][2]};
        for (int row = 0; row < kFieldRows; ++row) {
          EXPECT_NEAR(rows[row][field], static_cast<double>(expected[row]), 100 * kRounding)
              << "row " << row << " field " << field;
        }
      }
    }
  }
}

// On a processor without AVX there is nothing to compare.
TEST(FieldStencil, TheSameBitsInWhateverRegisters) {
  const StencilKernel* const wide = wide_kernel();
  if (!wide) GTEST_SKIP() << "this processor has no AVX";
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  for (int trial = 0; trial < 2000; ++trial) {
    const Nodes nodes = random_nodes(random, 6);
    const CubicWeights wx = cubic_weights(any(random), 0.9), wy = cubic_weights(any(random), 1.1);
    StencilLevel levels[2];
    for (int k = 0; k < 2; ++k) {
      levels[k] = {nodes.values.data() + k * 6, nodes.stride(),   6, 3 * k, &wx, &wy, any(random),
                   any(random) - 0.5,           any(random) - 0.5};
    }
    double narrow_jet[6], wide_jet[6];
    narrow_kernel().one(levels[0].corner, nodes.stride(), 6, wx, wy, narrow_jet);
    wide->one(levels[0].corner, nodes.stride(), 6, wx, wy, wide_jet);
    EXPECT_EQ(std::memcmp(narrow_jet, wide_jet, sizeof narrow_jet), 0);
    FieldRows narrow_rows, wide_rows;
    for (const StencilLevel& level : levels) {
      narrow_kernel().plain(level, narrow_rows);
      wide->plain(level, wide_rows);
      EXPECT_EQ(std::memcmp(narrow_rows, wide_rows, sizeof narrow_rows), 0);
    }
    narrow_kernel().blend(levels, 2, narrow_jet, narrow_rows);
    wide->blend(levels, 2, narrow_jet, wide_rows);
    EXPECT_EQ(std::memcmp(narrow_rows, wide_rows, sizeof narrow_rows), 0);
  }
}

}  // namespace
}  // namespace telenano::physics

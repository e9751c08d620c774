#include "telenano/nve_server/physics/numerics/cholesky_nine.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <random>

namespace telenano::physics {
namespace {

using Mat9 = CholeskyNine::Mat9;
using Vec9 = CholeskyNine::Vec9;

// Eigen is the oracle. Both solutions solve a system that is A but for some ε of it, so each leaves a rest of some
// ε |A||x|: 9 ε for what nine products round, and as much again for Eigen's.
TEST(CholeskyNine, SolvesAsEigenDoes) {
  constexpr double kEps = std::numeric_limits<double>::epsilon();
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  int solved = 0, refused = 0;
  for (int n = 0; n < 20000; ++n) {
    Mat9 half;
    for (double& x : half.reshaped()) x = normal(random);
    Mat9 a = half * half.transpose();
    if (n % 3 == 0) a.diagonal() *= n % 2 == 0 ? 1e6 : 0.3;  // stiff, and mostly not positive definite
    if (n % 5 == 0) {                                        // blocks that do not know of each other
      a.block<3, 3>(3, 0).setZero();
      a.block<3, 3>(0, 3).setZero();
    }
    Vec9 b;
    for (int i = 0; i < 9; ++i)
      b[i] = (n % 7 == 0 && i < 3) ? 0.0 : normal(random) * std::exp(5 * normal(random));
    if (n % 11 == 0) b[8] = 0;
    const Eigen::LLT<Mat9> eigen(a);
    CholeskyNine own;
    const bool good = own.compute(a);
    ASSERT_EQ(good, eigen.info() == Eigen::Success) << n;
    ++(good ? solved : refused);
    if (!good) continue;
    const Vec9 expected = eigen.solve(b), x = own.solve(b);
    ASSERT_LT((a * x - b).norm(), 9 * kEps * a.norm() * x.norm()) << n;
    ASSERT_LT((a * (x - expected)).norm(), 18 * kEps * a.norm() * x.norm()) << n;
  }
  EXPECT_GT(solved, 10000);
  EXPECT_GT(refused, 1000);
}

TEST(CholeskyNine, ReadsTheLowerTriangleAlone) {
  Mat9 a = 4 * Mat9::Identity();
  a(5, 2) = 1;
  a(2, 5) = std::nan("");
  CholeskyNine own;
  ASSERT_TRUE(own.compute(a));
  const Vec9 x = own.solve(Vec9::Ones());
  EXPECT_DOUBLE_EQ(x[0], 0.25);
  EXPECT_DOUBLE_EQ(x[2], 0.2);  // 4 x2 + x5 = x2 + 4 x5 = 1
  EXPECT_DOUBLE_EQ(x[5], 0.2);
}

}  // namespace
}  // namespace telenano::physics

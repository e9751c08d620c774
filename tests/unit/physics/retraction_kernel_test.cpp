// A ground's pull-off put together from one foot's law: against direct sums over feet of a rigid law, and where
// nothing may change.
#include "telenano/nve_server/physics/surface/retraction_kernel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "telenano/nve_server/physics/potential/retraction.h"

namespace telenano::physics {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kTip = 20;

/// Lennard and Jones' rigid bodies (Bradley): the force over the radius, 2πw at the most, at a gap from where it is
/// greatest.
double bradley(double gap, double) {
  constexpr double kRange = 0.165, kWork = 0.4;
  const double z = std::max(gap + kRange, 0.4 * kRange) / kRange;
  return -2 * kPi * kWork * 4 / 3 * (std::pow(z, -2) - 0.25 * std::pow(z, -8));
}

/// A foot of radius R whose top is `below` under the highest one.
struct Foot {
  double radius, below;
};
void add(const Foot& foot, const RetractionKernel& kernel, float (&areas)[RetractionKernel::kBins]) {
  constexpr int kParts = 64;
  for (int b = 0; b < kParts * RetractionKernel::kBins; ++b) {
    const double depth = (b + 0.5) / kParts * kernel.bin_nm();
    const double at = (depth + foot.below) / kernel.bin_nm() + RetractionKernel::kBinsAbove;
    const int bin = static_cast<int>(at);
    if (bin + 1 >= RetractionKernel::kBins) break;
    const double area = 2 * kPi * foot.radius * kernel.bin_nm() / kParts;
    areas[bin] += static_cast<float>(area * (bin + 1 - at));
    areas[bin + 1] += static_cast<float>(area * (at - bin));
  }
}
double excess(const RetractionKernel& kernel, const std::vector<Foot>& feet) {
  float areas[RetractionKernel::kBins] = {};
  for (const Foot& foot : feet) add(foot, kernel, areas);
  return kernel.log_excess(areas, std::log(feet.front().radius));
}

/// The same by sums over feet, each smoothed by the Gaussian that the kernel has.
double direct_excess(const std::vector<Foot>& feet) {
  double peak = 0, zero = 0, least = 0;
  for (double u = 0.3; u > -0.15; u -= 1e-5) {
    if (bradley(u, 0) < least) least = bradley(u, 0), peak = u;
  }
  for (zero = peak; bradley(zero, 0) < 0; zero -= 1e-5) {
  }
  const double sigma = RetractionKernel::kSmoothing * (peak - zero);
  const auto smooth = [&](double u) {
    double sum = 0, all = 0;
    for (int k = -50; k <= 50; ++k) {
      const double weight = std::exp(-0.5 * k * k / 100.0);
      sum += weight * bradley(u + 0.1 * k * sigma, 0);
      all += weight;
    }
    return sum / all;
  };
  double one = 0, most = 0;
  for (double w = -0.1; w < 0.25; w += 5e-4) {
    double force = 0;
    for (const Foot& foot : feet) force += foot.radius * smooth(w + foot.below);
    most = std::max(most, -force);
    one = std::max(one, -feet.front().radius * smooth(w));
  }
  return std::log(most / one);
}

// Rigid bodies let go within three bins, and what lies beyond the last bin is left out: 0.04 of the logarithm.
TEST(RetractionKernel, IsTheSumOverFeetOfARigidLaw) {
  const RetractionKernel kernel(bradley, kTip);
  ASSERT_TRUE(kernel.active());
  const std::vector<std::vector<Foot>> grounds = {
      {{20, 0}, {20, 0.02}}, {{5, 0}, {20, 0.05}}, {{3, 0}, {10, 0.03}, {10, 0.08}}, {{20, 0}, {20, 0.2}}};
  for (const auto& feet : grounds) {
    const double direct = direct_excess(feet);
    EXPECT_GT(direct, 0.02);
    EXPECT_NEAR(excess(kernel, feet), direct, 0.04) << feet.front().radius << " " << feet.back().below;
  }
}

TEST(RetractionKernel, OneFootIsItself) {
  TipSampleParameters oxide;
  oxide.contact_modulus_gpa = 70;
  oxide.work_of_adhesion_n_m = 0.4;
  const BranchPotential law(TipSampleLaw(oxide), kTip);
  const RetractionKernel kernel = retraction_kernel(law, kTip);
  ASSERT_TRUE(kernel.active());
  for (const double radius : {0.5, 2.0, 7.0, 20.0, 60.0, 200.0}) {
    float areas[RetractionKernel::kBins] = {};
    add({radius, 0}, kernel, areas);
    EXPECT_NEAR(kernel.log_rise(areas, std::log(radius)), 0, 2e-3) << radius;
    // Two feet of one height are one of the sum of their radii, which is what ρ of their sum says.
    float both[RetractionKernel::kBins] = {};
    add({radius, 0}, kernel, both);
    add({radius, 0}, kernel, both);
    EXPECT_NEAR(kernel.log_rise(both, std::log(2 * radius)), 0, 2e-3) << radius;
  }
}

// What lies below lifts the pull-off, the less the lower it lies, and never by more than if it lay at the top.
TEST(RetractionKernel, GroundBelowAddsTheLessTheLowerItLies) {
  TipSampleParameters oxide;
  oxide.contact_modulus_gpa = 70;
  oxide.work_of_adhesion_n_m = 0.4;
  const BranchPotential law(TipSampleLaw(oxide), kTip);
  const RetractionKernel kernel = retraction_kernel(law, kTip);
  double last = std::log(4.0);
  for (const double below : {0.05, 0.1, 0.2, 0.3, 0.5, 0.8}) {
    const double here = excess(kernel, {{5, 0}, {15, below}});
    EXPECT_LT(here, last + 1e-3) << below;
    EXPECT_GT(here, 0) << below;
    last = here;
  }
  EXPECT_LT(last, 0.2);
}

TEST(RetractionKernel, NoAttractionNoKernel) {
  const RetractionKernel hertz([](double gap, double) { return gap < 0 ? -gap : 0.0; }, kTip);
  EXPECT_FALSE(hertz.active());
  EXPECT_EQ(hertz.hash(), 0u);
  const RetractionKernel one(bradley, kTip), again(bradley, kTip), other(bradley, 2 * kTip);
  EXPECT_EQ(one.hash(), again.hash());
  EXPECT_NE(one.hash(), other.hash());
}

}  // namespace
}  // namespace telenano::physics

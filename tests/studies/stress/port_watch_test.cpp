// A spring that is pressed and let go, whose sums are right, and wrong in each way that matters.
#include "tests/studies/stress/port_watch.h"

#include <gtest/gtest.h>

namespace telenano::studies::stress {
namespace {

/// A press of 5 nm by steps of `step_nm`, and back: F = k depth, U = k depth²/2; the sums say `in_part` and `out_part` of what
/// they should, the force is `force_part` of it. True after each step, as a run asks?
bool is_true(double step_nm, double in_part, double out_part, double force_part = 1) {
  constexpr double kStiffness = 10;  // nN/nm
  PortWatch watch(0);
  slave::SlaveOutput output;
  bool right = true;
  const auto go = [&](double z_nm) {
    const double before = output.commanded_pos_w_nm.z();
    const double work = 0.5 * kStiffness * (z_nm * z_nm - before * before);
    (work > 0 ? output.energy_in_aj : output.energy_out_aj) += work > 0 ? in_part * work : -out_part * work;
    output.commanded_pos_w_nm = Vec3(0, 0, z_nm);
    output.force_w_nn = Vec3(0, 0, -force_part * kStiffness * z_nm);
    output.contact_state = z_nm < 0 ? link::ContactState::kContact : link::ContactState::kFree;
    watch.step(output);
    right = right && watch.is_true();
  };
  const auto steps = static_cast<int>(5 / step_nm);
  for (int k = 0; k <= steps; ++k) go(-step_nm * k);
  for (int k = steps; k >= 0; --k) go(-step_nm * k);
  return right;
}

TEST(PortWatch, ASpringsSumsAreItsWork) {
  for (const double step_nm : {0.01, 0.1, 0.4}) EXPECT_TRUE(is_true(step_nm, 1, 1)) << step_nm;
}

TEST(PortWatch, SumsThatSayAnythingElseAreNot) {
  EXPECT_FALSE(is_true(0.02, 1, 0.9)) << "gives what it does not count";
  EXPECT_FALSE(is_true(0.02, 1.1, 1)) << "charges what it does not take";
  EXPECT_FALSE(is_true(0.02, 0, 0)) << "counts nothing";
  EXPECT_FALSE(is_true(0.02, 0.9, 0.9)) << "a tenth less of both";
  EXPECT_FALSE(is_true(0.02, 1, 1, 0.9)) << "a force that is another";
}

// A contact that begins within a step gives what nobody saw between its ends: at most the well.
TEST(PortWatch, ASnapWithinALongStepIsTheWellAtMost) {
  for (const double gives_aj : {7.0, 8.2, 9.0, 20.0}) {
    PortWatch watch(8);
    slave::SlaveOutput output;
    watch.step(output);
    output.commanded_pos_w_nm.z() = -5;
    output.force_w_nn.z() = 0.1;
    output.energy_out_aj = gives_aj;
    output.contact_state = link::ContactState::kContact;
    watch.step(output);
    EXPECT_EQ(watch.is_true(), gives_aj < 8.25) << gives_aj;
  }
}

}  // namespace
}  // namespace telenano::studies::stress

#include <gtest/gtest.h>

#include <time.h>

#include <cmath>
#include <set>

#include "telenano/common/link/messages.h"
#include "telenano/master/app/run/twin_cost.h"

namespace telenano::app {
namespace {

double thread_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

void work_for(double seconds) {
  const double until_s = thread_s() + seconds;
  while (thread_s() < until_s) {
  }
}

/// Ground at z = 0 whose tiles of 10 nm are made, in 5 ms each, when a tip first comes there; a step in contact takes as long as is
/// said.
class TiledTwin final : public control::LocalSlave {
 public:
  explicit TiledTwin(double step_s) : step_s_(step_s) {}

  void step(const control::LocalStep& step, control::LocalAnswer& answer) noexcept override {
    if ((step.flags & link::kFlagClutch) != 0) at_w_nm_ = step.target_w_nm;
    if (made_.insert(static_cast<int>(std::floor(at_w_nm_.x() / 10))).second) work_for(5e-3);
    const bool touches = at_w_nm_.z() < 0;
    if (touches) work_for(step_s_);
    answer.commanded_pos_w_nm = at_w_nm_;
    answer.contact_state =
        static_cast<std::uint32_t>(touches ? link::ContactState::kContact : link::ContactState::kFree);
  }
  void reset() noexcept override { at_w_nm_ = kStart; }
  std::uint64_t state_hash() const noexcept override { return 0; }
  bool load(std::span<const std::uint8_t>, control::LocalAnswer&) noexcept override { return false; }
  std::size_t snapshot_bytes_max() const noexcept override { return 0; }
  double well_aj() const noexcept override { return 0; }
  std::uint64_t scene_hash() const noexcept override { return 0; }

  std::size_t made() const { return made_.size(); }
  bool is_as_new() const { return at_w_nm_ == kStart; }

 private:
  inline static const Vec3 kStart{0, 0, 20};
  double step_s_;
  Vec3 at_w_nm_ = kStart;
  std::set<int> made_;
};

// A station would else refuse the twin of a large scan, for steps that make what all later ones find.
TEST(TwinCost, WhatTheFirstTouchMakesIsNoCostOfAStep) {
  TiledTwin twin(0);
  const double cost_s = twin_step_cost_s(twin, 1000);
  EXPECT_GE(twin.made(), 5u);
  EXPECT_LT(cost_s, 1e-4);  // one tile in a group of ten steps: 5e-4
  EXPECT_TRUE(twin.is_as_new());
}

TEST(TwinCost, WhatEachStepTakesIs) {
  TiledTwin twin(2e-4);
  EXPECT_GE(twin_step_cost_s(twin, 1000), 1.9e-4);
}

}  // namespace
}  // namespace telenano::app

// What browsers may see of a tip: its own values from its first step on, and never those of who had the slot.
#include <gtest/gtest.h>

#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "telenano/nve_server/app/serve/serve_web.h"

namespace telenano::app {
namespace {

class Counted final : public slave::Slave {
 public:
  void step(const slave::SlaveInput&, double, slave::SlaveOutput& output) noexcept override {
    output.tip_pos_w_nm = Vec3(1, 2, 3);
    output.force_w_nn = Vec3(4, 5, 6);
    output.contact_state = link::ContactState::kContact;
    output.fault_bits = 8;
  }
  const slave::SlaveLimits& limits() const noexcept override { return limits_; }
  std::uint64_t state_hash() const noexcept override { return 77; }
  std::size_t snapshot_bytes_max() const noexcept override { return 99; }
  std::shared_ptr<const surface::HeightView> heights() const override { return heights_; }

 private:
  std::shared_ptr<const surface::HeightView> heights_ =
      std::make_shared<surface::HeightView>(surface::HeightGrid{2, 2, 1, 1, 0, 0, {1, 2, 3, 4}});
  slave::SlaveLimits limits_;
};

class WatchedSlaveTest : public testing::Test {
 protected:
  std::unique_ptr<slave::Slave> make() { return make_(); }
  void step(slave::Slave& slave, double dt_s) {
    slave::SlaveOutput output;
    slave.step({}, dt_s, output);
  }
  web::TipView first() const { return slots_->slots()[0].value.load(); }

  std::shared_ptr<web::TipSlots> slots_ = std::make_shared<web::TipSlots>();
  std::function<std::unique_ptr<slave::Slave>()> make_ =
      watched([] { return std::make_unique<Counted>(); }, slots_);
};

TEST_F(WatchedSlaveTest, AFirstStepIsSeenAsItIs) {
  const auto slave = make();
  EXPECT_FALSE(first().moved);
  step(*slave, 0.001);
  const web::TipView seen = first();
  EXPECT_TRUE(seen.moved);
  EXPECT_EQ(seen.tip_pos_w_nm, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(seen.force_w_nn, (std::array<double, 3>{4, 5, 6}));
  EXPECT_EQ(seen.contact_state, 3u);
  EXPECT_EQ(seen.fault_bits, 8u);
  EXPECT_EQ(slave->state_hash(), 77u);  // a step log goes through it
  EXPECT_EQ(slave->snapshot_bytes_max(), 99u);
  ASSERT_TRUE(slave->heights());
  EXPECT_EQ(slots_->slots()[0].heights(), slave->heights()) << "and what it has marked";
}

TEST_F(WatchedSlaveTest, ASlotThatIsTakenAgainHidesWhatWasThere) {
  auto slave = make();
  step(*slave, 0.001);
  ASSERT_TRUE(first().moved);
  slave.reset();
  slave = make();
  EXPECT_TRUE(slots_->slots()[0].taken);
  EXPECT_FALSE(first().moved);
  EXPECT_EQ(first().tip_pos_w_nm, (std::array<double, 3>{}));
}

TEST_F(WatchedSlaveTest, AtMostSixtyAreStoredInASecond) {
  const auto slave = make();
  const std::uint64_t before = slots_->slots()[0].value.count();
  for (int i = 0; i < 4000; ++i) step(*slave, 0.001);  // 4 s
  const std::uint64_t stored = slots_->slots()[0].value.count() - before;
  EXPECT_LE(stored, 240u);
  EXPECT_GE(stored, 230u);  // every 17th millisecond: 4000/17 = 235.3
}

TEST_F(WatchedSlaveTest, TipsBeyondTheSlotsAreServedUnseen) {
  std::vector<std::unique_ptr<slave::Slave>> all;
  for (std::size_t i = 0; i < web::TipSlots::kSlots + 2; ++i) all.push_back(make());
  slave::SlaveOutput output;
  all.back()->step({}, 0.001, output);
  EXPECT_EQ(output.force_w_nn, Vec3(4, 5, 6));
}

}  // namespace
}  // namespace telenano::app

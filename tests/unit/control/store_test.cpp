// What was put in for good must not be at the disposal of whoever turns hostile afterwards: a bounded store.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "telenano/common/control/methods.h"

namespace telenano::control {
namespace {

constexpr double kTick_s = 1e-3;
constexpr double kStore_j = 0.25;
constexpr double kForceMost_n = 9.6;

MethodConfig config(double store_max_j) {
  MethodConfig config;
  config.passivity.allowance_j = 0.01;
  config.passivity.velocity_max_m_s = 0.5;
  config.passivity.damping_certain_n_s_m = 0;
  config.passivity.store_max_j = store_max_j;
  return config;
}

/// A hand and a slave at one method, in virtual ticks along x.
class Port {
 public:
  Port(Method method, double store_max_j) : methods_(method, config(store_max_j)) {
    methods_.now().take_over(0, config(store_max_j), Vec3::Zero());
  }

  /// One tick with the force shown being what is allowed of `force_n`; the hand moves by `moved_m`.
  void tick(double force_n, double moved_m, const SlaveNews& news) {
    StationMethod& method = methods_.now();
    PortInterval interval;
    interval.dt_s = kTick_s;
    interval.applied_force_h_n.x() = shown_n_;
    interval.displacement_h_m.x() = moved_m;
    pos_m_ += moved_m;
    interval.hand_pos_h_m.x() = pos_m_;
    interval.put_in_j = -shown_n_ * moved_m;
    put_in_j_ += interval.put_in_j;
    method.account_for(interval);
    method.on_reply(news);
    const double bound_n = std::min(method.force_bound_n(), kForceMost_n);
    shown_n_ = std::clamp(force_n, -bound_n, bound_n);
  }
  double put_in_j() const { return put_in_j_; }

 private:
  Methods methods_;
  double shown_n_ = 0;
  double pos_m_ = 0;
  double put_in_j_ = 0;
};

/// 2 N of friction, to and fro at 0.1 m/s, until `joules` are dissipated.
void rub(Port& port, double joules) {
  for (int i = 0; port.put_in_j() < joules; ++i) {
    const double way = i / 500 % 2 == 0 ? 1 : -1;
    port.tick(-2 * way, way * 1e-4, {});
  }
}

/// The slave pushes as hard as it may, the hand gives way at 0.46 m/s; and says what it likes of energies.
double taken_by_a_hostile_slave(Port& port) {
  const double before_j = port.put_in_j();
  SlaveNews lies;
  lies.energy_sent_j = lies.energy_out_j = 1;
  for (int i = 0; i < 20'000; ++i) port.tick(kForceMost_n, 0.46e-3, lies);
  return before_j - port.put_in_j();
}

class Store : public ::testing::TestWithParam<Method> {};

// For ever; E₀ is the allowance, and a tank's hand has one more store at the other side, and what the slave
// was granted there.
TEST_P(Store, BoundsWhatIsGivenBackOfWhatWasDissipated) {
  Port port(GetParam(), kStore_j);
  rub(port, 7.4);
  const double taken_j = taken_by_a_hostile_slave(port);
  const double stores = GetParam() == Method::kTank ? 2 : 1;
  EXPECT_LE(taken_j, stores * kStore_j + 2 * 0.01 + 1e-9);
  EXPECT_GT(taken_j, 0.5 * kStore_j) << "what was stored is not withheld";
}

TEST_P(Store, WithoutBoundAllOfItIs) {
  Port port(GetParam(), std::numeric_limits<double>::infinity());
  rub(port, 7.4);
  EXPECT_GT(taken_by_a_hostile_slave(port), 7.0);
}

// A spring of 300 N/m pressed to 9 N stores 0.135 J and has it back whole.
TEST_P(Store, ASpringIsFeltWhole) {
  Port port(GetParam(), kStore_j);
  SlaveNews honest;
  constexpr double kSpring_n_m = 300;
  constexpr int kTicks = 300;
  for (int press = 0; press < 20; ++press) {
    for (int i = 0; i < 2 * kTicks; ++i) {
      const double step_m = i < kTicks ? -1e-4 : 1e-4;
      const double depth_m = 1e-4 * (i < kTicks ? i + 1 : 2 * kTicks - i - 1);
      // A tank's slave sends what the sample gives.
      honest.energy_sent_j = i < kTicks ? 0 : kSpring_n_m * depth_m * 1e-4;
      port.tick(kSpring_n_m * depth_m, step_m, honest);
    }
  }
  EXPECT_GT(port.put_in_j(), -0.02);
  EXPECT_LT(port.put_in_j(), 20 * 0.005) << "what is withheld of a spring would be left in";
}

INSTANTIATE_TEST_SUITE_P(Methods, Store,
                         ::testing::Values(Method::kKsClamp, Method::kTank, Method::kModel, Method::kTwin),
                         [](const auto& method) {
                           std::string name(method_name(method.param));
                           name.erase(std::remove(name.begin(), name.end(), '-'), name.end());
                           return name;
                         });

}  // namespace
}  // namespace telenano::control

#include <gtest/gtest.h>

#include <memory>

#include "telenano/common/control/methods.h"
#include "tests/studies/stress/scenes.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies::stress {
namespace {

using control::Method;

// A stand-in that does what the right method does must change no bit: only then a wrong one shows what its
// fault does.
TEST(StandIn, AFaithfulOneChangesNothing) {
  class Faithful final : public control::StationMethod {
   public:
    explicit Faithful(Method method) : right_(method, {}) {}
    void take_over(double account_j, const control::MethodConfig& c, const Vec3& p) noexcept override {
      right_.now().take_over(account_j, c, p);
    }
    void begin_session(bool epoch) noexcept override { right_.now().begin_session(epoch); }
    void account_for(const control::PortInterval& i) noexcept override { right_.now().account_for(i); }
    void on_reply(const control::SlaveNews& n) noexcept override { right_.now().on_reply(n); }
    Vec3 force_h_n(const control::RenderPoint& at) noexcept override { return right_.now().force_h_n(at); }
    Vec3 damper_force_h_n() const noexcept override { return right_.now().damper_force_h_n(); }
    double damper_n_s_m() const noexcept override { return right_.now().damper_n_s_m(); }
    double force_bound_n() const noexcept override { return right_.now().force_bound_n(); }
    double account_j() const noexcept override { return right_.now().account_j(); }
    void fill_command(control::SlaveOrder& order) const noexcept override {
      right_.now().fill_command(order);
    }

   private:
    control::Methods right_;
  };
  for (const Method method : control::kAllMethods) {
    if (method == Method::kTwin)
      continue;  // without a twin the station takes another method, the stand-in none
    double sums[2] = {0, 0};
    for (const bool stand_in : {false, true}) {
      support::VirtualSessionConfig config;
      config.scene = Scenes::of_this_tree().file(SceneKind::kOxide);
      config.station.method = method;
      config.station.allow_unsafe_scaling = true;
      config.task_options.duration_s = 3;
      config.to_server.delay_ns = config.to_station.delay_ns = 10'000'000;
      if (stand_in) config.make_method = [method] { return std::make_unique<Faithful>(method); };
      support::VirtualSession session(config);
      session.run(4000, [&](const recording::Sample& row) {
        sums[stand_in] =
            1.0000001 * sums[stand_in] + row.hand_force_applied_h_n[2] + row.account_j + row.hand_pos_h_m[2];
      });
    }
    EXPECT_EQ(sums[0], sums[1]) << control::method_name(method);
    EXPECT_NE(sums[0], 0);
  }
}

}  // namespace
}  // namespace telenano::studies::stress

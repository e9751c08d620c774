// A sample that attracts has energy of its own to give: felt as it is, and no more of it believed than there
// is.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "telenano/common/base/random.h"
#include "telenano/common/control/method.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/support/driven_hand.h"
#include "tests/support/virtual_session.h"
#include "tests/support/wall_slave.h"

namespace telenano::studies {
namespace {

using control::Method;

std::shared_ptr<const scene::Scene> scene_of(const std::string& name) {
  return scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/" + name + ".toml");
}

struct Felt {
  double nrmse = 0;        ///< RMS(felt − true)/RMS(true), along the normal, where the true tip touches
  double clamped = 0;      ///< share of those ticks in which the clamp acted
  double most_pull_n = 0;  ///< strongest pull felt
  double true_pull_n = 0;  ///< and true
  std::int64_t ticks = 0;
};

/// The task "indent" by the simulated operator. True is another slave of the same scene, which is stepped
/// along the same commanded path at the station, without link and without control.
Felt indent(const std::shared_ptr<const scene::Scene>& scene, Method method, double rtt_s, double force_scale,
            double depth_nm, double well_max_j = 0.1) {
  support::VirtualSessionConfig config;
  config.scene = scene;
  config.station.method = method;
  config.station.scaling = {1e-6, force_scale};
  config.station.well_max_j = well_max_j;
  config.task = device::Task::kIndent;
  config.task_options.depth_nm = depth_nm;
  config.to_server.delay_ns = config.to_station.delay_ns = std::llround(0.5e9 * rtt_s);
  support::VirtualSession session(config);
  slave::NveSlave local(scene);
  slave::SlaveInput input;
  slave::SlaveOutput output;
  Felt felt;
  double error2 = 0, true2 = 0;
  session.run(60'000, [&](const recording::Sample& row) {
    input.tip_target_pos_w_nm = {row.tip_target_w_nm[0], row.tip_target_w_nm[1], row.tip_target_w_nm[2]};
    local.step(input, 1e-3, output);
    if (output.contact_state != link::ContactState::kContact) return;
    const double true_n = force_scale * 1e-9 * output.force_w_nn.z();
    const double felt_n = row.hand_force_commanded_h_n[2];
    ++felt.ticks;
    error2 += (felt_n - true_n) * (felt_n - true_n);
    true2 += true_n * true_n;
    felt.clamped += (row.limit_flags & recording::kLimitClamp) != 0;
    felt.most_pull_n = std::max(felt.most_pull_n, -felt_n);
    felt.true_pull_n = std::max(felt.true_pull_n, -true_n);
  });
  felt.nrmse = std::sqrt(error2 / true2);
  felt.clamped /= std::max<double>(1, static_cast<double>(felt.ticks));
  return felt;
}

// PDMS pulls the tip in by tens of nanometres: more than E₀ of the hand's joules, none of it made by the
// link.
TEST(Well, PdmsIsFeltAsItIs) {
  const auto scene = scene_of("flat_pdms");
  for (const double force_scale : {2e7, 4e7, 8e7}) {
    for (const Method method : {Method::kTank, Method::kModel}) {
      const Felt felt = indent(scene, method, 0, force_scale, 30);
      ASSERT_GT(felt.ticks, 500);
      EXPECT_LT(felt.nrmse, 0.02) << control::method_name(method) << ' ' << force_scale;
      EXPECT_EQ(felt.clamped, 0) << control::method_name(method) << ' ' << force_scale;
    }
  }
  // Credited with nothing, as a server is that says nothing of a well.
  const Felt untold = indent(scene, Method::kModel, 0, 8e7, 30, 0);
  EXPECT_GT(untold.clamped, 0.1) << "or there was nothing to be credited";
}

// A slave that lies in every sum. Its force is a wall's, up to its limit, but turned with the hand's motion,
// so that whatever the station lets it is given to the hand.
class LyingSlave final : public slave::Slave {
 public:
  enum class Lie { kOutGrows, kOutAtOnce, kBothGrow, kNotFinite };
  LyingSlave(Lie lie, double well_aj) : lie_(lie) {
    limits_.workspace_min_w_nm = Vec3(-300, -300, -50);
    limits_.workspace_max_w_nm = Vec3(300, 300, 100);
    limits_.start_pos_w_nm = Vec3(0, 0, 5);
    limits_.force_max_nn = 600;
    limits_.coupling_stiffness_n_m = 50;
    limits_.well_aj = well_aj;
  }
  void step(const slave::SlaveInput& input, double, slave::SlaveOutput& output) noexcept override {
    const double moved_nm = input.tip_target_pos_w_nm.z() - last_nm_;
    last_nm_ = input.tip_target_pos_w_nm.z();
    if (moved_nm != 0) sign_ = moved_nm > 0 ? 1 : -1;
    switch (lie_) {
      case Lie::kOutGrows:
        out_aj_ += 1e4;
        break;
      case Lie::kOutAtOnce:
        out_aj_ = 1e300;
        break;
      case Lie::kBothGrow:
        in_aj_ += 3e4;
        out_aj_ += steps_ % 2 == 0 ? 7e4 : 0;
        break;
      case Lie::kNotFinite:
        out_aj_ = steps_ % 2 == 0 ? 1.7e308 : std::numeric_limits<double>::infinity();
        break;
    }
    ++steps_;
    output.force_w_nn = Vec3(0, 0, sign_ * 400);
    output.tip_pos_w_nm = output.commanded_pos_w_nm = input.tip_target_pos_w_nm;
    output.contact_state = link::ContactState::kContact;
    output.energy_in_aj = in_aj_;
    output.energy_out_aj = out_aj_;
    output.model = {};
  }
  const slave::SlaveLimits& limits() const noexcept override { return limits_; }

 private:
  Lie lie_;
  slave::SlaveLimits limits_;
  double last_nm_ = 5, sign_ = 1, in_aj_ = 0, out_aj_ = 0;
  std::int64_t steps_ = 0;
};

TEST(Well, AServerThatLiesInEverySumGetsItOnce) {
  using Lie = LyingSlave::Lie;
  for (const Method method : control::kAllMethods) {
    if (!control::claims_energy_bound(method)) continue;
    for (const Lie lie : {Lie::kOutGrows, Lie::kOutAtOnce, Lie::kBothGrow, Lie::kNotFinite}) {
      for (const double well_aj : {0.0, 500.0, 1e12}) {
        for (const int restart_every : {0, 700}) {
          support::AccountedHandConfig hand_config;
          hand_config.device_damping_n_s_m = 0;
          hand_config.velocity_max_m_s = 0.1;
          // To and fro, at each turn with the force: it takes what it is given.
          const auto hand = std::make_shared<support::DrivenHand>(
              hand_config, [](const auto& view) { return view.tick / 200 % 2 == 0 ? -0.010 : 0.010; });
          support::VirtualSessionConfig config;
          config.make_slave = [=] { return std::make_unique<LyingSlave>(lie, well_aj); };
          config.hand = hand;
          config.station.method = method;
          config.station.scaling = {1e-6, 2e7};
          config.station.allow_unsafe_scaling = true;
          config.station.guaranteed_velocity_m_s = config.station.trip_velocity_m_s = 0.1;
          support::VirtualSession session(config);
          bool stopped = false;
          for (int k = 0; k < 5000; ++k) {
            const recording::Sample& row = session.step();
            stopped = stopped || (row.limit_flags & recording::kLimitStop) != 0;
            if (restart_every > 0 && k % restart_every == restart_every - 1) session.restart_server();
          }
          const double well_j =
              method == Method::kKsClamp
                  ? 0
                  : std::min(config.station.scaling.hand_energy_j(well_aj), config.station.well_max_j);
          const double promised_j = (method == Method::kTank ? 2 : 1) * config.station.allowance_j + well_j;
          const std::string what = std::string(control::method_name(method)) + ", lie " +
                                   std::to_string(static_cast<int>(lie)) + ", well " +
                                   std::to_string(well_aj) + " aJ, " + std::to_string(restart_every);
          // Rounding of some thousand terms of a millijoule: far below 1e-12 J.
          EXPECT_LE(hand->account().most_extracted_j(), promised_j + 1e-12) << what;
          EXPECT_GT(hand->account().most_extracted_j(), 0.5 * config.station.allowance_j)
              << what << ": no teeth";
          EXPECT_FALSE(stopped || hand->too_fast()) << what;
        }
      }
    }
  }
}

}  // namespace
}  // namespace telenano::studies

#include "tests/support/view_scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "telenano/common/link/messages.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/station/station.h"

namespace telenano::support {
namespace {

constexpr double kStiffness_n_m = 6;
constexpr double kLever_n_m = 20;

double hill(double x, double y, double x0, double y0, double width, double height) {
  const double r2 = (x - x0) * (x - x0) + (y - y0) * (y - y0);
  return height * std::exp(-r2 / (width * width));
}

}  // namespace

double view_height_nm(double x, double y) {
  const double step = 4 / (1 + std::exp(-(x + 0.4 * y - 480) / 6));
  const double ripple = 0.25 * (1 + std::sin(x / 9) * std::cos(y / 11));
  return hill(x, y, 190, 420, 70, 8) + hill(x, y, 430, 200, 110, 7) + step + ripple;
}

surface::HeightGrid view_scan(int side) {
  surface::HeightGrid grid;
  grid.columns = grid.rows = side;
  grid.dx_nm = grid.dy_nm = 600.0 / side;
  grid.x_first_nm = grid.y_first_nm = 300.0 / side;
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column)
      grid.z_nm.push_back(
          view_height_nm(grid.x_first_nm + column * grid.dx_nm, grid.y_first_nm + row * grid.dy_nm));
  }
  return grid;
}

viewer::ViewFacts view_facts() {
  viewer::ViewFacts facts;
  facts.scene_name = "made by formula";
  facts.device_name = "none";
  facts.hand_force_limit_n = 9.6;
  facts.scene.tip_radius_nm = 20;
  facts.energy_bound_j = 0.010;
  facts.region.impedance_bound.fill(30);
  facts.region.device_force_scale = 4e7;
  facts.region.velocity_min = 2e-8;
  facts.region.velocity_max = 5e-5;
  facts.region.force_min = 2e4;
  facts.method_offered.fill(true);
  return facts;
}

recording::Sample view_sample(std::int64_t tick) {
  const double t = static_cast<double>(tick) * 1e-3;
  const double down = std::clamp(t / 2, 0.0, 1.0);
  const double gap = 30 - 33 * down * down * (3 - 2 * down);
  const double turn = 2 * std::numbers::pi * std::max(t - 2, 0.0) / 8;
  const Vec3 at(300 + 60 * std::cos(turn) - 60 * (1 - down), 300 + 60 * std::sin(turn), 0);
  const double ground = view_height_nm(at.x(), at.y());
  const double pull = -3 * std::exp(-std::abs(gap) / 2);
  const double force = gap < 0 ? -gap * kStiffness_n_m + pull : pull;

  recording::Sample s;
  s.tick = tick;
  s.time_s = t;
  s.tip_pos_w_nm = {at.x(), at.y(), ground + gap};
  s.tip_target_w_nm = {at.x(), at.y(), ground + gap - force / kLever_n_m};
  s.force_w_nn = {0.2 * std::sin(turn) * std::abs(force), 0, force};
  s.deflection_nm = force / kLever_n_m;
  s.velocity_scale = 1e-6;
  s.force_scale = 2e7;
  const double hand = force * 1e-9 * s.force_scale;
  s.hand_force_scaled_h_n = {0, 0, hand};
  s.hand_force_commanded_h_n = {0, 0, std::clamp(hand, -0.35, 0.35)};
  s.hand_force_applied_h_n = {0, 0, std::clamp(hand, -0.30, 0.30)};
  s.energy_j = 1e-3 * (1 - std::cos(turn)) + 2e-4 * down;
  s.damper_n_s_m = gap < 0 ? 1.5 + std::sin(9 * turn) : 0;
  s.reply_sequence = tick + 1;
  s.rtt_us = 180 * std::exp(0.6 * std::sin(1.7 * static_cast<double>(tick % 977)));
  s.lateness_us = 21;
  s.contact_state = static_cast<std::uint32_t>(gap < 0   ? link::ContactState::kContact
                                               : gap < 3 ? link::ContactState::kNonContact
                                                         : link::ContactState::kVanDerWaals);
  s.station_mode = static_cast<std::uint32_t>(station::Mode::kEngaged);
  s.buttons = device::kButtonDeadman;
  s.method = static_cast<std::uint32_t>(control::Method::kModel);
  return s;
}

}  // namespace telenano::support

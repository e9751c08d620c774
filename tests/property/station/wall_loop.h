#pragma once

#include <algorithm>
#include <cmath>
#include <deque>

#include "telenano/master/device/sim_device.h"
#include "telenano/master/station/station.h"

namespace telenano::station {

/// Station, simulated device and hand against a spring wall at z = 0, in virtual time at 1 kHz. The force
/// that answers a command is there `delay_samples` ticks later (0 would need the answer within the tick;
/// loopback UDP is 1).
struct WallLoopConfig {
  control::Method method = control::Method::kNone;
  double wall_n_m = 10'000;  ///< as the hand feels it
  int delay_samples = 1;
  double seconds = 6;
  double depth_m = 0.005;  ///< that the operator intends
  double press_hz = 0;     ///< 0: presses once and holds; else in and out of the wall
  double allowance_j = 0.010;
  device::PlantConfig plant{};
};

struct WallLoopResult {
  double late_speed_rms_m_s = 0;  ///< over the last second
  double late_amplitude_m = 0;    ///< half the range of position over the last second
  double late_force_n = 0;        ///< mean over the last second
  double late_force_peak_n = 0;
  double peak_force_n = 0;
  double calm_after_s = 0;        ///< last time at which the speed exceeded 10 mm/s
  double duty = 0;                ///< part of the ticks in which damper or clamp acted
  double put_in_j = 0;            ///< by the hand, on true positions
  double certain_loss_j = 0;      ///< bΣ|Δx|²/T on true positions
  double least_margin_j = 1e300;  ///< least of put_in + certain_loss + Q over time
  double quantisation_bound_j = 0;
  Mode mode = Mode::kIdle;
};

inline WallLoopResult run_wall_loop(const WallLoopConfig& config) {
  constexpr double kCoupling = 50, kStartNm = 10;
  StationConfig station_config;
  station_config.method = config.method;
  station_config.allowance_j = config.allowance_j;
  station_config.scaling.velocity = 1e-6;
  station_config.scaling.force = config.wall_n_m / kCoupling / station_config.scaling.velocity;

  device::SimDeviceConfig device_config;
  device_config.plant = config.plant;
  device_config.start_height_nm = kStartNm;
  std::vector<device::IntendedMotion::Waypoint> way{{0, Vec3(0, 0, kStartNm)}};
  const double depth_nm = config.depth_m * 1e3;
  if (config.press_hz > 0) {
    for (double t = 1, side = -1; t < config.seconds; t += 0.5 / config.press_hz, side = -side) {
      way.push_back({t, Vec3(0, 0, side * depth_nm)});
    }
  } else {
    way.push_back({1, Vec3(0, 0, -depth_nm)});
  }
  device::SimDevice device(device_config, device::IntendedMotion(way));
  Station station(station_config, device.info(), {kCoupling, 0, 1000});
  link::Welcome welcome;
  welcome.start_pos_w_nm = Vec3(0, 0, kStartNm);
  station.begin_session(welcome);
  device.start_motion();

  WallLoopResult result;
  StationInput input;
  StationOutput output;
  input.session_up = true;
  std::deque<double> way_back_nm(static_cast<std::size_t>(std::max(1, config.delay_samples)), kStartNm);
  link::Reply reply;
  Vec3 last_m = device.plant().pos_m();
  double low_m = 1, high_m = -1, speed2 = 0, force = 0;
  int late = 0, acted = 0;
  const int ticks = static_cast<int>(config.seconds * 1e3);
  for (int k = 0; k < ticks; ++k) {
    device::DeviceReading reading;
    device.read(reading);
    input.time_ns += 1'000'000;
    input.hand_pos_h_m = reading.hand_pos_h_m;
    input.buttons = reading.buttons;
    const double z_nm = way_back_nm.front();
    way_back_nm.pop_front();
    ++reply.sequence;
    reply.tip_pos_w_nm.z() = z_nm;
    reply.force_w_nn.z() = z_nm < 0 ? -kCoupling * z_nm : 0;
    input.reply = &reply;
    station.step(input, 1e-3, output);
    way_back_nm.push_back(output.command.tip_pos_w_nm.z());
    input.applied_force_h_n = device.write_force(output.hand_force_h_n);
    device.advance(1'000'000);

    const Vec3 pos_m = device.plant().pos_m();
    const Vec3 moved_m = pos_m - last_m;
    last_m = pos_m;
    result.put_in_j -= input.applied_force_h_n.dot(moved_m);
    result.certain_loss_j += config.plant.device_damping_n_s_m * moved_m.squaredNorm() / 1e-3;
    result.least_margin_j = std::min(
        result.least_margin_j, result.put_in_j + result.certain_loss_j + output.trace.quantisation_bound_j);
    const double speed = std::fabs(device.plant().vel_m_s().z());
    const double force_n = input.applied_force_h_n.norm();
    result.peak_force_n = std::max(result.peak_force_n, force_n);
    if (speed > 0.01) result.calm_after_s = (k + 1) * 1e-3;
    acted += output.trace.clamped || output.trace.damper_n_s_m > 0;
    if (k >= ticks - 1000) {
      ++late;
      speed2 += speed * speed;
      force += force_n;
      result.late_force_peak_n = std::max(result.late_force_peak_n, force_n);
      low_m = std::min(low_m, pos_m.z());
      high_m = std::max(high_m, pos_m.z());
    }
  }
  result.late_speed_rms_m_s = std::sqrt(speed2 / late);
  result.late_amplitude_m = (high_m - low_m) / 2;
  result.late_force_n = force / late;
  result.duty = static_cast<double>(acted) / ticks;
  result.quantisation_bound_j = output.trace.quantisation_bound_j;
  result.mode = station.mode();
  return result;
}

}  // namespace telenano::station

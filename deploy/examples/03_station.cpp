// A station of one's own: a simulated hand presses on the sample of a running server, in real time.
//
// usage: 03_station HOST:PORT      (telenano-nve serve, or example 04)
#include "run_station.h"
#include "telenano/common/base/error.h"
#include "telenano/master/device/sim_device.h"

using namespace telenano;

int main(int argc, char** argv) try {
  if (argc != 2) throw UserError("usage: 03_station HOST:PORT");
  station::StationConfig config;  // documented defaults: 1 mm of the hand is 1 nm, 50 nN are 1 N
  std::optional<device::SimDevice> hand;
  double strongest_n = 0;
  double strongest_nn = 0;
  example::run_station(
      argv[1], config,
      [&](const link::Welcome& slave) -> device::HapticDevice& {
        device::SimDeviceConfig device_config;
        device_config.metres_per_nm = config.scaling.hand_displacement_m(Vec3::UnitX()).x();
        device_config.start_height_nm = slave.start_pos_w_nm.z() - slave.surface_z_w_nm;
        device::TaskOptions task;
        task.start_height_nm = device_config.start_height_nm;
        task.duration_s = 4;
        hand.emplace(device_config, device::IntendedMotion::for_task(device::Task::kIndent, task));
        return *hand;
      },
      [&](const recording::Sample& sample) {
        if (sample.station_mode == static_cast<std::uint32_t>(station::Mode::kEngaged)) hand->start_motion();
        strongest_n = std::max(strongest_n, sample.hand_force_applied_h_n[2]);
        strongest_nn = std::max(strongest_nn, sample.force_w_nn[2]);
        return hand->motion_time_s() < hand->motion_duration_s() && sample.time_s < 30;
      });
  std::printf("tip %.1f nN, hand %.2f N\n", strongest_nn, strongest_n);
  return strongest_nn > 0 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 2;
}

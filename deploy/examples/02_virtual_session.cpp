// A whole session in virtual time: station, simulated hand, server and scene, over a link with 20 ms of
// round trip and 1 % loss. No socket, thread or clock: the same numbers at every run.
//
// usage: 02_virtual_session SCENE.toml
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "telenano/common/base/error.h"
#include "telenano/master/device/sim_device.h"
#include "telenano/master/loop/station_loop.h"
#include "virtual_network.h"

using namespace telenano;

int main(int argc, char** argv) try {
  if (argc != 2) throw UserError("usage: 02_virtual_session SCENE.toml");
  net::SimPath path;
  path.delay_ns = 10'000'000;
  path.loss = 0.01;
  example::VirtualNetwork network(path, scene::load_scene(argv[1]));
  link::ClientSession session(link::ClientConfig{});
  network.establish(session);
  const link::Welcome& slave = session.welcome();

  // The hand presses for ten seconds and lets go.
  station::StationConfig config;
  device::SimDeviceConfig device_config;
  device_config.metres_per_nm = config.scaling.hand_displacement_m(Vec3::UnitX()).x();
  device_config.start_height_nm = slave.start_pos_w_nm.z() - slave.surface_z_w_nm;
  device::TaskOptions task;
  task.start_height_nm = device_config.start_height_nm;
  device::SimDevice hand(device_config, device::IntendedMotion::for_task(device::Task::kIndent, task));
  station::Station station(config, hand.info(),
                           {slave.coupling_stiffness_n_m, slave.coupling_damping_n_s_m, slave.force_max_nn});
  loop::StationLoop loop(hand, network.link.a(), network.link.address_b(), session, station);
  recording::Sample sample;
  double push_nn = 0, pull_nn = 0, strongest_n = 0;
  while (hand.motion_time_s() < hand.motion_duration_s()) {
    if (station.mode() == station::Mode::kEngaged) hand.start_motion();
    loop.tick(network.now_ns, 1e-9 * example::kTickNs, sample);
    push_nn = std::max(push_nn, sample.force_w_nn[2]);
    pull_nn = std::max(pull_nn, -sample.force_w_nn[2]);
    strongest_n = std::max(strongest_n, std::abs(sample.hand_force_applied_h_n[2]));
    hand.advance(example::kTickNs);
    network.pass_a_tick();
  }
  const std::uint64_t lost = network.link.counts_a_to_b().lost + network.link.counts_b_to_a().lost;
  std::printf("%.1f s: tip pushed %.1f nN and pulled %.1f nN, hand %.2f N, lost datagrams %llu\n",
              1e-9 * static_cast<double>(network.now_ns), push_nn, pull_nn, strongest_n,
              static_cast<unsigned long long>(lost));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 1;
}

#pragma once
// What examples 03 and 05 share: a session of one device with a server, in real time.
#include <atomic>
#include <csignal>
#include <cstdio>
#include <optional>

#include "telenano/common/rt/periodic_timer.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/master/connection/connect.h"
#include "telenano/master/loop/station_loop.h"

namespace example {

inline std::atomic<bool> stop{false};

/// `begin(welcome)` makes the device once the slave is known; `each(sample)` after every tick, false ends the
/// session.
template <class Begin, class Each>
void run_station(const std::string& server_text, const telenano::station::StationConfig& config, Begin begin,
                 Each each) {
  using namespace telenano;
  std::signal(SIGINT, [](int) { stop = true; });
  connection::ServerAccess access;
  access.server = server_text;
  const net::Address server = net::parse_address(server_text, "the server");
  connection::ServerLink way(access, server);
  link::ClientConfig client;
  client.rate_hz = static_cast<std::uint32_t>(config.rate_hz);
  client.nonce_seed = connection::random_nonce_seed();
  link::ClientSession session(client);
  connection::connect(session, way, server, config.rate_hz, access, stop);

  const link::Welcome& slave = session.welcome();
  device::HapticDevice& device = begin(slave);
  station::Station station(config, device.info(),
                           {slave.coupling_stiffness_n_m, slave.coupling_damping_n_s_m, slave.force_max_nn});
  const rt::SteadyClock clock;
  loop::StationLoop loop(device, way.datagram(), server, session, station, &clock);
  rt::PeriodicTimerConfig timer_config;
  timer_config.period_ns = static_cast<std::int64_t>(1e9 / config.rate_hz);
  rt::PeriodicTimer timer(timer_config);
  recording::Sample sample;
  std::int64_t last_ns = clock.now_ns();
  while (!stop && each(sample)) {
    const std::int64_t now_ns = timer.wait().woke_ns;
    device.advance(now_ns - last_ns);
    loop.tick(now_ns, 1e-9 * static_cast<double>(now_ns - last_ns), sample);
    last_ns = now_ns;
  }
  loop.say_bye(link::ByeReason::kDone);
}

}  // namespace example

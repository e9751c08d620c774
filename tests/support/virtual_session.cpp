#include "tests/support/virtual_session.h"

#include <array>
#include <cmath>
#include <span>

#include "telenano/common/base/error.h"
#include "telenano/master/twin/scene_twin.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::support {

VirtualSession::VirtualSession(const VirtualSessionConfig& config)
    : config_(config),
      link_(config.to_server, config.to_station, config.seed, config.link_capacity),
      client_([&] {
        link::ClientConfig c;
        c.rate_hz = static_cast<std::uint32_t>(config.station.rate_hz);
        c.nonce_seed = config.seed;
        c.resume_token = config.resume_token;
        c.redundancy = config.redundancy;
        if (config.twin) {
          c.step_ring = static_cast<std::size_t>(4 * config.station.rate_hz);
          c.snapshot_bytes = 4 << 20;
        }
        return c;
      }()) {
  period_ns_ = std::llround(1e9 / config_.station.rate_hz);
  now_ns_ = config_.start_ns;
  link_.advance_to(now_ns_);
  clock_.advance_to(now_ns_);
  if (config_.port != 0) {
    net::Address address = link_.address_a();
    address.port = config_.port;
    link_.set_address_a(address);
  }
  scene_hash_ = config_.scene ? config_.scene->hash : config_.scene_hash;
  if (config_.server) {
    server_ = config_.server;
  } else {
    make_server();
  }

  // The handshake, before there is a station: its limits come with the Welcome.
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  client_.start(now_ns_);
  for (int i = 0; i < 100000 && client_.state() != link::ClientState::kEstablished; ++i) {
    net::Received received;
    while (link_.a().receive(buffer, received))
      client_.on_datagram(std::span(buffer).first(received.size), now_ns_);
    if (const std::size_t n = client_.poll(now_ns_, buffer)) {
      link_.a().send(std::span<const std::uint8_t>(buffer).first(n), link_.address_b());
    }
    serve_until(now_ns_ + period_ns_);
    now_ns_ += period_ns_;
  }
  if (client_.state() != link::ClientState::kEstablished)
    throw RunError("the virtual session was not established");

  const link::Welcome& welcome = client_.welcome();
  if (!config_.hand) make_device(welcome);
  device::HapticDevice& device = config_.hand ? static_cast<device::HapticDevice&>(*config_.hand) : *device_;
  station_ = std::make_unique<station::Station>(
      config_.station, device.info(),
      station::SlavePort{welcome.coupling_stiffness_n_m, welcome.coupling_damping_n_s_m,
                         welcome.force_max_nn},
      config_.make_method ? config_.make_method() : nullptr);
  if (config_.twin) {
    station::TwinRunConfig twin;
    twin.rate_hz = config_.station.rate_hz;
    twin.look_s = config_.twin_look_s;
    const auto make = [&]() -> std::unique_ptr<control::LocalSlave> {
      if (config_.make_twin) return config_.make_twin();
      return std::make_unique<twin::SceneTwin>(config_.scene);
    };
    station_->use_twin(std::make_unique<station::TwinRun>(twin, make(), make()));
  }
  loop_ = std::make_unique<loop::StationLoop>(device, link_.a(), link_.address_b(), client_, *station_,
                                              nullptr, config_.link_options);
  loop_->set_tip_wish(config_.tip_wish);
}

void VirtualSession::make_device(const link::Welcome& welcome) {
  device::SimDeviceConfig device_config;
  device_config.plant = config_.plant;
  device_config.plant.period_s = static_cast<double>(period_ns_) * 1e-9;
  device_config.metres_per_nm = config_.station.scaling.hand_displacement_m(Vec3::UnitX()).x();
  device_config.start_height_nm = welcome.start_pos_w_nm.z() - welcome.surface_z_w_nm;
  config_.task_options.start_height_nm = device_config.start_height_nm;
  device_ = std::make_unique<device::SimDevice>(
      device_config, config_.task == device::Task::kScript
                         ? device::IntendedMotion(config_.script)
                         : device::IntendedMotion::for_task(config_.task, config_.task_options));
}

void VirtualSession::make_server() {
  server::ServerConfig config;
  ++servers_made_;
  config.secret = link::SipKey{config_.seed, servers_made_};
  // One station and what it may leave behind: the server looks through all slots in every tick.
  config.table.capacity = 8;
  server::ServedScene served;
  if (config_.scene) {
    config.table.timeout_ns = config_.scene->session_timeout_ms * std::int64_t{1'000'000};
    served.name = server::scene_name(config_.scene->name);
  }
  served.hash = scene_hash_;
  config.share = config_.share;
  config.snapshot_bytes_most = config_.snapshot_bytes_most;
  if (config_.make_slave) {
    served.make_slave = config_.make_slave;
  } else {
    served.make_slave = slave::nve_slaves(config_.scene);
  }
  std::vector<server::ServedScene> scenes;
  if (first_scene_hash_ != 0) {
    scenes.push_back(served);
    scenes.back().hash = first_scene_hash_;
    scenes.back().name = server::scene_name("another");
  }
  scenes.push_back(std::move(served));
  server_ = std::make_shared<server::Server>(config, std::move(scenes));
  down_ = false;
}

void VirtualSession::restart_server() {
  make_server();
}

void VirtualSession::stop_server(int ms) {
  std::array<std::uint8_t, link::kMaxDatagramBytes> out;
  net::Address to;
  while (const std::size_t n = server_->next_bye(now_ns_, out, to))
    link_.b().send(std::span<const std::uint8_t>(out).first(n), to);
  for (int i = 1; i <= ms; ++i) server_->poll(now_ns_ + i * std::int64_t{1'000'000});
  down_ = true;
}

void VirtualSession::serve_until(std::int64_t until_ns) {
  std::array<std::uint8_t, link::kMaxDatagramBytes> in;
  std::array<std::uint8_t, link::kMaxDatagramBytes> out;
  for (std::int64_t arrival = link_.next_arrival_ns(); arrival < until_ns;
       arrival = link_.next_arrival_ns()) {
    link_.advance_to(arrival);
    clock_.advance_to(server_ns(arrival));
    net::Received received;
    bool any = false;
    while (link_.b().receive(in, received)) {
      any = true;
      bytes_up_ += received.size;
      ++datagrams_up_;
      if (down_) continue;
      std::size_t n = server_->on_datagram(std::span(in).first(received.size), received.from,
                                           server_ns(arrival), out, &clock_, config_.standing);
      if (n > 0 && config_.lie) n = config_.lie(out, n);
      if (n > 0) link_.b().send(std::span<const std::uint8_t>(out).first(n), received.from);
    }
    if (!any && link_.next_arrival_ns() <= arrival) break;  // only the station's datagrams are waiting
  }
  link_.advance_to(until_ns);
  clock_.advance_to(server_ns(until_ns));
  if (!down_) server_->poll(server_ns(until_ns));
}

std::int64_t VirtualSession::server_ns(std::int64_t now_ns) const noexcept {
  std::int64_t drifted_ns = 0;
  if (config_.server_drift_ppm != 0)
    drifted_ns = std::llround(config_.server_drift_ppm * 1e-6 * static_cast<double>(now_ns));
  return now_ns + drifted_ns + server_ahead_ns_;
}

const recording::Sample& VirtualSession::step(int periods) {
  if (!motion_started_ && station_->mode() == station::Mode::kEngaged) {
    motion_started_ = true;
    config_.hand ? config_.hand->start_motion() : device_->start_motion();
  }
  loop_->tick(now_ns_, since_last_tick_ns_ > 0 ? 1e-9 * static_cast<double>(since_last_tick_ns_) : period_s(),
              sample_);
  since_last_tick_ns_ = periods * period_ns_;
  for (int i = 0; i < periods; ++i) {
    serve_until(now_ns_ + period_ns_);
    config_.hand ? config_.hand->advance(period_ns_) : device_->advance(period_ns_);
    now_ns_ += period_ns_;
  }
  return sample_;
}

std::int64_t VirtualSession::run(std::int64_t max_ticks,
                                 const std::function<void(const recording::Sample&)>& each) {
  std::int64_t ticks = 0;
  while (ticks < max_ticks && !done()) {
    step();
    ++ticks;
    if (each) each(sample_);
  }
  return ticks;
}

}  // namespace telenano::support

#include "tests/studies/bench/served.h"

#include <random>

#include "telenano/common/rt/realtime_thread.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::studies {
namespace {

server::ServerConfig config_of(std::size_t capacity) {
  std::random_device device;
  server::ServerConfig config;
  config.secret = {(static_cast<std::uint64_t>(device()) << 32) | device(), device()};
  config.table.capacity = capacity;
  config.table.timeout_ns = 3'600'000'000'000;  // while the others are measured, nobody speaks here
  config.openings_per_s = 1e6;
  config.challenges_per_s = 1e6;
  return config;
}

server::ServedScene served_scene(std::shared_ptr<const scene::Scene> scene) {
  server::ServedScene served;
  served.name = server::scene_name(scene->name);
  served.hash = scene->hash;
  served.make_slave = slave::nve_slaves(std::move(scene));
  return served;
}

}  // namespace

Served::Served(std::shared_ptr<const scene::Scene> scene, int cpu, bool busy_poll, std::size_t capacity,
               int priority)
    : socket_(net::Udp::listen(net::parse_address("127.0.0.1:0", "bench"), {.arrival_times = false})),
      batch_(socket_),
      server_(config_of(capacity), served_scene(std::move(scene))),
      thread_(std::make_unique<PinnedThread>(cpu, [this, busy_poll, priority](const std::atomic<bool>& stop) {
        if (priority > 0) rt::enter_realtime({.priority = priority});
        server::LoopOptions options;
        options.busy_poll = busy_poll;
        server::run_loop(
            server_, batch_, clock_, [this](std::int64_t t) { batch_.wait(t); }, stop, options, status_);
      })) {}

}  // namespace telenano::studies

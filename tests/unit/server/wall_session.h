#pragma once

#include <memory>

#include "tests/support/wall_slave.h"
#include "virtual_session.h"

namespace telenano::server {

inline ServedScene wall_scene() {
  ServedScene scene;
  scene.hash = 7;
  scene.name = scene_name("wall");
  scene.make_slave = [] { return std::make_unique<support::WallSlave>(support::WallSlaveConfig{}); };
  return scene;
}

/// A session that logs its steps, 20 ticks after its first Hello.
struct LoggingSession {
  LoggingSession() {
    s.client.start(0);
    s.ticks(20);
  }
  bool logs() const { return (s.client.features() & link::kFeatureStepLog) != 0; }

  Server server{test_config(), wall_scene()};
  VirtualSession s{&server, config(), net::SimPath{}, net::SimPath{}, 1};

 private:
  static link::ClientConfig config() {
    link::ClientConfig c;
    c.step_ring = 4000;
    return c;
  }
};

}  // namespace telenano::server

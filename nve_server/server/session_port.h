#pragma once

#include <cstdint>
#include <memory>

#include "common/link/session_table.h"
#include "common/net/datagram.h"
#include "nve_server/server/port_control.h"
#include "nve_server/slave/slave.h"

namespace telenano::server {

/// What stands behind a session of the table: its slave, what that said last, and where its station is.
struct SessionPort {
  std::unique_ptr<slave::Slave> slave;
  slave::SlaveOutput output;
  PortControl control;
  net::Address address;
  std::int64_t last_step_ns = 0;
  Vec3 last_target_w_nm = Vec3::Zero();  ///< of the newest command
};

/// A whole session on its way from one worker to another.
struct SessionParcel {
  link::Session session;
  SessionPort port;
};

}  // namespace telenano::server

#pragma once

#include "telenano/common/link/messages.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::slave {

/// What a command's flags tell a slave: here, and nowhere else, so that the server and a twin of its slave
/// tell it the same. `operates`: its sender may move the tip; `was_up`: the last output said that the tip is
/// withdrawn. A tip that is up is not where the station left it: it follows nothing until the station has
/// been told that it is back, and where.
inline SlaveInput input_of(const Vec3& target_w_nm, const Vec3& vel_w_nm_s, std::uint32_t flags,
                           bool operates, bool was_up) noexcept {
  constexpr std::uint32_t kEngaged = link::kFlagClutch | link::kFlagDeadman;
  SlaveInput input;
  input.tip_target_pos_w_nm = target_w_nm;
  input.tip_target_vel_w_nm_s = vel_w_nm_s;
  input.retract = operates && (flags & link::kFlagStop) != 0;
  input.by_operator = input.retract;
  input.wanted = operates && !input.retract && (flags & kEngaged) == kEngaged;
  input.follow = input.wanted && !was_up;
  return input;
}

}  // namespace telenano::slave

#pragma once

#include <cstdint>

#include "telenano/common/link/messages.h"

namespace telenano::studies {

/// What every station of a measurement does: at 1 kHz down from 20 nm above the surface to 6 nm into it and
/// 50 nm aside, and back, in four seconds; each a little later than the one before.
struct Motion {
  Vec3 start_w_nm = Vec3::Zero();  ///< x, y of the start, z of the surface there
  bool model = false;              ///< runs the method `model`, with every feature

  static Motion of(const link::Welcome& welcome, bool model) {
    Motion motion{welcome.start_pos_w_nm, model};
    motion.start_w_nm.z() = welcome.surface_z_w_nm;
    return motion;
  }
  void fill(link::Command& command, std::int64_t tick) const {
    const double phase = static_cast<double>(tick % 4000) / 2000;
    const double up = phase < 1 ? phase : 2 - phase;
    command.flags = link::kFlagClutch | link::kFlagDeadman;
    command.tip_pos_w_nm = start_w_nm + Vec3(50 * up, 20 * up, 20 - 26 * up);
    command.tip_vel_w_nm_s = (phase < 1 ? 0.5 : -0.5) * Vec3(50, 20, -26);
    command.energy_in_j = 1e-6;
    command.energy_out_j = 1e-7;
    if (!model) return;
    command.control.method = link::kMethodModel;
    command.control.energy_scale_aj_j = 1e12;
  }
};

}  // namespace telenano::studies

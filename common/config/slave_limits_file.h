#pragma once

#include <string>

#include "telenano/common/base/vec3.h"

namespace telenano::config {

/// What a station must know of a slave to plan its scaling, as the handshake's Welcome says it; as a file
/// (TOML, keys named as here, vectors as arrays) so that it can be planned for without a server.
struct SlaveLimits {
  std::string scene_name;
  std::string scene_hash;  ///< 16 hexadecimal digits
  Vec3 workspace_min_w_nm = Vec3::Zero();
  Vec3 workspace_max_w_nm = Vec3::Zero();
  Vec3 start_pos_w_nm = Vec3::Zero();
  double surface_z_w_nm = 0;
  double force_max_nn = 0;
  double coupling_stiffness_n_m = 0;  ///< of the port: coupling in series with the probe
  double coupling_damping_n_s_m = 0;
  double well_aj = 0;  ///< deepest adhesive well; may be left out of the file: 0, none or not known
  double rate_max_hz = 0;
};

/// Numbers with all their digits: what is read back is the same, bit for bit.
std::string slave_limits_text(const SlaveLimits& limits);
void write_slave_limits(const SlaveLimits& limits, const std::string& path);  ///< throws RunError

/// Throw UserError, with file, line and key, for what is missing, unknown or out of range.
SlaveLimits load_slave_limits(const std::string& path);
SlaveLimits parse_slave_limits(std::string content, const std::string& name);

}  // namespace telenano::config

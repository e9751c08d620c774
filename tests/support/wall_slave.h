#pragma once

#include <memory>

#include "telenano/nve_server/slave/slave.h"

namespace telenano::support {

/// What a wall slave did, for who made it: the slave itself lives in the server.
struct WallWatch {
  double commanded_z_w_nm = 0;  ///< end that it holds now
  double force_nn = 0;          ///< on the tip now
  double most_force_nn = 0;     ///< ever
  double energy_in_aj = 0;      ///< of the newest slave
  double energy_out_aj = 0;     ///< likewise
  double taken_in_aj = 0;  ///< in less out, of all slaves made: what was stored in one that died was lost
  int made = 0;
};

struct WallSlaveConfig {
  double stiffness_n_m = 50;
  double force_max_nn = 600;   ///< the slave's own limit: the tip goes no deeper than where the force is this
  double start_height_nm = 5;  ///< above the wall
  double retract_speed_nm_s = 1000;
  Vec3 workspace_min_w_nm{-300, -300, -50};
  Vec3 workspace_max_w_nm{300, 300, 100};
};

/// A slave that can be computed by hand: a wall at z = 0, F_z = k max(0, −z) on the commanded end itself, no
/// coupling, no mass, no damping, no friction.
///
/// At this port the position is held and the force varies, so its work is the change of ½ k z², exactly and
/// on any path: a positive change is energy in, a negative one energy out. In and out differ by what is
/// stored, never less than zero.
///
/// Its local model is learned by touching, as a microscope's would be: none before the first touch, the wall
/// from then on.
class WallSlave final : public slave::Slave {
 public:
  explicit WallSlave(const WallSlaveConfig& config, std::shared_ptr<WallWatch> watch = nullptr);

  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override;
  const slave::SlaveLimits& limits() const noexcept override { return limits_; }
  std::uint64_t state_hash() const noexcept override;
  std::size_t save(std::span<std::uint8_t> out) const noexcept override;
  bool load(std::span<const std::uint8_t> bytes) noexcept override;
  bool say_again(slave::SlaveOutput& output) noexcept override;
  std::size_t snapshot_bytes_max() const noexcept override { return 128; }

 private:
  void say(std::uint32_t faults, bool finite, slave::SlaveOutput& output) const noexcept;
  WallSlaveConfig config_;
  slave::SlaveLimits limits_;
  std::shared_ptr<WallWatch> watch_;
  Vec3 commanded_w_nm_;
  bool touched_ = false;
  double stored_aj_ = 0;
  double energy_in_aj_ = 0;
  double energy_out_aj_ = 0;
};

}  // namespace telenano::support

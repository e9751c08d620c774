#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::support {

/// What the server's slave was really told, step by step: the executed log.
struct ExecutedStep {
  slave::SlaveInput input;
  double dt_s = 0;
  Vec3 force_w_nn = Vec3::Zero();
  std::uint64_t hash = 0;  ///< after it
};
using ExecutedLog = std::vector<ExecutedStep>;

/// The server's slave, with a recorder at its port.
class LoggedSlave final : public slave::Slave {
 public:
  LoggedSlave(std::shared_ptr<const scene::Scene> scene, std::shared_ptr<ExecutedLog> log)
      : slave_(std::move(scene)), log_(std::move(log)) {}
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    slave_.step(input, dt_s, output);
    log_->push_back({input, dt_s, output.force_w_nn, slave_.state_hash()});
  }
  const slave::SlaveLimits& limits() const noexcept override { return slave_.limits(); }
  std::uint64_t state_hash() const noexcept override { return slave_.state_hash(); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return slave_.save(out); }
  bool load(std::span<const std::uint8_t> bytes) noexcept override { return slave_.load(bytes); }
  void reset() noexcept override { slave_.reset(); }
  std::size_t snapshot_bytes_max() const noexcept override { return slave_.snapshot_bytes_max(); }

 private:
  slave::NveSlave slave_;
  std::shared_ptr<ExecutedLog> log_;
};

}  // namespace telenano::support

#pragma once

#include <memory>

#include "telenano/common/control/local_slave.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::twin {

/// The slave of a scene, at the station: told by each step what the server tells its own
/// (slave/logged_step.h), so that the two are the same to the bit. Between the two trees: master/ knows the
/// seam alone (common/control/local_slave.h), nve_server/ knows nothing of stations.
class SceneTwin final : public control::LocalSlave {
 public:
  explicit SceneTwin(std::shared_ptr<const scene::Scene> scene);
  /// `ground`: of the same scene, found once for several twins.
  SceneTwin(std::shared_ptr<const scene::Scene> scene, const slave::PortGround& ground);

  void step(const control::LocalStep& step, control::LocalAnswer& answer) noexcept override;
  std::uint64_t state_hash() const noexcept override { return slave_.state_hash(); }
  void reset() noexcept override;
  bool load(std::span<const std::uint8_t> bytes, control::LocalAnswer& answer) noexcept override;
  std::size_t snapshot_bytes_max() const noexcept override { return slave_.snapshot_bytes_max(); }
  double well_aj() const noexcept override { return slave_.limits().well_aj; }
  std::uint64_t scene_hash() const noexcept override { return scene_->hash; }
  std::shared_ptr<const surface::HeightView> heights() const override { return slave_.heights(); }

 private:
  std::shared_ptr<const scene::Scene> scene_;
  slave::NveSlave slave_;
  slave::SlaveOutput output_;
};

}  // namespace telenano::twin

#pragma once

#include <memory>

#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/afm/afm_slave.h"
#include "tests/support/virtual_afm.h"

namespace telenano::support {

/// An AFM slave with its logic and a simulated controller behind it, all in one virtual time: that of the
/// steps. For whole sessions in virtual time, and for what every slave must do.
class VirtualAfmSlave final : public slave::Slave {
 public:
  /// `ready`: an AFM that has approached.
  explicit VirtualAfmSlave(const VirtualAfm& ready);

  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override;
  const slave::SlaveLimits& limits() const noexcept override { return slave_.limits(); }
  VirtualAfm& afm() noexcept { return afm_; }
  /// Time without steps.
  void idle(double dt_s) noexcept;

 private:
  VirtualAfm afm_;
  rt::VirtualClock clock_;
  std::shared_ptr<afm::AfmExchange> exchange_ = std::make_shared<afm::AfmExchange>();
  afm::AfmSlave slave_;
  afm::PortTarget wish_;
};

/// Approaches; throws RunError if that does not end above the surface.
VirtualAfm approached(const afm::AfmConfig& config, const afm_sim::SimConfig& rig,
                      const std::shared_ptr<const scene::Scene>& scene, std::uint64_t seed = 1);

}  // namespace telenano::support

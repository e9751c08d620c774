#pragma once

#include <memory>

#include "telenano/common/rt/clock.h"
#include "telenano/nve_server/afm/afm_config.h"
#include "telenano/nve_server/afm/afm_exchange.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::afm {

/// What a station may know of an AFM: its workspace about the surface that was found.
slave::SlaveLimits limits_of(const AfmConfig& config) noexcept;

/// An AFM behind the slave's port. A step only exchanges: the target goes to the controller's thread, what is
/// known of the tip comes back. Between readings the force is that of the local model at the base's present
/// place; measurement_age_ns says how old the last reading is, from the middle of its averaging.
///
/// The latch. After a withdrawal (but for want of a session) the tip stays up until an operator clears it: by
/// a stop that is sent and then released, or by a new session with the right to operate, once it wants to
/// engage. The server's own retract on silence clears nothing. A tip that is up comes back only for an
/// operator who wants to engage; meanwhile the output says so (link::kFaultRetracted,
/// link::kFaultApproaching), shows no force, and no target is followed.
///
/// One slave for all sessions (SlaveInput::opening tells them apart): there is one tip.
class AfmSlave final : public slave::Slave {
 public:
  AfmSlave(const AfmConfig& config, std::shared_ptr<AfmExchange> exchange, const rt::Clock& clock);

  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override;
  const slave::SlaveLimits& limits() const noexcept override { return limits_; }
  const PortState& state() const noexcept { return state_; }

 private:
  void publish(std::uint32_t fault_bits, const slave::SlaveInput& input, slave::SlaveOutput& output) noexcept;

  double lever_n_m_;
  double threshold_factor_ = 4;
  slave::SlaveLimits limits_;
  double lag_nm_;
  std::shared_ptr<AfmExchange> exchange_;
  const rt::Clock& clock_;
  PortTarget wish_;
  PortState state_;
  bool wanted_ = false;
  std::uint64_t opening_ = 0;  // of the session that wanted to engage last
  bool stopped_ = false;
  double energy_in_aj_ = 0;
  double energy_out_aj_ = 0;
};

}  // namespace telenano::afm

#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/nve_server/afm/afm_config.h"
#include "telenano/nve_server/afm/afm_port.h"

namespace telenano::afm {

/// A controller and its rig as the suite sees them, in virtual time: bytes, and the truth, which comes from
/// the rig and never from an answer.
class PortDevice {
 public:
  virtual ~PortDevice() = default;
  virtual void advance_to(std::int64_t now_ns) = 0;
  virtual void request(Role role, const std::vector<std::uint8_t>& bytes, std::int64_t now_ns) = 0;
  /// What has come on this connection by then; empty: nothing yet.
  virtual std::vector<std::uint8_t> answer(Role role, std::int64_t now_ns) = 0;
  virtual double height_nm() const = 0;  ///< of the base, as the piezo stands: AfmPort's heights
  virtual Vec3 across_nm() const = 0;    ///< its x and y, as told
  virtual double force_nn() const = 0;   ///< away from the sample positive
};

/// What every adapter must do, with a device that it speaks to: one line for each thing that it does not.
/// The device stands withdrawn, its feedback off, above a sample that its feedback can find.
std::vector<std::string> conformance_faults(AfmPort& port, PortDevice& device, const AfmConfig& config);

}  // namespace telenano::afm

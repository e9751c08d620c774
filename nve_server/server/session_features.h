#pragma once

#include <cmath>

#include "telenano/common/link/messages.h"
#include "telenano/common/link/session_table.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::server {

/// The slave moves by logged steps, each made once and in order, and not by the newest command.
inline bool logs_steps(const link::Session& session) noexcept {
  return (session.feature_bits & link::kFeatureStepLog) != 0;
}

/// Does the station render the contact itself, from the model or by its twin?
inline bool wants_model(const link::Session& session, const link::Command& command) noexcept {
  return (session.feature_bits & link::kFeatureLocalModel) != 0 &&
         (command.control.method == link::kMethodModel || command.control.method == link::kMethodTwin);
}

inline bool has_well(const slave::SlaveLimits& limits) noexcept {
  return limits.well_aj > 0 && std::isfinite(limits.well_aj);
}

}  // namespace telenano::server

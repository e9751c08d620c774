#pragma once

#include <cstdint>
#include <string_view>

namespace telenano::control {

/// How the port is kept passive. The names are the same in flags, configuration, CSV and recordings.
enum class Method : std::uint8_t { kNone, kKs, kKsClamp, kTdpa, kWave, kTank, kModel };

/// "none | ks | ks-clamp | tdpa | wave | tank | model"
std::string_view method_name(Method method) noexcept;

/// Throws UserError for an unknown name, and for a known one that this build does not have yet.
Method parse_method(std::string_view name);

bool method_available(Method method) noexcept;

/// Does it promise that no hand slower than v_max extracts more than the allowances, whatever the network and
/// the other side do? Such a method commits no force that it could not pay for.
bool claims_energy_bound(Method method) noexcept;

}  // namespace telenano::control

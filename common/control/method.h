#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace telenano::control {

/// How the port is kept passive. The names are the same in flags, configuration, CSV and recordings.
enum class Method : std::uint8_t { kNone, kKs, kKsClamp, kTdpa, kWave, kTank, kModel, kTwin };

/// The name in flags, files and recordings; "unknown" for a value out of range.
std::string_view method_name(Method method) noexcept;

/// Nothing for an unknown name.
std::optional<Method> find_method(std::string_view name) noexcept;

/// Throws UserError for an unknown name; the line lists method_list().
Method parse_method(std::string_view name);

/// "none, ks, ... or twin", for an error's one line.
std::string method_list();

inline constexpr std::array<Method, 8> kAllMethods = {Method::kNone,  Method::kKs,   Method::kKsClamp,
                                                      Method::kTdpa,  Method::kWave, Method::kTank,
                                                      Method::kModel, Method::kTwin};

/// Does it promise that no hand slower than v_max extracts more than the allowances, whatever the network and
/// the other side do? Such a method commits no force that it could not pay for.
constexpr bool claims_energy_bound(Method method) noexcept {
  return method == Method::kKsClamp || method == Method::kTank || method == Method::kModel ||
         method == Method::kTwin;
}

/// Needs the slave's port to take part (energies or waves in both directions).
constexpr bool needs_port_control(Method method) noexcept {
  return method == Method::kTdpa || method == Method::kWave || method == Method::kTank;
}

}  // namespace telenano::control

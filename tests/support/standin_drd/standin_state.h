#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace telenano::support {

/// Calls of the stand-in that can be made to stall or fail.
enum class DrdCall : std::uint32_t {
  kOpen,
  kGetPosition,
  kSetForce,
  kGetForce,
  kGetStatus,
  kGetButtonMask,
  kCount
};

/// What the stand-in for the Force Dimension SDK shares with a test, in a mapped file: the test writes the
/// upper part at any time, the library the lower one.
struct StandinState {
  template <class T>
  using Shared = std::atomic<T>;
  static constexpr std::size_t kCalls = static_cast<std::size_t>(DrdCall::kCount);

  // The script.
  Shared<int> devices{1};
  Shared<int> serial{4711};                  ///< of device 0; the next ones count up
  Shared<int> unplugged{0};                  ///< every call fails
  std::array<Shared<int>, kCalls> result{};  ///< when not 0: what the call returns instead of doing anything
  std::array<Shared<int>, kCalls> stall_us{};  ///< the next call of it takes so long
  Shared<double> pos_d_m[3]{};
  /// Not 0: the handle is a free mass that moves under the force, from `pos_d_m` on; else it is where
  /// `pos_d_m` says.
  Shared<double> mass_kg{0};
  Shared<double> damping_n_s_m{0};
  Shared<double> friction_n{0};
  Shared<double> held_n_m{0};            ///< stiffness of whoever holds it where it began
  Shared<double> reported_force_n[3]{};  ///< what dhdGetForce says when `lie_about_force`
  Shared<int> lie_about_force{0};
  Shared<int> time_guard{0};       ///< positions come back with code 1
  Shared<double> saturation_n{0};  ///< on the norm; 0 = none
  Shared<double> force_max_n{-1};
  Shared<unsigned> buttons{0};
  Shared<int> power{1};
  Shared<int> error{0};
  Shared<int> calibrated{1};
  Shared<int> force_off_cause{0};  ///< not 0: the device cuts its force for this cause
  Shared<int> refuse_watchdog{0};
  Shared<int> refuse_gravity{0};
  Shared<int> refuse_auto_init{0};

  // What was done.
  std::array<Shared<std::uint64_t>, kCalls> calls{};
  Shared<double> force_n[3]{};       ///< that the motors show now
  Shared<double> first_force_n{-1};  ///< norm of the first command
  Shared<int> open{0};               ///< how many are open now
  Shared<int> stopped{0};
  Shared<int> force_enabled{0};
  Shared<int> gravity{0};
  Shared<int> watchdog_units{0};
  Shared<int> auto_inits{0};
  Shared<std::int64_t> last_force_ns{0};      ///< CLOCK_MONOTONIC of the last command
  Shared<std::int64_t> watchdog_fired_ns{0};  ///< when the watchdog took the force away; 0: it has not

  Shared<int>& result_of(DrdCall call) { return result[static_cast<std::size_t>(call)]; }
  Shared<int>& stall_of(DrdCall call) { return stall_us[static_cast<std::size_t>(call)]; }
  Shared<std::uint64_t>& calls_of(DrdCall call) { return calls[static_cast<std::size_t>(call)]; }
};

/// Name of the environment variable that names the mapped file.
inline constexpr const char* kStandinVariable = "TELENANO_STANDIN_DRD";

}  // namespace telenano::support

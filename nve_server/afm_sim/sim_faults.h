#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "telenano/nve_server/afm_sim/sim_config.h"

namespace telenano::afm_sim {

enum class FaultKind : std::uint8_t {
  kSilent,    ///< requests wait, unread, until it is over
  kReset,     ///< all connections are reset at once
  kGarbage,   ///< the next reply on every port is noise
  kSlow,      ///< replies come later by delay_ns
  kSensor,    ///< the photodiode or what reads it, from then on
  kWithdraw,  ///< the next `count` withdrawals are answered and not carried out, or end half way
  kDip,       ///< the deflection's signal is depth_nm too low
};

struct Fault {
  std::int64_t at_ns = 0;
  FaultKind kind = FaultKind::kSilent;
  std::int64_t length_ns = 0;
  std::int64_t delay_ns = 0;
  SensorFault sensor = SensorFault::kNone;
  double depth_nm = 0;
  WithdrawFault withdraw = WithdrawFault::kUndone;
  int count = 0;  ///< negative: all from then on
};

/// "silent 500ms", "reset", "garbage", "slow 2s 50ms" (for two seconds, each reply 50 ms late), "sensor
/// frozen" (or high, low, noisy, inverted, swapped, good), "dip 8nm 12ms" (-8nm: too high instead), "withdraw
/// undone 3" (or half; a number up to 1000, or ever); before it may stand when it begins: "@5s silent 500ms".
/// Throws UserError, naming `what`.
Fault parse_fault(const std::string& text, const std::string& what);

/// Faults of any kind and of 1 ms to 10 s (log-uniform) at a mean rate, for as long as `duration_s`.
std::vector<Fault> random_faults(std::uint64_t seed, double per_minute, double duration_s);

}  // namespace telenano::afm_sim

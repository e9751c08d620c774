#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "telenano/nve_server/afm/afm_config.h"
#include "telenano/nve_server/afm_sim/sim_config.h"

namespace telenano::studies {

/// What may happen while an AFM indents.
enum class AfmFault : std::uint8_t {
  kLinkCut,        ///< no command comes any more
  kServerKilled,   ///< the guard is left
  kSilent,         ///< the controller does not answer, 1 ms to 10 s
  kReset,          ///< of all connections
  kGarbage,        ///< instead of the next reply on each
  kSlow,           ///< replies come late, by 1 to 100 ms, for as long
  kControllerCut,  ///< nothing reaches the controller, 1 ms to 10 s: only its own SafeTip is left
};
inline constexpr int kAfmFaults = 7;
const char* fault_name(AfmFault fault) noexcept;

struct FaultTrial {
  AfmFault fault = AfmFault::kLinkCut;
  double at_s = 0;        ///< into the indent
  double length_s = 0;    ///< of silence, slowness or cut
  double peak_nn = 0;     ///< greatest force on the tip from the fault on
  double over_nn = 0;     ///< of it above the limit, 0 at least
  double allowed_nn = 0;  ///< (one step + drift · outage) · stiffness
  bool must_withdraw = false;
  double withdrawn_after_s = -1;  ///< since the controller could be reached; negative: it was not
  bool safe_tip = false;          ///< the controller protected itself
};

/// An indent that the force limit ends, again and again from the same approach, with one fault each, at a
/// random moment; in virtual time, real logic against the simulated controller.
std::vector<FaultTrial> run_fault_trials(const afm::AfmConfig& config, const afm_sim::SimConfig& rig,
                                         int trials, std::uint64_t seed);

std::string fault_csv(const std::vector<FaultTrial>& trials);
/// A table: a row for each fault.
std::string fault_section(const std::vector<FaultTrial>& trials, const afm::AfmConfig& config);

}  // namespace telenano::studies

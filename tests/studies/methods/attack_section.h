#pragma once

#include <string>
#include <vector>

#include "tests/studies/methods/adversary.h"

namespace telenano::studies {

/// Every method, round trip and channel; spread over the cores.
std::vector<WorstAttack> run_attacks(const std::vector<control::Method>& methods,
                                     const std::vector<double>& rtt_ms, bool quick, std::uint64_t seed);

std::string attack_csv(const std::vector<WorstAttack>& attacks);

/// Tables for the page.
std::string attack_section(const std::vector<WorstAttack>& attacks);

/// Those that promise a bound and were found beyond it.
std::vector<const WorstAttack*> broken_promises(const std::vector<WorstAttack>& attacks);

}  // namespace telenano::studies

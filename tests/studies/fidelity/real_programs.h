#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tests/studies/fidelity/fidelity_grid.h"

namespace telenano::studies::fidelity {

struct RealLink {
  double rtt_ms = 100;
  double loss = 0.02;  ///< each way
};

/// The real programs on this machine: telenano-nve serve, the relay with that link, and telenano-master run
/// with the simulated hand, its motion from a file. What was felt comes from the station's recording, which
/// stays in `folder`; the truth is the same slave, built here from the scene's file and told the steps that
/// passed the relay and that the server executed (without a log of steps: the path that the station
/// commanded, by the recorded length of each tick). `method`: as --method, "auto" too. Throws RunError, one
/// line with what a program said, where one fails.
CellResult run_real(const SceneMotion& motion, const std::string& method, const RealLink& link,
                    const ScenePairs& scenes, const std::filesystem::path& folder);

}  // namespace telenano::studies::fidelity

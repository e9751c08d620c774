#pragma once

#include <filesystem>
#include <string>

namespace telenano::studies::stress {

struct StressBenchOptions {
  std::filesystem::path scenes;  ///< folder of the scenes' files
  int rounds = 5;
  double seconds = 25;  ///< of session, of a block
};

/// Steps of the whole loop a second:
/// `quantity,scene,hand,method,threads,value,of_processor_time,target,holds`.
///
/// A step is one tick of a session and all that is looked at: hand and device by this folder's integrator,
/// station (observer, method, limits), command to bytes, link, bytes to command, server and slave, the reply
/// back likewise, the true accounts and all invariants, figures and hash; for `press` (a task) besides the same
/// sample felt locally, a second slave. Set-up and handshake of the run are in it.
///
/// `steps_per_s`, millions on one core: the median over the rounds, cases taking turns; by the clock on the
/// wall and by the thread's processor time, which other work on the machine spoils less. `scaling`: the same
/// runs on one and on two threads in turns, time over time, median; its of_processor_time is processor time
/// of a step on one thread over that on two: below 1 threads get into each other's way.
std::string stress_bench_csv(const StressBenchOptions& options);

}  // namespace telenano::studies::stress

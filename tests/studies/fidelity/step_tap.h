#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/step_log.h"

namespace telenano::studies::fidelity {

/// Reads the datagrams of one session on their way and keeps the log of steps: by their numbers the server
/// executes them, each once, whichever of the copies arrives (PROTOCOL.md, section 15). It asks neither
/// station nor server.
class StepTap {
 public:
  /// `up`: from the station. What is no datagram of the protocol is passed over.
  void see(std::span<const std::uint8_t> bytes, bool up);

  /// Step 1 first, as far as the server has said that it executed them.
  /// Throws RunError, one line, where the log is not what the server's state is made of: a declared break, a
  /// second epoch, a step that did not pass here.
  std::vector<link::LoggedStep> executed() const;

 private:
  link::Codec codec_;
  link::Incoming incoming_;
  std::vector<std::optional<link::LoggedStep>> steps_;  // by number less one
  link::StepReport last_;
  std::uint64_t epoch_ = 0;
  bool other_epoch_ = false;
};

}  // namespace telenano::studies::fidelity

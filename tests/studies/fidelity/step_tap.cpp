#include "tests/studies/fidelity/step_tap.h"

#include <fmt/format.h>

#include <algorithm>

#include "telenano/common/base/error.h"

namespace telenano::studies::fidelity {
namespace {
constexpr std::uint64_t kStepsMost = 10'000'000;  // hours: more is no log of a test
}

void StepTap::see(std::span<const std::uint8_t> bytes, bool up) {
  if (codec_.decode(bytes, incoming_) != link::DropCause::kNone) return;
  if (!up) {
    if (incoming_.type != link::MessageType::kReply) return;
    if (incoming_.reply.steps.executed >= last_.executed) last_ = incoming_.reply.steps;
    return;
  }
  if (incoming_.type != link::MessageType::kCommand) return;
  if (epoch_ == 0) epoch_ = incoming_.command.epoch;
  if (epoch_ != incoming_.command.epoch) other_epoch_ = true;
  const link::StepBatch& batch = incoming_.steps;
  if (batch.count == 0 || batch.first + batch.count > kStepsMost) return;
  steps_.resize(std::max<std::size_t>(steps_.size(), batch.first + batch.count - 1));
  for (std::size_t i = 0; i < batch.count; ++i) steps_[batch.first - 1 + i] = batch.step[i];
}

std::vector<link::LoggedStep> StepTap::executed() const {
  if (other_epoch_) throw RunError("the server began anew: its slave is not that of one log");
  if (last_.breaks > 0)
    throw RunError(fmt::format("the server declared {} breaks of the log, the last at step {} for reason {}",
                               last_.breaks, last_.break_step, last_.break_reason));
  std::vector<link::LoggedStep> log;
  for (std::size_t i = 0; i < std::min<std::size_t>(steps_.size(), last_.executed); ++i) {
    if (!steps_[i]) throw RunError(fmt::format("step {} did not pass the relay", i + 1));
    log.push_back(*steps_[i]);
  }
  return log;
}

}  // namespace telenano::studies::fidelity

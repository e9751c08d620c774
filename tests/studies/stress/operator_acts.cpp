#include "tests/studies/stress/operator_acts.h"

#include <array>
#include <cmath>

namespace telenano::studies::stress {

OperatorActs::OperatorActs(const RunSpec& spec, station::Station& station, StressHand& hand)
    : act_(spec.act),
      method_(spec.method),
      scaling_(station.config().scaling),
      station_(station),
      hand_(hand) {}

void OperatorActs::change_scale(double velocity, double force) noexcept {
  station_.change_scaling({scaling_.velocity * velocity, scaling_.force * force});
}

void OperatorActs::step(double t_s) noexcept {
  if (act_ == Act::kNone) return;
  const double since_s = t_s - kActEveryS * done_;
  const bool holds = done_ > 0 && since_s < kClutchS;
  if (act_ == Act::kClutch) hand_.hold_buttons(holds ? std::uint32_t{device::kButtonClutch} : 0u);
  if (act_ == Act::kStop) {
    hand_.hold_buttons(0);
    if (!holds) station_.clear_stop();
  }
  if (since_s < kActEveryS) return;
  ++done_;
  const bool odd = done_ % 2 == 1;
  switch (act_) {
    case Act::kScale:
      return change_scale(odd ? 1 / kRescale : 1, odd ? kRescale : 1);
    case Act::kImpedance:
      return change_scale(1, odd ? kWeaker : 1);
    case Act::kMethod: {
      using control::Method;
      const std::array<Method, 4> turn = {method_, Method::kTank, Method::kModel, Method::kKsClamp};
      return station_.change_method(turn[static_cast<std::size_t>(done_) % turn.size()]);
    }
    case Act::kClutch:
      return hand_.hold_buttons(device::kButtonClutch);
    case Act::kStop:
      return hand_.hold_buttons(device::kButtonStop);
    case Act::kNone:
      return;
  }
}

}  // namespace telenano::studies::stress

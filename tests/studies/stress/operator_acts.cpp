#include "tests/studies/stress/operator_acts.h"

#include <array>
#include <cmath>
#include <limits>

namespace telenano::studies::stress {
namespace {

/// Goes aside and back, whatever pushes: the height of the tip it leaves alone.
class SidewaysHand final : public support::VirtualHand {
 public:
  SidewaysHand() {
    info_.name = "sideways hand";
    info_.force_max_n = 12;
    info_.damping_n_s_m = 2;
    info_.mass_kg = 0.25;
    info_.workspace_radius_m = 1;
  }
  const device::DeviceInfo& info() const noexcept override { return info_; }
  void read(device::DeviceReading& reading) noexcept override {
    reading.status = device::DeviceStatus::kOk;
    const double part = kHz * time_s_ - std::floor(kHz * time_s_);
    reading.hand_pos_h_m = {kWayM * (4 * std::fabs(part - 0.5) - 1), 0, 0};
    reading.buttons = device::kButtonDeadman;
  }
  Vec3 write_force(const Vec3& force_h_n) noexcept override { return force_h_n; }
  void advance(std::int64_t dt_ns) noexcept override { time_s_ += 1e-9 * static_cast<double>(dt_ns); }
  void start_motion() noexcept override {}

 private:
  static constexpr double kWayM = 0.005, kHz = 0.7;
  double time_s_ = 0;
  device::DeviceInfo info_;
};

constexpr std::uint16_t kRivalPort = 4243;

}  // namespace

OperatorActs::OperatorActs(const RunSpec& spec, support::VirtualSession& session, StressHand& hand)
    : spec_(spec),
      act_(spec.act),
      method_(spec.method),
      scaling_(session.station().config().scaling),
      chosen_(scaling_),
      session_(session),
      station_(session.station()),
      hand_(hand) {
  if (act_ != Act::kTakeOver) return;
  support::VirtualSessionConfig rival;
  rival.server = session.shared_server();
  rival.start_ns = session.now_ns();
  rival.port = kRivalPort;
  rival.seed = spec.seed + 1;
  rival.hand = std::make_shared<SidewaysHand>();
  rival.station = session.station().config();
  rival.tip_wish = link::kFlagHandOver;
  rival_ = std::make_unique<support::VirtualSession>(rival);
}

/// Colgate and Brown's condition, b > KT/2 + |B|, without any delay, of what the slave's coupling is in the hand.
bool OperatorActs::too_stiff(const control::Scaling& scaling) const noexcept {
  const link::Welcome& slave = session_.client().welcome();
  const double shown =
      0.5 * slave.coupling_stiffness_n_m / spec_.rate_hz + std::fabs(slave.coupling_damping_n_s_m);
  return spec_.scale <= 1 && scaling.impedance() * shown > spec_.damping_n_s_m;
}

void OperatorActs::change_scale(double velocity, double force) noexcept {
  const control::Scaling before = station_.config().scaling;
  const control::Scaling wanted{scaling_.velocity * velocity, scaling_.force * force};
  control::Scaling used = wanted;
  if (spec_.mutant == Mutant::kStationOldScale) used = before;
  if (spec_.mutant == Mutant::kStationOldForce) used.force = before.force;
  if (station_.change_scaling(used)) {
    chosen_ = wanted;
    changed_now_ = rescaled_now_ = true;
    accepted_too_stiff_ = accepted_too_stiff_ || too_stiff(wanted);
    return;
  }
  ++refused_;
  const control::Scaling& after = station_.config().scaling;
  refusal_changed_ = refusal_changed_ || after.velocity != before.velocity || after.force != before.force;
}

/// The wishes as the two operators' buttons set them: one asks for the tip, the other leaves it.
void OperatorActs::take_over(bool rival) noexcept {
  session_.loop().set_tip_wish(rival ? link::kFlagHandOver : link::kFlagTakeOver);
  rival_->loop().set_tip_wish(rival ? link::kFlagTakeOver : link::kFlagHandOver);
  rivals_turn_ = rival;
}

double OperatorActs::quiet_s(double t_s) const noexcept {
  if (act_ == Act::kNone || done_ == 0) return std::numeric_limits<double>::infinity();
  const bool holds = act_ == Act::kClutch || act_ == Act::kStop || act_ == Act::kTakeOver;
  return t_s - kActEveryS * done_ - (holds ? kClutchS : 0);
}

void OperatorActs::step(double t_s) noexcept {
  changed_now_ = rescaled_now_ = false;
  if (act_ == Act::kNone) return;
  const double since_s = t_s - kActEveryS * done_;
  const bool holds = done_ > 0 && since_s < kClutchS;
  if (act_ == Act::kClutch) hand_.hold_buttons(holds ? std::uint32_t{device::kButtonClutch} : 0u);
  if (act_ == Act::kStop) {
    hand_.hold_buttons(0);
    if (!holds) {
      station_.clear_stop();
      stopped_ = false;
    }
  }
  if (act_ == Act::kTakeOver) {
    handed_over_ += station_.holds_tip() != held_;
    held_ = station_.holds_tip();
    if (!holds) take_over(false);
  }
  if (since_s < kActEveryS) return;
  ++done_;
  const bool odd = done_ % 2 == 1;
  switch (act_) {
    case Act::kScale:
      return change_scale(odd ? 1 / kRescale : 1, odd ? kRescale : 1);
    case Act::kImpedance:
      if (spec_.scale <= 1) change_scale(1, kTooStrong);  // refused, where it is too stiff
      return change_scale(1, odd ? kWeaker : 1);
    case Act::kMethod: {
      using control::Method;
      const std::array<Method, 4> turn = {method_, Method::kTank, Method::kModel, Method::kKsClamp};
      changed_now_ = true;
      return station_.change_method(turn[static_cast<std::size_t>(done_) % turn.size()]);
    }
    case Act::kClutch:
      return hand_.hold_buttons(device::kButtonClutch);
    case Act::kStop:
      stopped_ = true;
      return hand_.hold_buttons(device::kButtonStop);
    case Act::kTask: {
      control::CompandingConfig companding = station_.config().companding;
      companding.gain = odd ? most_gain(spec_) : 1;
      changed_now_ = true;
      station_.change_companding(companding);
      return;
    }
    case Act::kTakeOver:
      return take_over(true);
    case Act::kNone:
      return;
  }
}

}  // namespace telenano::studies::stress

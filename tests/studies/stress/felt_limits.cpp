#include "tests/studies/stress/felt_limits.h"

#include <algorithm>
#include <cmath>

#include "tests/studies/stress/invariants.h"

namespace telenano::studies::stress {
namespace {

/// A lateral force below this is not judged: a hand notices some hundredths of a newton.
constexpr double kLateralJudgedN = 0.02;

/// A wall by hand has no scene to fetch, and so no twin: the station falls back.
bool has_twin(const RunSpec& spec) noexcept {
  return spec.method == control::Method::kTwin && spec.scene != SceneKind::kWall;
}

/// A twin makes its steps whatever becomes of datagrams, as long as no silence comes near what it may be shown alone (0.2 s).
bool suits_twin(const RunSpec& spec) noexcept {
  constexpr double kShortMs = 5;    // of bursts of loss: e^−40 of them are longer than 0.2 s
  constexpr double kLoss = 0.3;     // beyond, no reply comes for so long once in some hundred runs
  constexpr double kJitterMs = 25;  // standard deviation of a way
  const bool loses_little = spec.loss == 0 || (spec.loss <= kLoss && spec.burst_ms <= kShortMs);
  return loses_little && 0.5 * spec.jitter * spec.rtt_ms <= kJitterMs;
}

/// But for single datagrams.
bool delivers(const RunSpec& spec) noexcept {
  return spec.outage_ms == 0 && spec.leap_ms == 0 && spec.drops == Drops::kNone &&
         spec.restart == Restart::kNever;
}

bool is_calm(const RunSpec& spec, bool with_acts = false) noexcept {
  const bool task = spec.hand == HandKind::kPress || spec.hand == HandKind::kContact ||
                    spec.hand == HandKind::kIndent || spec.hand == HandKind::kRaster;
  const bool link = delivers(spec) && (with_acts || spec.act == Act::kNone) &&
                    spec.playout == link::PlayoutConfig::Mode::kNewest && spec.deadband_nm == 0 &&
                    spec.deadband_n == 0 && spec.reply_permille == 0 &&
                    (has_twin(spec) ? suits_twin(spec) : spec.loss == 0 && spec.jitter == 0);
  const bool station = spec.late == 0 && spec.quantum_m == 0 && spec.scale <= 1 && spec.rate_hz >= 1000;
  return task && link && station;
}

void ask_across(FeltLimits& limits, double lateral, double share_low, double share_high) noexcept {
  limits.lateral = lateral;
  limits.lateral_share_low = share_low;
  limits.lateral_share_high = share_high;
}

}  // namespace

// The figures are what the right methods do in the quick and full profiles, times one and a half to three; a
// renderer that is wrong by what a person would notice is beyond them (ctest -R WrongRenderer).
std::optional<FeltLimits> felt_limits(const RunSpec& spec) noexcept {
  // On the hard wall the slave's own force limit cuts what the tip meets; methods differ in showing that.
  if (!is_calm(spec) || spec.scene == SceneKind::kHard) return std::nullopt;
  const bool no_twin = spec.method == control::Method::kTwin && !has_twin(spec);
  const double period_ms = 1e3 / spec.rate_hz;
  FeltLimits limits;
  const bool near = spec.rtt_ms <= 2;  // over a longer way a hand that goes across feels what is behind it
  switch (no_twin ? control::Method::kModel : spec.method) {
    case control::Method::kNone:
      // The slave's own force, the same to the bit, a round trip later. Beyond 50 ms the hand bounces.
      if (spec.rtt_ms > 50) return std::nullopt;
      limits = {1e-6, std::max(spec.rtt_ms, period_ms), 1.5 * period_ms};
      if (near) ask_across(limits, 0.9, 0.9, 1.1);
      return limits;
    case control::Method::kTank:
      if (spec.rtt_ms > 20) return std::nullopt;  // beyond that its clamp acts
      limits = {0.05, std::max(spec.rtt_ms, period_ms), 3};
      if (near) ask_across(limits, 0.9, 0.9, 1.1);
      return limits;
    case control::Method::kModel: {
      if (spec.rtt_ms > 20) return std::nullopt;
      if (spec.scene > SceneKind::kScan) {
        // Friction and adhesion there are not its plane's; where a hand goes across, it drags the right way.
        if (spec.hand != HandKind::kRaster) return std::nullopt;
        ask_across(limits, 0.8, 0.75, 1.15);
        return limits;
      }
      const bool still = spec.hand == HandKind::kPress;
      // Its plane is right where the hand presses in one place, and late by the hand's way on a scan. The
      // first touch comes when the server's does.
      const bool rough = spec.scene == SceneKind::kScan;
      limits = {still ? 0.05 : rough ? 0.55 : 0.35, 0, 30};
      if (still) limits.pull = 0.05;
      if (still) limits.lateral = 0.95;
      return limits;
    }
    case control::Method::kTwin:
      limits = {0.02, 0, 2, 0.02};
      ask_across(limits, 0.99, 0.97, 1.03);
      return limits;
    case control::Method::kKs:
    case control::Method::kKsClamp:
      if (spec.rtt_ms > 20) return std::nullopt;
      limits.share_low = 0.7;
      limits.share_high = 1.02;
      if (near) ask_across(limits, 0.9, 0.8, 1.1);
      return limits;
    case control::Method::kTdpa:
      if (spec.rtt_ms > 2) return std::nullopt;
      limits.share_low = 0.75;
      limits.share_high = 1.02;
      ask_across(limits, 0.8, 0.7, 1.4);
      return limits;
    case control::Method::kWave:
      // What is reflected at the line's ends takes most away where a touch is short, or the line long.
      if (spec.rtt_ms > 0 || spec.hand == HandKind::kContact) return std::nullopt;
      limits.share_low = 0.45;
      limits.share_high = 1.02;
      ask_across(limits, 0.6, 0.45, 1.3);
      return limits;
    default:
      return std::nullopt;
  }
}

// Within a tenth where the right ones are within 0.04; `tank` and `ks-clamp` pay for forces five times as strong, and clamp.
std::optional<ShareLimits> share_limits_of_acts(const RunSpec& spec) noexcept {
  constexpr double kShortMs = 2;
  const bool soft = spec.scene == SceneKind::kPdms || spec.scene == SceneKind::kPolystyrene;
  const bool flat = soft || spec.scene == SceneKind::kOxide;
  const bool in_one_place = spec.hand == HandKind::kPress || spec.hand == HandKind::kIndent;
  if (!is_calm(spec, true) || spec.rtt_ms > kShortMs || spec.redundancy > 0 || spec.compand > 1)
    return std::nullopt;
  const bool pays = spec.method == control::Method::kKsClamp || spec.method == control::Method::kTank;
  const bool shows = pays || spec.method == control::Method::kNone ||
                     spec.method == control::Method::kModel || spec.method == control::Method::kTwin;
  if (!shows || !flat || !in_one_place) return std::nullopt;
  switch (spec.act) {
    case Act::kScale:
      if (!soft) return std::nullopt;
      return ShareLimits{pays ? 0.5 : 0.9, 1.1};
    case Act::kImpedance:
      return ShareLimits{
          0.7, 1.1};  // each rise pushes the hand out, which must have been put in: in the end the clamp acts
    case Act::kTask:
      return ShareLimits{0.85, 1.1};
    case Act::kClutch:
      return ShareLimits{0.8, 1.1};
    default:
      return std::nullopt;
  }
}

std::optional<double> drift_limit_mm(const RunSpec& spec) noexcept {
  constexpr double kDriftMm = 0.1;  // 0.06 was the most, over a link that drops what does not flatter
  // What a path with more jitter delays is not there yet when the hand has been at rest for what the link takes.
  const bool in_time = 0.5 * spec.jitter * spec.rtt_ms <= 50;
  const bool still = spec.hand != HandKind::kHuman && spec.act == Act::kNone && in_time;
  const bool exact = spec.scale <= 1 && spec.quantum_m == 0;
  // A log of steps that is cut takes its time to be taken up again.
  const bool whole = spec.method != control::Method::kTwin || (delivers(spec) && suits_twin(spec));
  // Waves hold positions only as well as forces; a slave that pays for its moves stays behind where what was sent
  // to it is lost, with `tank` by a server that begins anew, or whose clock leaps.
  const bool keeps_energy = spec.restart == Restart::kNever && spec.leap_ms == 0;
  const bool by_position = spec.method != control::Method::kWave && spec.method != control::Method::kTdpa &&
                           (spec.method != control::Method::kTank || keeps_energy);
  if (!still || !exact || !whole || !by_position) return std::nullopt;
  // Less than the deadband is not sent: of the tip, at the hand.
  return kDriftMm + 1e-6 * spec.deadband_nm / spec.velocity_scale;
}

std::uint32_t felt_violations(const fidelity::FeltMetrics& felt, const FeltShares& shares,
                              const FeltLimits& limits) noexcept {
  // Nothing to be felt, nothing to be wrong.
  if (!(felt.true_rms_n > fidelity::kJudgedN)) return 0;
  std::uint32_t violated = 0;
  const double off = std::isnan(felt.nrmse_at_lag) ? felt.nrmse : felt.nrmse_at_lag;
  if (std::isfinite(limits.nrmse) && !(off <= limits.nrmse)) violated |= kInvariantFelt;
  if (shares.normal < limits.share_low || shares.normal > limits.share_high) violated |= kInvariantFelt;
  if (std::isfinite(limits.lag_by) && !(std::fabs(felt.lag_ms - limits.lag_ms) <= limits.lag_by))
    violated |= kInvariantInTime;
  if (std::fabs(felt.pull_off_error) > limits.pull) violated |= kInvariantPull;
  if (!(felt.true_lateral_rms_n > kLateralJudgedN)) return violated;
  if (std::isfinite(limits.lateral) && !(felt.lateral_correlation >= limits.lateral))
    violated |= kInvariantLateral;
  if (shares.lateral < limits.lateral_share_low || shares.lateral > limits.lateral_share_high)
    violated |= kInvariantLateral;
  return violated;
}

}  // namespace telenano::studies::stress

#include "tests/studies/stress/invariants.h"

#include <algorithm>
#include <cmath>

#include "telenano/master/station/station.h"

namespace telenano::studies::stress {
namespace {

constexpr const char* kNames[kInvariants] = {
    "energy", "balance",  "sums",   "force", "slew",    "stale",   "leap", "tip",     "finite", "account",
    "damper", "recover",  "repeat", "felt",  "lateral", "in-time", "pull", "refusal", "record", "replies",
    "work",   "withdraw", "follow", "lead",  "let-go",  "jump",    "sent", "path",    "trip"};

/// Rounding: 1e6 terms of some millijoules in long double here and in double there: below 1e-12 J; the
/// product's own compensated sum against ours: a thousand times that.
constexpr double kRoundingJ = 1e-12;
constexpr double kAccountRoundingJ = 1e-9;

Vec3 vec3(const recording::Xyz& v) {
  return {v[0], v[1], v[2]};
}

bool all_finite(const recording::Sample& row) noexcept {
  const double values[] = {row.energy_j,       row.energy_in_j,        row.energy_out_j,
                           row.energy_bound_j, row.account_j,          row.damper_n_s_m,
                           row.deflection_nm,  row.slave_energy_in_aj, row.slave_energy_out_aj};
  for (const double value : values) {
    if (!std::isfinite(value)) return false;
  }
  return is_finite(vec3(row.hand_force_applied_h_n)) && is_finite(vec3(row.hand_force_commanded_h_n)) &&
         is_finite(vec3(row.hand_force_rendered_h_n)) && is_finite(vec3(row.tip_target_w_nm)) &&
         is_finite(vec3(row.hand_pos_h_m)) && !std::isnan(row.clamp_n);
}

}  // namespace

const char* invariant_name(std::uint32_t bit) noexcept {
  for (int i = 0; i < kInvariants; ++i) {
    if (bit == 1u << i) return kNames[i];
  }
  return "unknown";
}

std::string invariant_names(std::uint32_t bits) {
  std::string names;
  for (int i = 0; i < kInvariants; ++i) {
    if ((bits & (1u << i)) == 0) continue;
    if (!names.empty()) names += '+';
    names += kNames[i];
  }
  return names.empty() ? "none" : names;
}

std::uint32_t promised(control::Method method) noexcept {
  std::uint32_t all = (1u << kInvariants) - 1;
  if (!control::claims_energy_bound(method)) all &= ~(kInvariantEnergy | kInvariantBalance);
  if (method != control::Method::kTank) all &= ~kInvariantBalance;
  if (method == control::Method::kKs) all &= ~(kInvariantDamper | kInvariantJump);
  return all;
}

bool passes_on_the_well(control::Method method) noexcept {
  return method != control::Method::kKsClamp;
}

double promised_extraction_j(control::Method method, double allowance_j) noexcept {
  const bool one_port = method == control::Method::kKsClamp || method == control::Method::kModel ||
                        method == control::Method::kTwin;
  return (one_port ? 1 : 2) * allowance_j;
}

void InvariantWatch::look(const recording::Sample& row, const StressHand& hand, const SlaveWatch& slave,
                          const Around& around) noexcept {
  const double time_s = around.time_s;
  const int periods = around.periods;
  const Vec3 force_h_n = vec3(row.hand_force_applied_h_n);
  const double norm_n = force_h_n.norm();
  if (!all_finite(row) || slave.non_finite) violate(kInvariantFinite, time_s);

  // Energy. A closed account (a hand faster than v_max) does not grow any more.
  if (periods > 1) {
    const double overdraft_j = (periods - 1) * norm_n * limits_.velocity_max_m_s * limits_.period_s;
    late_j_ = std::max(late_j_, overdraft_j);
  }
  if (!hand.too_fast()) {
    const TrueAccount& account = hand.account();
    // A twin's sample gives before the server's slave has made the step: its well is the scene's, at any
    // time.
    const double well_j =
        std::isfinite(limits_.well_most_j) ? limits_.well_most_j : limits_.hand_j_per_aj * slave.well_aj;
    const double more_j =
        account.quantum_bound_j() + late_j_ + kRoundingJ + (passes_on_the_well(limits_.method) ? well_j : 0);
    const double margin_j =
        promised_extraction_j(limits_.method, limits_.allowance_j) + more_j - account.extracted_j();
    least_margin_j_ = std::min(least_margin_j_, margin_j);
    if (margin_j < 0) violate(kInvariantEnergy, time_s);
    least_extracted_j_ = std::min(least_extracted_j_, account.extracted_j());
    const double back_j =
        limits_.store_j + promised_extraction_j(limits_.method, limits_.allowance_j) + more_j;
    if (account.extracted_j() - least_extracted_j_ > back_j) violate(kInvariantEnergy, time_s);
    const double generated_j = account.extracted_j() + limits_.hand_j_per_aj * slave.net_in_aj;
    most_generated_j_ = std::max(most_generated_j_, generated_j);
    if (limits_.balance &&
        generated_j > 2 * limits_.allowance_j + account.quantum_bound_j() + late_j_ + kRoundingJ)
      violate(kInvariantBalance, time_s);
    if (std::fabs(row.energy_j + around.given_before_j) > around.q_before_j + kAccountRoundingJ)
      violate(kInvariantAccount, time_s);
  }
  if (row.energy_in_j < in_j_ || row.energy_out_j < out_j_ || slave.sums_fell)
    violate(kInvariantSums, time_s);
  in_j_ = row.energy_in_j;
  out_j_ = row.energy_out_j;

  if (!slave.sums_are_work) violate(kInvariantWork, time_s);
  if ((row.limit_flags & recording::kLimitStop) == 0)
    stopped_since_s_ = -1;
  else if (stopped_since_s_ < 0)
    stopped_since_s_ = time_s;
  const bool told = limits_.stop_s > 0 && stopped_since_s_ >= 0 && time_s - stopped_since_s_ > limits_.stop_s;
  const bool deserted = limits_.silence_s > 0 && around.silent_s > limits_.silence_s;
  if ((told || deserted) && !slave.rises) violate(kInvariantWithdraw, time_s);

  const Vec3 hand_h_m = vec3(row.hand_pos_h_m);
  const bool fast =
      last_tick_s_ >= 0 && (hand_h_m - last_h_m_).norm() > limits_.trip_m_s * row.dt_s * (1 + 1e-9);
  if (fast && (row.station_faults & station::kFaultVelocityTrip) == 0) violate(kInvariantTrip, time_s);
  last_h_m_ = hand_h_m;

  // Forces. Rounding of some newtons: far below 1e-9 of them.
  if (norm_n > limits_.force_limit_n * (1 + 1e-12)) violate(kInvariantForce, time_s);
  const double along_n = norm_n > 0 ? std::max(0.0, last_h_n_.dot(force_h_n) / norm_n) : 0;
  const double slew_step_n = limits_.slew_n_s * limits_.period_s;
  if (norm_n > along_n + slew_step_n * (1 + 1e-9) + 1e-12) violate(kInvariantSlew, time_s);

  const bool came = around.reply_ns != last_reply_ns_;
  const bool news = limits_.waits_s > 0 ? row.reply_age_ms == 0 : came;
  if (came) last_came_s_ = time_s;
  const double silent_s = time_s - last_news_s_;
  if (news) {
    if (last_reply_ns_ >= 0 && last_h_n_.isZero(0) && silent_s > limits_.stale_zero_s + limits_.period_s) {
      const double shown_n =
          vec3(row.hand_force_rendered_h_n).norm() + row.damper_n_s_m * limits_.velocity_max_m_s;
      if (norm_n > last_h_n_.norm() + shown_n * limits_.period_s / limits_.ramp_s * (1 + 1e-9) + 1e-12)
        violate(kInvariantLeap, time_s);
    }
    last_news_s_ = time_s;
    if (first_news_s_ < 0) first_news_s_ = time_s;
  } else if (silent_s > limits_.stale_zero_s * (1 + 1e-9) && norm_n > 0) {
    violate(kInvariantStale, time_s);
  }
  if (!news && limits_.stale_hold_s > 0 && silent_s > limits_.stale_hold_s &&
      silent_s < limits_.stale_zero_s) {
    // The station may have had the reply a tick later than the link.
    const double part = (limits_.stale_zero_s - silent_s + latest_periods_ * limits_.period_s) /
                        (limits_.stale_zero_s - limits_.stale_hold_s);
    const double shown_n =
        vec3(row.hand_force_rendered_h_n).norm() + row.damper_n_s_m * limits_.velocity_max_m_s;
    if (norm_n > part * shown_n * (1 + 1e-6) + 1e-9) violate(kInvariantStale, time_s);
  }
  constexpr double kUntilKnownS = 0.5;  // the round trip is
  if (limits_.too_long && first_news_s_ >= 0 && time_s - first_news_s_ > kUntilKnownS && norm_n > 0)
    violate(kInvariantStale, time_s);
  latest_periods_ = std::max(latest_periods_, periods);
  const double alone_s = limits_.waits_s + latest_periods_ * limits_.period_s + limits_.stale_zero_s;
  if (time_s - last_came_s_ > alone_s * (1 + 1e-9) && norm_n > 0) violate(kInvariantStale, time_s);
  last_reply_ns_ = around.reply_ns;
  last_h_n_ = force_h_n;
  last_tick_s_ = time_s;

  if (slave.most_force_nn > limits_.tip_limit_nn * (1 + 1e-9)) violate(kInvariantTip, time_s);
  if (row.damper_n_s_m > limits_.damper_cap_n_s_m * (1 + 1e-12) + 1e-15) violate(kInvariantDamper, time_s);

  if (waiting_) {
    constexpr std::uint32_t kEngaged = 2;
    const double since_s = time_s - well_since_s_;
    if (news && row.station_mode == kEngaged) {
      recovery_s_ = std::max(recovery_s_, since_s);
      waiting_ = false;
    } else if (limits_.recover_s > 0 && since_s > limits_.recover_s &&
               (row.limit_flags & recording::kLimitStop) == 0) {
      violate(kInvariantRecover, time_s);
      recovery_s_ = std::max(recovery_s_, since_s);
    }
  }
}

}  // namespace telenano::studies::stress

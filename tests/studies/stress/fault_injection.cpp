#include "tests/studies/stress/fault_injection.h"

#include <algorithm>
#include <cmath>

namespace telenano::studies::stress {
namespace {

constexpr double kBetweenS = 3;  // outages, restarts; round trips besides
constexpr double kFeltN = 0.05;
constexpr double kIntoContactS = 0.2;  // a server that dies in contact has felt it so long

std::int64_t nanoseconds(double seconds) {
  return std::llround(1e9 * seconds);
}

}  // namespace

FaultInjection::FaultInjection(const RunSpec& spec, support::VirtualSession& session)
    : spec_(spec), session_(session), random_(spec.seed ^ 0x7e57a27u) {
  // The session was established over a link that only delays: a run is about what happens within it. The
  // handshakes after restarts and outages meet everything.
  for (net::SimPath* path : {&session.link().path_a_to_b(), &session.link().path_b_to_a()}) {
    path->loss = spec.loss;
    path->burst_ns = nanoseconds(1e-3 * spec.burst_ms);
    path->duplicate = spec.duplicate;
    path->reorder = spec.reorder;
    path->reorder_ns = std::max<std::int64_t>(path->delay_ns / 2, 2'000'000);
    if (spec.jitter > 0) {
      path->jitter_ns = nanoseconds(spec.jitter * std::max(0.5e-3 * spec.rtt_ms, 0.002));
      path->jitter = net::ImpairmentConfig::Jitter::kHalfNormal;
      path->in_order = false;
    }
  }
}

int FaultInjection::periods() noexcept {
  if (!(spec_.late > 0) || !random_.chance(spec_.late)) return 1;
  return 1 +
         static_cast<int>(random_.below(static_cast<std::uint64_t>(std::max(1.0, spec_.late_periods))) + 1);
}

bool FaultInjection::dies_now(const SlaveWatch& slave, double t_s) noexcept {
  const bool contact_began = slave.touched != touched_;
  touched_ = slave.touched;
  if (contact_began) contact_s_ = t_s;
  const double rest_s = kBetweenS + 1e-2 * spec_.rtt_ms + 1e-3 * spec_.down_ms;
  if (t_s < 0.5 || dead_ || (last_death_s_ > 0 && t_s - last_death_s_ < rest_s)) return false;
  switch (spec_.restart) {
    case Restart::kNever:
      return false;
    case Restart::kFree:
      return !slave.touches;
    case Restart::kContact:
      return slave.touches && contact_s_ >= 0 && t_s - contact_s_ > kIntoContactS;
    case Restart::kSnapIn:
      return contact_began;
    case Restart::kRandom:
      return random_.chance(session_.period_s() / 2);
  }
  return false;
}

void FaultInjection::step(const recording::Sample& row, const StressHand& hand, const SlaveWatch& slave,
                          double t_s, InvariantWatch& invariants) noexcept {
  const bool was_down = down();
  if (spec_.outage_ms > 0) {
    outage_ = t_s >= outage_at_s_ && t_s < outage_at_s_ + 1e-3 * spec_.outage_ms;
    if (t_s >= outage_at_s_ + 1e-3 * spec_.outage_ms)
      outage_at_s_ += 1e-3 * spec_.outage_ms + kBetweenS + 1e-2 * spec_.rtt_ms;
    silent_s_ = outage_ ? t_s - outage_at_s_ : 0;
  }
  if (dies_now(slave, t_s)) {
    session_.kill_server();
    dead_ = true;
    last_death_s_ = t_s;
    back_at_s_ = t_s + 1e-3 * spec_.down_ms;
  }
  if (dead_ && t_s >= back_at_s_) {
    session_.restart_server();
    dead_ = false;
    if (!outage_) invariants.well_again(row.time_s);
  } else if (was_down && !down()) {
    invariants.well_again(row.time_s);
  }
  if (down()) invariants.not_well();
  if (spec_.leap_ms > 0 && leaps_ < 2 && t_s >= 3.0 * (leaps_ + 1)) {
    ++leaps_;
    session_.leap_server_clock(nanoseconds(1e-3 * spec_.leap_ms));
  }

  bool commands_lost = outage_, replies_lost = outage_;
  const double pos_m = hand.pos_h_m().z();
  const double force_n = row.hand_force_applied_h_n[2];
  const double moved_m = pos_m - last_pos_m_;
  last_pos_m_ = pos_m;
  switch (spec_.drops) {
    case Drops::kNone:
      break;
    case Drops::kSpite:
      // Force and motion of the interval that has just passed. What is on the way already cannot be stopped.
      if (force_n * moved_m > 0) commands_lost = replies_lost = true;
      break;
    case Drops::kFlatter:
      if (force_n > kFeltN && slave.force_w_nn.z() * row.force_scale * 1e-9 < force_n) replies_lost = true;
      break;
    case Drops::kStarve:
      if (moved_m < 0) commands_lost = true;
      break;
  }
  session_.link().path_a_to_b().down = commands_lost;
  session_.link().path_b_to_a().down = replies_lost;
}

}  // namespace telenano::studies::stress

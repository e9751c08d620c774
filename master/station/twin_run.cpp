#include "telenano/master/station/twin_run.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/common/link/messages.h"

namespace telenano::station {

const char* twin_state_name(TwinState state) noexcept {
  switch (state) {
    case TwinState::kNone:
      return "none";
    case TwinState::kBehind:
      return "behind";
    case TwinState::kConfirmed:
      return "confirmed";
    case TwinState::kApart:
      return "apart";
    case TwinState::kGivenUp:
      return "given up";
    case TwinState::kWaits:
      return "waits";
  }
  return "unknown";
}

TwinRun::TwinRun(const TwinRunConfig& config, std::unique_ptr<control::LocalSlave> now,
                 std::unique_ptr<control::LocalSlave> next)
    : config_(config),
      now_(std::move(now)),
      next_(std::move(next)),
      ring_(static_cast<std::size_t>(std::clamp(config.ring_s * config.rate_hz, 64.0, 65536.0))),
      silence_s_(config.silence_s),
      now_heights_(now_->heights()),
      next_heights_(next_->heights()) {
  unexplained_ns_.reserve(static_cast<std::size_t>(config_.partings) + 1);
}

const TwinRun::Made* TwinRun::find(std::uint64_t number) const noexcept {
  const Made& made = ring_[number % ring_.size()];
  return number != 0 && made.number == number ? &made : nullptr;
}

void TwinRun::leave() noexcept {
  looks_ = seen_ = false;
  be(TwinState::kNone);
}

void TwinRun::begin(const link::StepReport& welcome, bool new_slave, double timeout_s, std::int64_t now_ns,
                    bool shared) noexcept {
  silence_s_ = std::min(config_.silence_s, 0.5 * timeout_s);
  shared_ = shared;
  if (shared) {
    // Whose the tip is, the first reply says. A log that goes on is still the sender's to tell.
    if (new_slave || welcome.executed > newest_) newest_ = welcome.executed;
    breaks_ = welcome.breaks;
    reason_ = 0;
    if (new_slave) unexplained_ns_.clear();
    if (state_ == TwinState::kGivenUp && !new_slave) return;
    if (new_slave) seen_ = false;
    be(TwinState::kWaits);
    hold_ = 1;  // another than the one that follows
    hold(0);
    return;
  }
  hold_ = 0;
  looks_ = seen_ = false;
  if (!new_slave && state_ != TwinState::kNone) {
    // The same slave, and a log that goes on, unless the server has executed what this twin never made.
    if (welcome.executed <= newest_) {
      if (welcome.breaks < breaks_) {  // a server that took the slave up as it was before the last break
        breaks_ = welcome.breaks;
        part(link::kBreakSilence, now_ns);
        return;
      }
      on_reply(welcome, now_ns);
      return;
    }
  }
  catching_up_ = others_ = false;
  now_->reset();
  answer_ = {};
  swapped_ = other_state_ = true;
  given_aj_ = std::min(given_aj_, 0.0);  // what the last slave has given is not this one's to give again
  account_aj_ = 0;
  newest_ = confirmed_ = welcome.executed;
  breaks_ = welcome.breaks;
  reason_ = 0;
  unconfirmed_s_ = 0;
  be(TwinState::kConfirmed);
  last_target_w_nm_.setZero();
  if (new_slave) unexplained_ns_.clear();
  if (welcome.state_hash != now_->state_hash()) part(link::kBreakSilence, now_ns);
}

void TwinRun::hold(std::uint32_t number) noexcept {
  if (!shared_ || number == hold_ || !on()) return;
  if (!waits()) {  // it has the sample as this station has left it
    seen_ = config_.look_s > 0;
    seen_hash_ = now_->state_hash();
  }
  hold_ = number;
  looks_ = catching_up_ = heard_old_ = false;
  confirmed_ = newest_;
  answer_ = {};
  swapped_ = true;  // the force that was felt goes over to none
  reason_ = link::kBreakHolder;
  be(TwinState::kWaits);
}

void TwinRun::make(control::LocalSlave& slave, const link::LoggedStep& step, const Vec3& from_w_nm,
                   control::LocalAnswer& answer) noexcept {
  control::LocalStep local;
  local.target_w_nm = link::target_w_nm(step);
  local.dt_s = link::dt_s(step);
  local.vel_w_nm_s = (local.target_w_nm - from_w_nm) / local.dt_s;
  local.flags = step.flags;
  local.operates = !shared_ || step.hold == hold_;
  slave.step(local, answer);
}

void TwinRun::account_for_step() noexcept {
  const double out_less_in_aj = answer_.energy_out_aj - answer_.energy_in_aj;
  const bool in_contact = answer_.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact);
  double given_aj = -companding_.step(answer_.stored_aj, account_aj_ - out_less_in_aj, in_contact,
                                      std::exchange(other_state_, false));
  account_aj_ = out_less_in_aj;
  if (others_) {
    const double own_aj = own_aj_ - given_aj;
    own_aj_ = std::max(0.0, own_aj);
    given_aj += std::min(0.0, own_aj);
    others_ = answer_.contact_state != static_cast<std::uint32_t>(link::ContactState::kFree);
  }
  given_aj_ += given_aj;
  most_given_aj_ = std::max(most_given_aj_, given_aj_);
}

/// Another state is no exchange: what it holds less than the last one is not given, and more is withheld.
void TwinRun::account_for_swap() noexcept {
  const double account_aj = answer_.energy_out_aj - answer_.energy_in_aj;
  given_aj_ += std::min(0.0, account_aj - account_aj_);
  account_aj_ = account_aj;
}

void TwinRun::step(std::uint64_t number, const link::LoggedStep& step, std::int64_t now_ns) noexcept {
  if (!on()) return;
  if (waits() && !catching_up_) {  // not a step of this twin, but it may have to be made when there is one
    last_target_w_nm_ = link::target_w_nm(step);
    newest_ = confirmed_ = number;
    made(number) = {number, 0, now_ns, step};
    return;
  }
  if (waits()) {
    newest_ = number;
    made(number) = {number, 0, now_ns, step};
    catch_up(now_ns);
    return;
  }
  if (number != newest_ + 1) {  // another log than this twin's
    newest_ = number - 1;
    confirmed_ = std::min(confirmed_, newest_);
    part(link::kBreakGap, now_ns);
  }
  make(*now_, step, last_target_w_nm_, answer_);
  last_target_w_nm_ = link::target_w_nm(step);
  newest_ = number;
  made(number) = {number, now_->state_hash(), now_ns, step};
  if (!is_finite(answer_.force_w_nn) || !std::isfinite(answer_.energy_in_aj) ||
      !std::isfinite(answer_.energy_out_aj)) {
    answer_.force_w_nn.setZero();
    give_up(TwinEnd::kNotFinite);
    return;
  }
  account_for_step();
  if (catching_up_) catch_up(now_ns);
  if (state_ == TwinState::kConfirmed) be(TwinState::kBehind);
}

void TwinRun::part(std::uint32_t reason, std::int64_t now_ns) noexcept {
  if (state_ == TwinState::kApart || state_ == TwinState::kGivenUp) return;
  be(TwinState::kApart);
  catching_up_ = false;
  reason_ = reason;
  ++partings_;
  if (reason == link::kBreakNone) count_unexplained(now_ns);
}

void TwinRun::count_unexplained(std::int64_t now_ns) noexcept {
  const auto since_ns = now_ns - static_cast<std::int64_t>(config_.partings_s * 1e9);
  std::erase_if(unexplained_ns_, [since_ns](std::int64_t at_ns) { return at_ns < since_ns; });
  unexplained_ns_.push_back(now_ns);
  if (static_cast<int>(unexplained_ns_.size()) >= config_.partings) give_up(TwinEnd::kParted);
}

void TwinRun::on_reply(const link::StepReport& report, std::int64_t now_ns) noexcept {
  if (waits()) {
    told_hash_ = report.state_hash;
    if (hold_ != 0) breaks_ = std::max(breaks_, report.breaks);
    return;
  }
  if (!on() || report.executed > newest_) return;
  if (state_ == TwinState::kApart) return;
  if (report.breaks != breaks_) {
    if (report.breaks < breaks_) return;  // older than the state that was taken up
    breaks_ = report.breaks;
    part(report.break_reason != link::kBreakNone ? report.break_reason
                                                 : static_cast<std::uint32_t>(link::kBreakSilence),
         now_ns);
    return;
  }
  if (report.executed <= confirmed_) return;
  const Made* const own = find(report.executed);
  if (own == nullptr || own->hash != report.state_hash) {
    part(link::kBreakNone, now_ns);
    return;
  }
  confirmed_ = report.executed;
  be(confirmed_ == newest_ ? TwinState::kConfirmed : TwinState::kBehind);
}

void TwinRun::take_up(std::span<const std::uint8_t> state, std::uint64_t number, std::uint64_t hash,
                      std::uint32_t breaks, std::int64_t now_ns) noexcept {
  if (!wants_snapshot()) return;
  if (looks_) return look_at(state, hash, now_ns);
  const bool waited = waits();
  // Of before this holding: another is asked for.
  if (waited && breaks < breaks_) {
    if (std::exchange(heard_old_, true)) count_unexplained(now_ns);
    return;
  }
  const bool known = number <= newest_ && (number == newest_ || find(number + 1) != nullptr);
  if (!known || !next_->load(state, next_answer_) || next_->state_hash() != hash) {
    // A state that is not what it says, or older than what is kept: another one is asked for.
    if (waited) return count_unexplained(now_ns);
    be(TwinState::kBehind);
    part(link::kBreakNone, now_ns);
    return;
  }
  breaks_ = breaks;
  next_newest_ = number;
  if (waited) confirmed_ = number;
  const Made* const last = find(number);
  next_target_w_nm_ = last != nullptr ? link::target_w_nm(last->step) : next_answer_.commanded_pos_w_nm;
  catching_up_ = true;
  ++snapshots_;
}

bool TwinRun::may_look(std::int64_t now_ns) const noexcept {
  constexpr int kBadLooks = 3;
  return config_.look_s > 0 && waits() && hold_ == 0 && now_heights_ != nullptr && told_hash_ != 0 &&
         told_hash_ != seen_hash_ && bad_looks_ < kBadLooks && now_ns >= next_look_ns_;
}

/// Only to be seen: the first twin makes no step before it has been swapped for the second one.
void TwinRun::look_at(std::span<const std::uint8_t> state, std::uint64_t hash, std::int64_t now_ns) noexcept {
  constexpr double kPause = 8;
  control::LocalAnswer unfelt;
  const bool good = now_->load(state, unfelt) && now_->state_hash() == hash;
  bad_looks_ = good ? 0 : bad_looks_ + 1;
  seen_ = good;
  seen_hash_ = good ? hash : 0;
  looks_ = false;
  // A machine that stood still, or a long way, takes nothing of the link.
  const double pieces = std::ceil(static_cast<double>(state.size()) / link::kSnapshotPieceBytes);
  const double took_s = std::min(1e-9 * static_cast<double>(now_ns - look_began_ns_), pieces * of_a_piece_s_);
  next_look_ns_ = now_ns + static_cast<std::int64_t>(1e9 * std::max(config_.look_s, kPause * took_s));
  be(TwinState::kWaits);
}

/// The second twin makes the steps that the server had not made then; when it is there, it is the twin.
void TwinRun::catch_up(std::int64_t now_ns) noexcept {
  const std::uint64_t from = next_newest_;
  while (next_newest_ < newest_ && next_newest_ - from < kReplayedPerTick) {
    Made& step = made(next_newest_ + 1);
    if (step.number != next_newest_ + 1) {  // forgotten meanwhile
      catching_up_ = false;
      if (waits()) return count_unexplained(now_ns);
      be(TwinState::kBehind);
      part(link::kBreakNone, now_ns);
      return;
    }
    make(*next_, step.step, next_target_w_nm_, next_answer_);
    next_target_w_nm_ = link::target_w_nm(step.step);
    step.hash = next_->state_hash();
    ++next_newest_;
    if (confirmed_ < from) confirmed_ = from;
  }
  if (next_newest_ < newest_) return;
  std::swap(now_, next_);
  std::swap(now_heights_, next_heights_);
  answer_ = next_answer_;
  last_target_w_nm_ = next_target_w_nm_;
  catching_up_ = false;
  swapped_ = other_state_ = true;
  account_for_swap();
  if (waits()) {
    others_ = answer_.contact_state != static_cast<std::uint32_t>(link::ContactState::kFree);
    own_aj_ = 0;
  }
  be(confirmed_ == newest_ ? TwinState::kConfirmed : TwinState::kBehind);
}

double TwinRun::lag_s(std::int64_t now_ns) const noexcept {
  if (waits() || confirmed_ >= newest_) return 0;
  const Made* const oldest = find(confirmed_ + 1);
  return oldest != nullptr ? 1e-9 * static_cast<double>(now_ns - oldest->at_ns) : config_.ring_s;
}

void TwinRun::watch(double dt_s, bool replies_flow, double rtt_s, std::size_t pieces, double pieces_per_s,
                    std::int64_t now_ns) noexcept {
  of_a_piece_s_ = kSlowest / pieces_per_s;
  if (!on()) return;
  const std::size_t more = pieces > pieces_ ? pieces - pieces_ : 0;
  pieces_ = pieces;
  if (!looks_ && may_look(now_ns)) {
    looks_ = true;
    look_began_ns_ = now_ns;
  }
  const bool asks = state_ == TwinState::kApart || (waits() && hold_ != 0);
  if (!asks && lag_s(now_ns) <= lag_most_s(rtt_s)) {
    unconfirmed_s_ = 0;
    return;
  }
  if (replies_flow) unconfirmed_s_ += dt_s;
  unconfirmed_s_ = std::max(0.0, unconfirmed_s_ - of_a_piece_s_ * static_cast<double>(more));
  if (unconfirmed_s_ > unconfirmed_most_s(rtt_s)) give_up(TwinEnd::kUnconfirmed);
}

double TwinRun::lag_most_s(double rtt_s) const noexcept {
  return std::clamp(4 * rtt_s, config_.lag_s, 0.5 * config_.ring_s);
}

}  // namespace telenano::station

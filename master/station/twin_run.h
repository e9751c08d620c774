#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/common/control/companding.h"
#include "telenano/common/control/local_slave.h"
#include "telenano/common/link/snapshot.h"
#include "telenano/common/link/step_log.h"

namespace telenano::station {

/// none: there is no twin in this session. behind: its newest steps are not confirmed yet, as it should be.
/// confirmed: all are. apart: the server's state is another one; a snapshot is asked for. given_up: too often
/// apart without a reason, or too slow; another method takes over. waits: the tip is shared and somebody
/// else's, or has just come to this station and its state is on the way. Stored in files: never renumber.
enum class TwinState : std::uint8_t { kNone, kBehind, kConfirmed, kApart, kGivenUp, kWaits };
const char* twin_state_name(TwinState state) noexcept;

/// Why there is no twin any more.
enum class TwinEnd : std::uint8_t {
  kNone,
  kParted,       ///< too often apart without a reason
  kUnconfirmed,  ///< replies came, but no state that it could go on from, or nothing that confirms it
  kNotFinite,    ///< its own slave came to numbers that are none
  kRefused       ///< the server's state cannot be had, or is larger than there is room for
};

/// Of the state of a shared tip that another holds: how soon its marks are seen (TwinRunConfig::look_s of the programs).
inline constexpr double kLookAgain_s = 0.5;

struct TwinRunConfig {
  double rate_hz = 1000;
  double ring_s = 4;  ///< of steps that may be unconfirmed: twice what may be shown
  /// Shown without a new reply, at most; half of the server's time-out if that is less. Then the force fades.
  double silence_s = 0.2;
  /// Shown without a confirmation while replies flow: this, or four round trips.
  double lag_s = 1.0;
  int partings = 3;  ///< unexplained ones within `partings_s`: no twin any more
  double partings_s = 10;
  /// Without a confirmation or a state while replies flow, besides what the way and the transfer take.
  double unconfirmed_s = 3;
  /// While others hold a shared tip, or nobody does: its state is asked for again after so long, or after eight
  /// times what the link took for the last one, so that the marks on its sample are seen while they are made; 0: never.
  double look_s = 0;
};

/// The server's slave at the station, and whether it is what the server has: makes each step at once, keeps
/// its number and the hash of the state after it, and compares with what the replies say. Where the two are
/// apart it takes up the server's state, makes the steps that the server had not, and goes on from there.
///
/// Of a shared tip the holder has a twin: it begins with the server's state at each new holding, and until
/// that is here, and while others hold the tip, it makes no step and says no force.
///
/// Pure, no allocation after construction.
class TwinRun {
 public:
  /// `now` and `next`: of the same scene; the second one is where a snapshot is taken up.
  TwinRun(const TwinRunConfig& config, std::unique_ptr<control::LocalSlave> now,
          std::unique_ptr<control::LocalSlave> next);

  std::uint64_t scene_hash() const noexcept { return now_->scene_hash(); }
  double well_aj() const noexcept { return now_->well_aj(); }

  /// Forces before contact are shown stronger from now on (control/companding.h).
  void compand(const control::CompandingConfig& config) noexcept { companding_.configure(config); }
  const control::Companding& companding() const noexcept { return companding_; }
  /// What is to be felt of answer(): its force, companded.
  Vec3 felt_force_w_nn() const noexcept { return companding_.gain() * answer_.force_w_nn; }

  /// A session whose server has executed the log up to `welcome`; `new_slave`: another epoch, so that its
  /// slave is a new one. `shared`: of a tip that others move too.
  void begin(const link::StepReport& welcome, bool new_slave, double timeout_s, std::int64_t now_ns,
             bool shared = false) noexcept;
  /// Of a shared tip: which holding is this station's now; 0: none. Before the reply that says so is heard.
  void hold(std::uint32_t number) noexcept;
  /// There is no log in this session.
  void leave() noexcept;

  /// The step of this tick; numbers go up by one.
  void step(std::uint64_t number, const link::LoggedStep& step, std::int64_t now_ns) noexcept;
  void on_reply(const link::StepReport& report, std::int64_t now_ns) noexcept;

  TwinState state() const noexcept { return state_; }
  bool on() const noexcept { return state_ != TwinState::kNone && state_ != TwinState::kGivenUp; }
  bool given_up() const noexcept { return state_ == TwinState::kGivenUp; }
  /// There is no state yet that this station could move.
  bool waits() const noexcept { return state_ == TwinState::kWaits; }
  /// Why it was given up, or is apart: link::StepBreak; kBreakNone: unexplained.
  std::uint32_t reason() const noexcept { return reason_; }
  const control::LocalAnswer& answer() const noexcept { return answer_; }
  std::uint64_t behind() const noexcept { return newest_ - confirmed_; }
  std::uint64_t confirmed() const noexcept { return confirmed_; }
  /// How old the oldest step is that is not confirmed; 0: none.
  double lag_s(std::int64_t now_ns) const noexcept;
  double silence_s() const noexcept { return silence_s_; }
  double lag_most_s(double rtt_s) const noexcept;
  std::uint64_t partings() const noexcept { return partings_; }
  std::uint64_t snapshots() const noexcept { return snapshots_; }

  /// Of the twin's own account, companded: the most that its sample has given beyond what was put in, aJ. A state that is
  /// taken up is no exchange: what it holds less than the last one is not given, and what it has given more
  /// is withheld. What another holder has put into the sample is not given either: until the tip has been free
  /// once, no more than this one has put in.
  double most_given_aj() const noexcept { return most_given_aj_; }

  /// The answer is another state's from this tick on.
  bool take_swapped() noexcept { return std::exchange(swapped_, false); }

  /// Any thread: the sample's heights as the twin in use has them, valid as long as this object; null: no
  /// marks stay in it, or there is no twin now, or it waits.
  const surface::HeightView* heights() const noexcept { return heights_.load(std::memory_order_acquire); }

  /// Is the server's state asked for?
  bool wants_snapshot() const noexcept {
    return (state_ == TwinState::kApart || (waits() && hold_ != 0) || looks_) && !catching_up_;
  }
  /// Another number: what is still on its way is of no use any more.
  std::uint32_t snapshot_of() const noexcept { return hold_; }
  /// The server's state after step `number`: taken up by the second twin, which then catches up.
  void take_up(std::span<const std::uint8_t> state, std::uint64_t number, std::uint64_t hash,
               std::uint32_t breaks, std::int64_t now_ns) noexcept;
  void give_up(TwinEnd why) noexcept {
    end_ = why;
    be(TwinState::kGivenUp);
  }
  TwinEnd end() const noexcept { return end_; }

  /// Each tick, before its step. A server whose replies flow and who never says anything by which the twin is
  /// known to be right, or could be made so, leaves the hand without force for good: then there is no twin.
  /// `pieces`: of the state under way that are here.
  void watch(double dt_s, bool replies_flow, double rtt_s, std::size_t pieces, double pieces_per_s,
             std::int64_t now_ns) noexcept;
  /// So long may that be, without the time that pieces of the state take which do come.
  double unconfirmed_most_s(double rtt_s) const noexcept { return config_.unconfirmed_s + 4 * rtt_s; }

  /// The steps that the second twin makes in a tick to catch up.
  static constexpr std::uint64_t kReplayedPerTick = 16;

 private:
  struct Made {
    std::uint64_t number = 0;
    std::uint64_t hash = 0;
    std::int64_t at_ns = 0;
    link::LoggedStep step;
  };
  Made& made(std::uint64_t number) noexcept { return ring_[number % ring_.size()]; }
  const Made* find(std::uint64_t number) const noexcept;
  void make(control::LocalSlave& slave, const link::LoggedStep& step, const Vec3& from_w_nm,
            control::LocalAnswer& answer) noexcept;
  void part(std::uint32_t reason, std::int64_t now_ns) noexcept;
  void count_unexplained(std::int64_t now_ns) noexcept;
  void account_for_swap() noexcept;
  void catch_up(std::int64_t now_ns) noexcept;
  bool may_look(std::int64_t now_ns) const noexcept;
  void look_at(std::span<const std::uint8_t> state, std::uint64_t hash, std::int64_t now_ns) noexcept;
  void account_for_step() noexcept;
  void be(TwinState state) noexcept {
    state_ = state;
    heights_.store(on() && (!waits() || seen_) ? now_heights_.get() : nullptr, std::memory_order_release);
  }

  TwinRunConfig config_;
  std::unique_ptr<control::LocalSlave> now_;
  std::unique_ptr<control::LocalSlave> next_;
  std::vector<Made> ring_;
  control::LocalAnswer answer_;
  TwinState state_ = TwinState::kNone;
  std::uint32_t reason_ = 0;
  std::uint64_t newest_ = 0;
  std::uint64_t confirmed_ = 0;
  std::uint32_t breaks_ = 0;
  Vec3 last_target_w_nm_ = Vec3::Zero();
  double silence_s_ = 0.2;
  double given_aj_ = 0;    // of the twin's own account, less what is withheld
  double account_aj_ = 0;  // out less in, of the state in use
  double most_given_aj_ = 0;
  bool shared_ = false;
  std::uint32_t hold_ = 0;  // of a shared tip: the steps of this holding move it; 0: none do
  bool others_ = false;     // there is something in the sample that another holder has put there;
  double own_aj_ = 0;       // so much besides is this one's
  bool heard_old_ = false;  // in this holding: a state of before it, which was on its way when it began
  bool swapped_ = false;
  bool other_state_ = false;  // since the last step that was counted
  control::Companding companding_;
  std::shared_ptr<const surface::HeightView> now_heights_;
  std::shared_ptr<const surface::HeightView> next_heights_;
  std::atomic<const surface::HeightView*> heights_{nullptr};
  // The first twin, while it makes no step: what can be looked at.
  bool seen_ = false;   // it has a state of the shared tip
  bool looks_ = false;  // another is asked for
  int bad_looks_ = 0;   // one after the other
  std::int64_t look_began_ns_ = 0;
  std::int64_t next_look_ns_ = 0;
  std::uint64_t seen_hash_ = 0;
  std::uint64_t told_hash_ = 0;  // of the newest reply

  TwinEnd end_ = TwinEnd::kNone;
  double unconfirmed_s_ = 0;
  std::size_t pieces_ = 0;
  // The longest that a piece may take of the link: four times its share of the pace at which pieces are asked for.
  static constexpr double kSlowest = 4;
  double of_a_piece_s_ = kSlowest / link::SnapshotFetch::kPerSecond;
  bool catching_up_ = false;
  std::uint64_t next_newest_ = 0;  // of the second twin
  Vec3 next_target_w_nm_ = Vec3::Zero();
  control::LocalAnswer next_answer_;
  std::uint64_t partings_ = 0;
  std::uint64_t snapshots_ = 0;
  std::vector<std::int64_t> unexplained_ns_;  // the last ones, oldest first
};

}  // namespace telenano::station

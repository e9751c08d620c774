#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "telenano/common/link/messages.h"

namespace telenano::link {

/// How many commands a datagram may repeat.
inline constexpr std::size_t kMaxRecent = 4;
/// Of one of them on the wire: fixed32 age_ns, fixed32 flags, three doubles of position, one of energy, three
/// of the wave's sum.
inline constexpr std::size_t kRecentBytes = 64;

/// What a slave needs of a command that was lost: where it was to be and when, and what it was allowed to
/// spend. Everything else is in the newest command (energies are sums). Behind kFeatureRedundancy.
struct RecentCommand {
  std::uint32_t age_ns = 0;  ///< send time of the datagram's own command, minus this one's
  std::uint32_t flags = 0;   ///< CommandFlags
  Vec3 tip_pos_w_nm = Vec3::Zero();
  double energy =
      0;  ///< its energy_sent_j with the methods tdpa and tank, its wave_energy_aj with wave; >= 0
  Vec3 wave_sum = Vec3::Zero();  ///< with wave, √(aJ·s)
};

/// The commands before the datagram's own, newest first: record[i] has its sequence − 1 − i.
struct RecentCommands {
  std::array<RecentCommand, kMaxRecent> record{};
  std::size_t count = 0;
};

/// The station's end: remembers what was sent last.
class SentCommands {
 public:
  void clear() noexcept { count_ = 0; }

  /// `command` as it was sent. Another method begins anew: its sums mean something else. So does another
  /// scale: the slave takes a record's scale to be the newest one's, and what was done at another would be
  /// worth something else. And another holding of a shared tip: positions of the last one are not to be gone
  /// to.
  void add(const Command& command) noexcept {
    if (!goes_on(command)) clear();
    method_ = command.control.method;
    energy_scale_aj_j_ = command.control.energy_scale_aj_j;
    tip_hold_ = command.tip_hold;
    std::shift_right(sent_.begin(), sent_.end(), 1);
    Sent& sent = sent_[0];
    sent.time_ns = command.send_time_ns;
    sent.record.flags = command.flags;
    sent.record.tip_pos_w_nm = command.tip_pos_w_nm;
    const bool wave = command.control.method == kMethodWave;
    sent.record.energy = wave ? command.control.wave_energy_aj : command.control.energy_sent_j;
    sent.record.wave_sum = wave ? command.control.wave_sum : Vec3(Vec3::Zero());
    count_ = std::min(count_ + 1, kMaxRecent);
  }

  /// The last `n` before `next`, which is about to be sent. Fewer after a gap too long for an age (4.29 s).
  void before(const Command& next, std::size_t n, RecentCommands& out) const noexcept {
    out.count = 0;
    if (!goes_on(next)) return;
    for (std::size_t i = 0; i < std::min(n, count_); ++i) {
      const std::uint64_t age_ns = next.send_time_ns - sent_[i].time_ns;
      if (age_ns > UINT32_MAX) return;
      out.record[i] = sent_[i].record;
      out.record[i].age_ns = static_cast<std::uint32_t>(age_ns);
      out.count = i + 1;
    }
  }

 private:
  bool goes_on(const Command& command) const noexcept {
    return command.control.method == method_ && command.control.energy_scale_aj_j == energy_scale_aj_j_ &&
           command.tip_hold == tip_hold_;
  }

  struct Sent {
    std::uint64_t time_ns = 0;
    RecentCommand record;
  };
  std::array<Sent, kMaxRecent> sent_{};
  std::size_t count_ = 0;
  std::uint32_t method_ = kMethodNone;
  double energy_scale_aj_j_ = 0;
  std::uint32_t tip_hold_ = 0;
};

/// The server's end: the steps that a slave is to make for one accepted command, oldest first; the last one
/// is the command's own. Each missed command appears in one list only, since it lies above the newest
/// sequence accepted before.
struct MissedSteps {
  struct Step {
    RecentCommand command;
    double spacing_s = 0;  ///< since the step before
  };
  std::array<Step, kMaxRecent> step{};
  std::size_t count = 0;
  double last_spacing_s = 0;  ///< of the command itself
};

/// `missed`: commands between the newest accepted before and this one; `spacing_s` between those two;
/// `tick_s` stands for a spacing that the ages do not leave room for.
inline void plan_steps(const RecentCommands& recent, std::uint64_t missed, double spacing_s, double tick_s,
                       MissedSteps& plan) noexcept {
  plan.count = static_cast<std::size_t>(std::min<std::uint64_t>(missed, recent.count));
  plan.last_spacing_s = spacing_s;
  double before_s = spacing_s;  // from the command itself back to the step before
  for (std::size_t i = 0; i < plan.count; ++i) {
    const RecentCommand& record = recent.record[plan.count - 1 - i];
    const double age_s = 1e-9 * record.age_ns;
    plan.step[i].command = record;
    plan.step[i].spacing_s = before_s > age_s ? before_s - age_s : tick_s;
    before_s = age_s;
    plan.last_spacing_s = age_s > 0 ? age_s : tick_s;
  }
}

/// The missed command in full: `newest` with what is its own.
inline Command with_recent(const Command& newest, const RecentCommand& recent,
                           const Vec3& vel_w_nm_s) noexcept {
  Command command = newest;
  command.flags = recent.flags;
  command.tip_pos_w_nm = recent.tip_pos_w_nm;
  command.tip_vel_w_nm_s = vel_w_nm_s;
  if (newest.control.method == kMethodWave) {
    command.control.wave_energy_aj = recent.energy;
    command.control.wave_sum = recent.wave_sum;
  } else {
    command.control.energy_sent_j = recent.energy;
  }
  return command;
}

}  // namespace telenano::link

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/common/link/messages.h"

namespace telenano::link {

/// Targets of logged steps lie on this grid, nm: both ends step to the same number, to the bit. A sixteenth
/// of a thousandth of a nanometre, at 20 N/m 1.2e-3 nN.
inline constexpr double kStepGridNm = 1.0 / 16384;
/// Beyond ±2^46 of the grid (4 m) there is no workspace.
inline constexpr std::int64_t kStepTargetMost = std::int64_t{1} << 46;
inline constexpr std::uint32_t kStepShortestNs = 1'000;
inline constexpr std::uint32_t kStepLongestNs = 100'000'000;
inline constexpr std::size_t kMaxBatch = 64;  ///< steps a datagram
inline constexpr std::size_t kStepsHeaderBytes = 9;
/// The largest field of steps: what a datagram has room for beside the longest Command.
inline constexpr std::size_t kStepsBytesMost = 300;
inline constexpr std::uint32_t kStepFlags = kFlagClutch | kFlagDeadman | kFlagStop;

/// One step of the slave, as both ends make it: its state is a function of the ordered list of these.
struct LoggedStep {
  std::array<std::int64_t, 3> target{};   ///< commanded position over kStepGridNm
  std::uint32_t dt_ns = kStepShortestNs;  ///< of the tick, kStepShortestNs … kStepLongestNs
  std::uint32_t flags = 0;                ///< of kStepFlags
  /// Of a shared tip: the holding that the target is anchored to (TipShare::hold). Not of the record on the
  /// wire, but the tip_hold of its datagram.
  std::uint32_t hold = 0;
  friend bool operator==(const LoggedStep&, const LoggedStep&) = default;
};

inline Vec3 target_w_nm(const LoggedStep& step) noexcept {
  return {static_cast<double>(step.target[0]) * kStepGridNm,
          static_cast<double>(step.target[1]) * kStepGridNm,
          static_cast<double>(step.target[2]) * kStepGridNm};
}

inline double dt_s(const LoggedStep& step) noexcept {
  return 1e-9 * static_cast<double>(step.dt_ns);
}

/// The step of a tick: the nearest on the grid; lengths outside the range are taken for its ends.
inline LoggedStep logged_step(const Vec3& target_w_nm, std::uint32_t flags, double dt_s) noexcept {
  LoggedStep step;
  for (int axis = 0; axis < 3; ++axis) {
    const double most = static_cast<double>(kStepTargetMost);
    const double cells = std::clamp(target_w_nm[axis] / kStepGridNm, -most, most);
    step.target[static_cast<std::size_t>(axis)] = std::llround(cells);
  }
  const double ns = std::clamp(dt_s * 1e9, 1.0 * kStepShortestNs, 1.0 * kStepLongestNs);
  step.dt_ns = static_cast<std::uint32_t>(std::llround(ns));
  step.flags = flags & kStepFlags;
  return step;
}

/// Steps of consecutive numbers.
struct StepBatch {
  std::uint64_t first = 0;  ///< number of step[0], from 1
  std::size_t count = 0;
  std::array<LoggedStep, kMaxBatch> step{};
};

/// On the wire (PROTOCOL.md, section 14): fixed64 first, one byte count, then records; a record that says the
/// same as the last one is a run.
class StepWriter {
 public:
  StepWriter(std::span<std::uint8_t> out, std::uint64_t first) noexcept : out_(out) {
    for (int i = 0; i < 8; ++i) out_[at_++] = static_cast<std::uint8_t>(first >> (8 * i));
    out_[at_++] = 0;
  }
  /// False: no room, and nothing was written.
  bool add(const LoggedStep& step) noexcept;
  std::size_t count() const noexcept { return out_[8]; }
  std::size_t size() const noexcept { return at_; }

 private:
  std::span<std::uint8_t> out_;
  std::size_t at_ = 0;
  std::size_t run_at_ = 0;  // of the record that may still stand for more steps; 0: none
  LoggedStep last_{{0, 0, 0}, 0, 0};
};

/// False for bytes that are no batch: then `batch` is empty.
bool read_steps(std::span<const std::uint8_t> bytes, StepBatch& batch) noexcept;

/// The station's end: numbers the steps, keeps those that the server has not executed yet, and says which go
/// into the next datagram. Its ring is made once.
class StepSender {
 public:
  explicit StepSender(std::size_t ring) : ring_(ring) {}

  bool enabled() const noexcept { return !ring_.empty(); }
  /// A session begins in which the server has executed steps up to `executed`. True: the log goes on, and
  /// what is not executed is sent again; false: it begins anew, with executed + 1.
  bool begin(std::uint64_t executed, bool same_log) noexcept;

  std::uint64_t next() const noexcept { return newest_ + 1; }  ///< number that the next step gets
  std::uint64_t newest() const noexcept { return newest_; }
  std::uint64_t executed() const noexcept { return executed_; }
  /// Steps that are not executed, as far as is known.
  std::size_t open() const noexcept { return static_cast<std::size_t>(newest_ - executed_); }
  std::size_t capacity() const noexcept { return ring_.size(); }

  /// The oldest one is forgotten where the ring is full: that gap the server will skip.
  void add(const LoggedStep& step) noexcept;
  /// What a reply says: executed up to, and the newest that has come.
  /// A gap that it names is sent again at once, with all after it, but only once a round trip; its beginning, which all else
  /// waits for, four times.
  void on_report(const StepReport& report, std::int64_t now_ns, std::int64_t rtt_ns) noexcept;
  /// Is there a reason to send besides the pace: something to be sent again, or more new steps than the next
  /// datagram could take?
  bool urgent(std::int64_t now_ns, std::int64_t wait_ns) noexcept;
  /// Writes what goes into the next datagram; returns the bytes, 0: nothing. `wait_ns`: how long an answer
  /// may take; before that nothing is sent again. All of it belongs to one holding: `newest_holding`, that of
  /// the newest step (a stop must not wait for what an earlier holding has left).
  std::size_t write(std::span<std::uint8_t> out, std::int64_t now_ns, std::int64_t wait_ns,
                    bool newest_holding = false) noexcept;
  /// LoggedStep::hold of what write() has written last.
  std::uint32_t written_hold() const noexcept { return written_hold_; }

  /// Every datagram repeats unasked what was new in the one before, and at least so many. From the first gap that a report
  /// names until none has been named for kQuietNs it is half of what a datagram takes, so that a link that loses or jitters
  /// costs no round trip for most of what comes late or never.
  static constexpr std::uint64_t kRepeated = 8;
  static constexpr std::uint64_t kRepeatedMost = kMaxBatch / 2;
  static constexpr std::int64_t kQuietNs = 10'000'000'000;

 private:
  const LoggedStep& at(std::uint64_t number) const noexcept { return ring_[number % ring_.size()]; }
  void send_again(std::int64_t now_ns, bool head_only) noexcept;
  /// From `from` on, as many as there is room for; the first that has none.
  std::uint64_t fill(StepWriter& writer, std::uint64_t from) const noexcept;
  std::uint64_t oldest() const noexcept;  // that is kept and not executed

  std::vector<LoggedStep> ring_;
  std::uint64_t newest_ = 0;
  std::uint64_t executed_ = 0;
  std::uint64_t sent_ = 0;      // up to here at least once
  std::uint64_t last_new_ = 0;  // the first that was new in the last datagram
  std::uint64_t again_ = 0;     // sending again from here; 0: not
  std::int64_t again_ns_ = 0;   // since then
  bool head_only_ = false;      // no more than one datagram of it
  std::int64_t head_ns_ = 0;    // the gap's beginning was sent again then
  std::int64_t waits_ns_ = 0;   // since then without progress
  std::uint64_t repeated_ = kRepeated;
  std::int64_t last_gap_ns_ = 0;
  std::uint32_t written_hold_ = 0;
};

/// The server's end: executes every step once and in order. What comes before its turn waits in a ring that
/// is made once; what comes too early for that is sent again by the station.
class StepReceiver {
 public:
  StepReceiver() = default;
  /// `executed`: steps before this object; the ring holds `ring` steps.
  explicit StepReceiver(std::size_t ring) : ring_(ring), here_(ring), came_ns_(ring) {}

  bool enabled() const noexcept { return !ring_.empty(); }
  /// A log that another receiver has executed as far as `report` says: this one goes on with the next step.
  void go_on_after(const StepReport& report) noexcept {
    executed_ = newest_ = report.executed;
    breaks_ = report.breaks;
    break_reason_ = report.break_reason;
    break_step_ = report.break_step;
  }
  /// `hold`: of the datagram that brings them, at a shared tip.
  void take(const StepBatch& batch, std::int64_t now_ns, std::uint32_t hold = 0) noexcept;

  /// The next one, if it is here and Σdt allows; then it counts as executed. Σdt is a bucket: it fills with
  /// 1.001 of the time on the wall and holds kBucketNs; what is too early waits, nothing is left out.
  bool pop(std::int64_t now_ns, LoggedStep& step) noexcept;
  /// The next one is here, and Σdt did not allow it when pop() last looked: its sender's clock runs ahead of
  /// this one.
  bool ahead() const noexcept { return waits() && bucket_ns_ < next().dt_ns; }
  /// Executed or not, there is no further one that pop() could ever give: a step is missing.
  std::uint64_t newest() const noexcept { return newest_; }
  bool gap() const noexcept { return executed_ < newest_ && !has(executed_ + 1); }
  bool waits() const noexcept { return executed_ < newest_ && has(executed_ + 1); }
  std::int64_t gap_since_ns() const noexcept { return gap_since_ns_; }
  /// Of the next one, where waits(): since when it and all before it have been here.
  std::int64_t waits_since_ns() const noexcept {
    return std::max(came_ns_[(executed_ + 1) % came_ns_.size()], gap_closed_ns_);
  }
  /// Leaves out what is missing, and all before the newest, which is the next to come; a declared break.
  void skip_to_newest(std::uint32_t reason) noexcept;
  /// Steps that were not the log's: the state is another one than the log says.
  void declare_break(std::uint32_t reason) noexcept {
    ++breaks_;
    break_reason_ = reason;
    break_step_ = executed_;
  }

  std::uint64_t executed() const noexcept { return executed_; }
  /// All but the hash.
  StepReport report() const noexcept { return {executed_, 0, newest_, breaks_, break_reason_, break_step_}; }

  /// More than the 4 s of steps that a station keeps for an outage (server::ServerConfig::step_ring_s): all
  /// of them may be executed as soon as they come. What the bucket did not hold would be worked off at 0.1 %
  /// of the wall's time only, and the session were behind for ever.
  static constexpr std::int64_t kBucketNs = 5'000'000'000;
  static constexpr double kFill = 1.001;

 private:
  bool has(std::uint64_t number) const noexcept { return here_[number % here_.size()] == number; }
  const LoggedStep& next() const noexcept { return ring_[(executed_ + 1) % ring_.size()]; }

  std::vector<LoggedStep> ring_;
  std::vector<std::uint64_t> here_;  // the number that stands there; 0: none
  std::vector<std::int64_t> came_ns_;
  std::uint64_t executed_ = 0;
  std::uint64_t newest_ = 0;
  std::int64_t gap_since_ns_ = 0;
  std::int64_t gap_closed_ns_ = INT64_MIN;
  double bucket_ns_ = kBucketNs;
  std::int64_t filled_ns_ = 0;
  bool filled_ = false;
  std::uint32_t breaks_ = 0;
  std::uint32_t break_reason_ = 0;
  std::uint64_t break_step_ = 0;
};

}  // namespace telenano::link

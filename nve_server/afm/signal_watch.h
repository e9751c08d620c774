#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

namespace telenano::afm {

enum class SignalFault : std::uint8_t {
  kNone,
  kFrozen,        ///< the same value, bit for bit, for longer than its noise lets it
  kAtEnd,         ///< at an end of the range
  kNoisy,         ///< it changes by much more than its noise while the base stands still
  kNotFollowing,  ///< in contact it does not change as the base moves, or the wrong way
  kSwapped        ///< the lateral signal shows what it should
};
std::string_view name(SignalFault fault) noexcept;

/// What the signal of a live sensor shows, reading by reading.
///
/// Frozen. A live value repeats by chance. Rounded to steps of q with noise σ it stays in one step with at
/// most the probability p = erf(q/(2√2 σ)), which is reached in the middle of a step; N in a row have p^N. N
/// is where that is 1e-13, so that 8 h at 2000 readings a second (6e7) see it with less than 1e-5. σ and q
/// come from readings in the air: q is the least difference that was ever seen, σ half of what their scatter
/// says (20 readings know σ to a sixth; a half is three times that), and no less than q/4 once they spread
/// over two steps, which noise of less than q/4 does not do in 20 readings but once in a thousand times.
/// Where they spread over less, the signal may rest in one step for ever: then only the base's motion tells
/// (below), and what repeats is no new reading: Repeats says how high the base has been since the value was
/// first seen, for the force limit counts from there.
///
/// In contact. Over at least two steps of the base along Z, and as much as makes a tenth of the contact's
/// stiffness show over the noise (8 σ + 4 q), within half a second, the force must change by that tenth at
/// least and the right way; while it pulls, which a tip does that snaps in or lets go, it must not change by
/// more than three tenths the wrong way. Twice in a row it did not: kNotFollowing. In
/// contact is what exceeds the force of contact by 6 σ: 20 readings may find σ by a third too small. The same
/// value over such a way, three times: kFrozen. Only that part of the way counts which lies between the
/// windows in which two readings may have been averaged.
///
/// Swapped with the lateral signal. Both go, within two readings, to where the other one stood, which was further
/// away than the noise of both and the way of the base explain. Or, without motion across, over a way as
/// above the lateral signal changes by at least half of what the deflection's would, and the deflection's by
/// less than a tenth. Or, where nothing moves across at all (an approach), the tip looks free while the
/// lateral signal shows what would be half of the force limit.
///
/// Noise. While the base stands, a reading does not differ from the last one by more than 8·√2 σ + 3 q, and a
/// tenth of a step's force in the air, or half of one in contact, where the floor shakes the lever too; four
/// of eight that do are kNoisy.
class SignalWatch {
 public:
  struct Rig {
    double lever_n_m = 1;
    double step_nm = 1;       ///< of the base, by one command
    double nn_v = 1;          ///< force a volt, without its sign
    double range_v = 10;      ///< the signal ends at plus and minus this
    std::int64_t period_ns;   ///< of the readings
    int sign = 1;             ///< of nn_v
    double limit_nn = 1e300;  ///< of the force
  };
  struct Reading {
    std::int64_t time_ns = 0;
    double volts = 0, lateral_volts = 0;
    double force_nn = 0;
    double base_nm = 0;         ///< along Z, where it stood when the reading's averaging may have begun
    double highest_nm = 0;      ///< of the base while it may have been averaged, and until now
    double lowest_nm = 0;       ///< of it in that time
    double way_nm = 0;          ///< of the base along Z and across since the last reading may have begun
    double across_nm = 0;       ///< of it, across
    bool still_across = false;  ///< since long nothing has moved across
    double contact_nn = 0;      ///< more force than this is contact
    double stiffness_n_m = 0;   ///< of the contact; 0: not known: then only ends and repeats are looked at
  };

  explicit SignalWatch(const Rig& rig) noexcept : rig_(rig) {}

  /// Readings in the air, in volts, one after another.
  void learn(std::span<const double> volts) noexcept;
  /// The lateral signal's at the same time.
  void learn_lateral(std::span<const double> volts) noexcept;
  /// A new approach: nothing that was before belongs to what comes.
  void begin() noexcept;
  SignalFault add(const Reading& reading) noexcept;

  /// Readings after the first one of the present value.
  int repeats() const noexcept { return repeats_; }
  /// Of the base since it was first seen.
  double highest_nm() const noexcept { return highest_nm_; }
  double across_nm() const noexcept { return run_across_nm_; }
  /// Repeats that a live signal does not make; no_limit where it may rest for ever.
  int most_repeats() const noexcept { return most_repeats_; }
  static constexpr int kNoLimit = std::numeric_limits<int>::max();

 private:
  bool strikes(const Reading& r) noexcept;
  bool swapped(const Reading& r) noexcept;
  bool exchanged(const Reading& r, const Reading& before, double way_nm, double across_nm) const noexcept;
  bool lateral_follows(const Reading& r) noexcept;
  bool noisy(const Reading& r) noexcept;

  Rig rig_;
  double sigma_v_ = 0;
  double quantum_v_ = 0;  // 0: no two values have differed yet
  double spread_v_ = 0;
  double lateral_sigma_v_ = 0, lateral_free_v_ = 0;  // the second: its mean
  bool lateral_known_ = false;
  // Where the way began over which the lateral signal may follow.
  bool lateral_anchored_ = false;
  double lateral_low_nm_ = 0, lateral_high_nm_ = 0, lateral_anchor_v_ = 0, lateral_anchor_nn_ = 0;
  std::int64_t lateral_anchor_ns_ = 0;
  int most_repeats_ = kNoLimit;
  bool any_ = false;
  Reading last_, before_last_;
  bool before_last_known_ = false;
  std::int64_t counted_ns_ = 0;
  int repeats_ = 0;
  double highest_nm_ = 0, run_across_nm_ = 0, run_low_nm_ = 0, run_high_nm_ = 0;
  bool anchored_ = false;
  double anchor_low_nm_ = 0, anchor_high_nm_ = 0, anchor_nn_ = 0;
  std::int64_t anchor_ns_ = 0;
  int strikes_ = 0;
  std::array<bool, 8> odd_{};
  std::size_t odd_at_ = 0;
  void limit() noexcept;
  double scatter_nn() const noexcept;
};

}  // namespace telenano::afm

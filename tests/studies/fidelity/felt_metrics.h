#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "telenano/common/base/vec3.h"

namespace telenano::studies::fidelity {

/// One motion, tick by tick: what the hand was given to feel and what it should have felt.
struct TouchTrace {
  struct Row {
    Vec3 felt_h_n = Vec3::Zero();  ///< force that the device applied from this tick to the next
    Vec3 true_h_n = Vec3::Zero();  ///< α_F times the force of the sample at this tick's command
    Vec3 hand_pos_h_m = Vec3::Zero();
    bool touches = false;  ///< the true tip is in contact
  };
  double period_s = 1e-3;
  std::vector<Row> rows;
};

/// Forces below this are not judged: a tenth of what a hand that holds a handle begins to notice
/// (control::kNoticedForceN).
inline constexpr double kJudgedN = 0.005;

/// How far what is felt is from what is true. A number that is not defined for a trace (no lateral force, no
/// adhesion) is NaN.
///
/// *Window*: the ticks in which the true tip touches or a force above kJudgedN is felt, so that a force that
/// comes after the contact counts too. NRMSE = RMS(felt − true)/RMS(true) over the window, all axes together;
/// of an axis over its own true RMS, and only where that exceeds kJudgedN.
///
/// *Events*: contacts that last for kContactS at least, interruptions shorter than that bridged. Snap-in and
/// pull-off are the greatest attraction in the first and in the second half of a contact, kAfterS before and
/// after it included; felt is searched in the same span. The worst of all contacts counts.
struct FeltMetrics {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  double true_rms_n = kNone;
  double true_lateral_rms_n = kNone;
  double contact_share = 0;  ///< of all ticks
  double nrmse = kNone;
  /// Of the same window without kEventS before and after each beginning and end of a contact: what is left
  /// where nothing jumps. A jump J that comes one period late alone makes J/(RMS √ticks).
  double nrmse_between = kNone;
  double nrmse_x = kNone, nrmse_y = kNone, nrmse_z = kNone;
  double lateral_correlation = kNone;  ///< of the lateral vectors, not centred: 1 same, −1 reversed
  double lag_ms = kNone;               ///< of felt behind true, where they correlate best
  double nrmse_at_lag = kNone;         ///< what is left were it felt so much earlier
  double snap_in_true_n = kNone, snap_in_error = kNone;    ///< relative; negative: felt too weak
  double pull_off_true_n = kNone, pull_off_error = kNone;  ///< of the contact that is worst
  double snap_in_peak_n = kNone, pull_off_peak_n = kNone;  ///< largest |felt − true| within kEventS of it
  int contacts = 0;
  /// Nothing (less than 2 % of the true RMS) is felt for kReleaseS, though the true force is more than a
  /// quarter of its RMS in contact, and this contact had been felt before.
  int false_releases = 0;
  /// Work of the hand against the force, −Σ F·Δx, from the first row to the last: on a path that ends where
  /// it began, what the sample keeps.
  double work_true_mj = 0, work_felt_mj = 0;

  static constexpr double kContactS = 0.05;
  static constexpr double kAfterS = 0.6;
  static constexpr double kEventS = 0.05;
  static constexpr double kReleaseS = 0.05;
};

/// `lag_max_s`: how far the cross-correlation looks.
FeltMetrics measure(const TouchTrace& trace, double lag_max_s);

}  // namespace telenano::studies::fidelity

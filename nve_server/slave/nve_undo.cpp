#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::slave {
namespace {

/// Lifted off: nothing holds tip and ground together, and nothing is under way.
bool is_off(const physics::TipSolution& solution, const physics::PotentialState& state) noexcept {
  const bool apart =
      solution.branch == physics::Branch::kFree || solution.branch == physics::Branch::kVanDerWaals;
  return apart && !state.branch.bridge.present && !solution.under_way && !(solution.contact_radius_nm > 0.0);
}

}  // namespace

/// The tip is balanced anew where its commanded end is, as if it had come from far away; where it would then touch,
/// all is as it was. What is stored there may be another energy than before: more is charged though the port did not
/// bring it, less is lost, so that the sum of the charges is at least what is stored, as ever.
UndoResult NveSlave::undo_marks(std::uint64_t of, SlaveOutput& output) noexcept {
  if (!limits_.keeps_marks) return UndoResult::kNothing;
  const std::uint64_t maker = sample_.stroke_maker();
  if (of != 0 && maker != 0 && maker != of) return UndoResult::kAnothers;
  if (!is_off(port().solution, port().potential)) return UndoResult::kTouches;
  if (!sample_.exchange_stroke()) return UndoResult::kNothing;
  Port from = port();
  from.potential = {};
  from.solution = {};
  Port& after = trial_port();
  work_ = 0;
  const bool balanced = solve(from.commanded_w_nm, piece_of(kSettle_s), from, after) != nullptr;
  if (!balanced || !is_off(after.solution, after.potential)) {
    sample_.exchange_stroke();
    after = port();
    return UndoResult::kTouches;
  }
  sample_.keep_undone();
  after.mode.velocity_nm_s = 0;
  const double charge = after.stored_aj - port().stored_aj;
  if (charge > 0.0) {
    energy_in_aj_ += charge;
    paid_ahead_aj_ += charge;
    trace_.mode_unpaid_aj += charge;
  } else {
    trace_.dissipated_aj -= charge;
  }
  accept_trial();
  publish(last_faults_, output);
  return UndoResult::kDone;
}

}  // namespace telenano::slave

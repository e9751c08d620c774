#include "tests/studies/fidelity/touch_run.h"

#include <cmath>

namespace telenano::studies::fidelity {
namespace {

Vec3 vec3(const recording::Xyz& v) {
  return {v[0], v[1], v[2]};
}

}  // namespace

TouchOutcome run_touch(const TouchRun& run) {
  support::VirtualSession session(run.session);
  const std::unique_ptr<slave::Slave> truth = run.make_truth();
  slave::SlaveOutput output;
  TouchOutcome outcome;
  outcome.trace.period_s = session.period_s();
  const double n_per_nn = session.station().config().scaling.hand_force_n(Vec3::UnitX()).x();
  std::int64_t touching = 0, clamped = 0;
  std::int64_t left = std::llround(run.after_s / session.period_s());
  for (std::int64_t k = 0; k < run.ticks_max; ++k) {
    const recording::Sample& row = session.step();
    slave::SlaveInput input;
    // While the station is held or stopped its target stands still: so does the tip.
    input.follow = row.station_mode == static_cast<std::uint32_t>(station::Mode::kEngaged);
    input.tip_target_pos_w_nm = vec3(row.tip_target_w_nm);
    truth->step(input, row.dt_s, output);
    if (!run.session.hand && !session.device().motion_started()) continue;
    const bool touches = output.contact_state == link::ContactState::kContact;
    outcome.trace.rows.push_back(
        {vec3(row.hand_force_applied_h_n), n_per_nn * output.force_w_nn, vec3(row.hand_pos_h_m), touches});
    touching += touches;
    clamped += touches && (row.limit_flags & recording::kLimitClamp) != 0;
    if (outcome.stopped_s < 0 && (row.limit_flags & recording::kLimitStop) != 0) {
      outcome.stopped_s = session.period_s() * static_cast<double>(outcome.trace.rows.size());
      outcome.stop_faults = row.station_faults;
    }
    if (session.done() && --left < 0) break;
  }
  if (touching > 0) outcome.clamped_share = static_cast<double>(clamped) / static_cast<double>(touching);
  return outcome;
}

}  // namespace telenano::studies::fidelity

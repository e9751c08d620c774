#include "tests/studies/fidelity/touch_run.h"

#include <cmath>
#include <utility>
#include <vector>

#include "telenano/nve_server/slave/nve_slave.h"

namespace telenano::studies::fidelity {
namespace {

Vec3 vec3(const recording::Xyz& v) {
  return {v[0], v[1], v[2]};
}

struct Executed {
  slave::SlaveInput input;
  double dt_s = 0;
};

/// The server's slave, with a recorder at its port: behind link, session and server, so that the truth knows
/// nothing of what the station made of it.
class RecordedSlave final : public slave::Slave {
 public:
  RecordedSlave(std::unique_ptr<slave::Slave> slave, std::shared_ptr<std::vector<Executed>> log)
      : slave_(std::move(slave)), log_(std::move(log)) {}
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    log_->push_back({input, dt_s});
    slave_->step(input, dt_s, output);
  }
  const slave::SlaveLimits& limits() const noexcept override { return slave_->limits(); }
  std::uint64_t state_hash() const noexcept override { return slave_->state_hash(); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return slave_->save(out); }
  bool load(std::span<const std::uint8_t> bytes) noexcept override { return slave_->load(bytes); }
  void reset() noexcept override { slave_->reset(); }
  std::size_t snapshot_bytes_max() const noexcept override { return slave_->snapshot_bytes_max(); }

 private:
  std::unique_ptr<slave::Slave> slave_;
  std::shared_ptr<std::vector<Executed>> log_;
};

/// What one tick did, until the truth is known.
struct Tick {
  std::uint64_t step = 0;  // the last one logged by then
  Vec3 target_w_nm = Vec3::Zero();
  std::uint32_t limit_flags = 0;
};

/// ψ′ before contact, as it is written down, by a slave that has not been told of it.
double companded(const control::CompandingConfig& companding, const slave::Slave& truth,
                 const slave::SlaveOutput& output) noexcept {
  const auto* const nve = dynamic_cast<const slave::NveSlave*>(&truth);
  if (!companding.on() || nve == nullptr || output.contact_state == link::ContactState::kContact ||
      !(nve->stored_aj() < 0))
    return 1;
  const double u = -nve->stored_aj() / companding.energy_aj;
  return 1 + (companding.gain - 1) / ((1 + u) * (1 + u));
}

/// The target travels on a grid; what is further from it than this is another step.
constexpr double kSameStepNm = 0.01;

}  // namespace

TouchOutcome run_touch(const TouchRun& run) {
  support::VirtualSessionConfig config = run.session;
  const auto log = std::make_shared<std::vector<Executed>>();
  if (run.by_executed_log) {
    config.make_slave = [make = run.session.make_slave, log] {
      return std::make_unique<RecordedSlave>(make(), log);
    };
  }
  support::VirtualSession session(config);
  const std::unique_ptr<slave::Slave> truth = run.make_truth();
  slave::SlaveOutput output;
  TouchOutcome outcome;
  outcome.trace.period_s = session.period_s();
  const double n_per_nn = session.station().config().scaling.hand_force_n(Vec3::UnitX()).x();
  std::vector<Tick> ticks;
  std::int64_t left = std::llround(run.after_s / session.period_s());
  for (std::int64_t k = 0; k < run.ticks_max; ++k) {
    const recording::Sample& row = session.step();
    if (!run.by_executed_log) {
      slave::SlaveInput input;
      // While the station is held or stopped its target stands still: so does the tip.
      input.follow = row.station_mode == static_cast<std::uint32_t>(station::Mode::kEngaged);
      input.tip_target_pos_w_nm = vec3(row.tip_target_w_nm);
      truth->step(input, row.dt_s, output);
    }
    if (!run.session.hand && !session.device().motion_started()) continue;
    ticks.push_back({session.client().next_step() - 1, vec3(row.tip_target_w_nm), row.limit_flags});
    outcome.trace.rows.push_back({vec3(row.hand_force_applied_h_n),
                                  n_per_nn * companded(run.companding, *truth, output) * output.force_w_nn,
                                  vec3(row.hand_pos_h_m),
                                  output.contact_state == link::ContactState::kContact});
    if (outcome.stopped_s < 0 && (row.limit_flags & recording::kLimitStop) != 0) {
      outcome.stopped_s = session.period_s() * static_cast<double>(outcome.trace.rows.size());
      outcome.stop_faults = row.station_faults;
    }
    if (session.done() && --left < 0) break;
  }
  if (run.by_executed_log) {
    std::size_t done = 0;
    for (std::size_t i = 0; i < ticks.size(); ++i) {
      for (; done < log->size() && done < ticks[i].step; ++done)
        truth->step((*log)[done].input, (*log)[done].dt_s, output);
      const bool executed =
          ticks[i].step > 0 && ticks[i].step <= log->size() &&
          ((*log)[ticks[i].step - 1].input.tip_target_pos_w_nm - ticks[i].target_w_nm).norm() < kSameStepNm;
      if (!executed) ++outcome.unexecuted;
      outcome.trace.rows[i].true_h_n =
          n_per_nn * companded(run.companding, *truth, output) * output.force_w_nn;
      outcome.trace.rows[i].touches = output.contact_state == link::ContactState::kContact;
    }
    outcome.executed = static_cast<std::int64_t>(log->size());
  }
  const link::LinkQuality q = session.client().quality(session.now_ns());
  const auto left_out = static_cast<double>(q.replies_left_out);
  if (left_out > 0)
    outcome.left_out_share = left_out / (left_out + static_cast<double>(q.replies + q.replies_lost));
  std::int64_t touching = 0, clamped = 0;
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    touching += outcome.trace.rows[i].touches;
    clamped += outcome.trace.rows[i].touches && (ticks[i].limit_flags & recording::kLimitClamp) != 0;
  }
  if (touching > 0) outcome.clamped_share = static_cast<double>(clamped) / static_cast<double>(touching);
  return outcome;
}

}  // namespace telenano::studies::fidelity

#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "telenano/nve_server/slave/slave.h"
#include "tests/studies/stress/port_watch.h"
#include "tests/studies/stress/record_watch.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/wrong_slave.h"

namespace telenano::studies::stress {

/// What the slaves of a run did, one after the other: they live in the server.
struct SlaveWatch {
  Vec3 commanded_w_nm = Vec3::Zero();
  Vec3 force_w_nn = Vec3::Zero();
  bool touches = false;
  bool retracted = false;
  double most_force_nn = 0;  ///< ever, norm
  /// In less out by commands, of all slaves, withdrawals left out: what was stored in one that died was lost.
  double net_in_aj = 0;
  /// Most that each slave had ever given, net, summed over the slaves: how deep the sample's potential is
  /// below where it began, U₀ − U_min, and once more for each slave that began anew.
  double well_aj = 0;
  std::int64_t touched = 0;                    ///< how often the tip came into contact
  bool sums_fell = false;                      ///< an energy sum of one slave became smaller
  double energy_in_aj = 0, energy_out_aj = 0;  ///< of the slave that there is
  double time_s = 0;                           ///< all steps together
  bool non_finite = false;
  bool keeps_said = false;              ///< all that the slave has ever said, where that is asked for:
  std::vector<RecordWatch::Said> said;  ///< after each step
  bool sums_are_work = true;            ///< of each slave (port_watch.h)
  std::vector<Vec3>
      follows_w_nm;    ///< where it was told to go since the last look, in the steps in which it follows
  bool rises = false;  ///< the commanded end goes up as fast as it should, or is where it can go no higher
};

/// A slave that is watched; and one that is wrong, where that is asked for.
class WatchedSlave final : public slave::Slave {
 public:
  /// `rise_nm_s`: how fast it says that it withdraws.
  WatchedSlave(std::unique_ptr<slave::Slave> inner, std::shared_ptr<SlaveWatch> watch, Mutant mutant,
               double rise_nm_s)
      : inner_(std::move(inner)),
        watch_(std::move(watch)),
        wrong_(mutant),
        port_(inner_->limits().well_aj),
        rise_nm_s_(rise_nm_s) {}

  void step(const slave::SlaveInput& told, double dt_s, slave::SlaveOutput& output) noexcept override {
    slave::SlaveInput input = told;
    wrong_.before(inner_->limits(), dt_s, input);
    if (input.follow && !input.retract) watch_->follows_w_nm.push_back(input.tip_target_pos_w_nm);
    inner_->step(input, dt_s, output);
    wrong_.after(dt_s, output);
    SlaveWatch& w = *watch_;
    port_.step(output);
    w.sums_are_work = w.sums_are_work && port_.is_true();
    constexpr double kOfItsSpeed = 0.5;  // at the least
    const double risen_nm = output.commanded_pos_w_nm.z() - commanded_z_w_nm_;
    w.rises = (risen_nm > 0 && risen_nm >= kOfItsSpeed * rise_nm_s_ * dt_s) ||
              output.commanded_pos_w_nm.z() >= inner_->limits().workspace_max_w_nm.z();
    commanded_z_w_nm_ = output.commanded_pos_w_nm.z();
    w.commanded_w_nm = output.commanded_pos_w_nm;
    w.force_w_nn = output.force_w_nn;
    if (w.keeps_said) w.said.push_back({output.force_w_nn, output.tip_pos_w_nm, output.deflection_nm});
    const bool touches = output.contact_state == link::ContactState::kContact;
    w.touched += touches && !touches_;
    w.touches = touches_ = touches;
    w.retracted = input.retract;
    w.most_force_nn = std::max(w.most_force_nn, output.force_w_nn.norm());
    // What pulls a sticking tip off in a withdrawal is the slave's own drive: nobody at a port has put that
    // in.
    if (!input.retract) w.net_in_aj += (output.energy_in_aj - in_aj_) - (output.energy_out_aj - out_aj_);
    w.sums_fell = w.sums_fell || output.energy_in_aj < in_aj_ || output.energy_out_aj < out_aj_;
    w.non_finite = w.non_finite || !is_finite(output.force_w_nn) || !std::isfinite(output.energy_in_aj) ||
                   !std::isfinite(output.energy_out_aj) || !is_finite(output.tip_pos_w_nm);
    w.energy_in_aj = in_aj_ = output.energy_in_aj;
    w.energy_out_aj = out_aj_ = output.energy_out_aj;
    w.time_s += dt_s;
    if (out_aj_ - in_aj_ > given_aj_) {
      w.well_aj += out_aj_ - in_aj_ - given_aj_;
      given_aj_ = out_aj_ - in_aj_;
    }
  }
  const slave::SlaveLimits& limits() const noexcept override { return inner_->limits(); }
  std::uint64_t state_hash() const noexcept override { return inner_->state_hash(); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return inner_->save(out); }
  std::size_t snapshot_bytes_max() const noexcept override { return inner_->snapshot_bytes_max(); }

 private:
  std::unique_ptr<slave::Slave> inner_;
  std::shared_ptr<SlaveWatch> watch_;
  WrongSlave wrong_;
  PortWatch port_;
  double rise_nm_s_;
  double commanded_z_w_nm_ = 0;
  bool touches_ = false;
  double in_aj_ = 0, out_aj_ = 0;
  double given_aj_ = 0;  // most ever, net
};

}  // namespace telenano::studies::stress

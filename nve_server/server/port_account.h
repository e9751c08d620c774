#pragma once

#include <algorithm>

#include "telenano/nve_server/slave/slave.h"

namespace telenano::server {

/// One session's part of the account of a tip that others move too, aJ: what was exchanged while the session
/// held it. Both sums only rise, and stand still while it observes, so that taking over neither credits nor
/// charges anybody.
///
/// What another operator has put into springs and contact may come out when this one lets go. It is not this
/// one's energy: until the tip has been free (contact state free: nothing is pressed or stuck) once, out is
/// credited only as far as this session has put in since it took over. The rest is nobody's, which errs on
/// the passive side.
class PortAccount {
 public:
  /// The session gets a tip that another one has moved last.
  void take_over(const slave::SlaveOutput& now) noexcept {
    others_ = now.contact_state != link::ContactState::kFree;
    own_aj_ = 0;
  }

  /// A step that the session has caused.
  void add(const slave::SlaveOutput& last, const slave::SlaveOutput& now) noexcept {
    const double put_in_aj = std::max(0.0, now.energy_in_aj - last.energy_in_aj);
    double came_out_aj = std::max(0.0, now.energy_out_aj - last.energy_out_aj);
    in_aj_ += put_in_aj;
    if (others_) {
      own_aj_ += put_in_aj;
      came_out_aj = std::min(came_out_aj, own_aj_);
      own_aj_ -= came_out_aj;
      others_ = now.contact_state != link::ContactState::kFree;
    }
    out_aj_ += came_out_aj;
  }

  /// For who replays a session, and knows what it had said.
  void set(double in_aj, double out_aj) noexcept {
    in_aj_ = in_aj;
    out_aj_ = out_aj;
  }

  double in_aj() const noexcept { return in_aj_; }
  double out_aj() const noexcept { return out_aj_; }

  /// The slave's output as this session is to see it.
  slave::SlaveOutput seen(slave::SlaveOutput output) const noexcept {
    output.energy_in_aj = in_aj_;
    output.energy_out_aj = out_aj_;
    return output;
  }

 private:
  double in_aj_ = 0;
  double out_aj_ = 0;
  double own_aj_ = 0;  // put in since the take-over and not come out again
  bool others_ = false;
};

}  // namespace telenano::server

#pragma once

#include "telenano/common/base/random.h"
#include "telenano/common/recording/sample.h"
#include "tests/studies/stress/invariants.h"
#include "tests/studies/stress/run_spec.h"
#include "tests/studies/stress/stress_hand.h"
#include "tests/studies/stress/watched_slave.h"
#include "tests/support/virtual_session.h"

namespace telenano::studies::stress {

/// What goes wrong in a run besides the delay: from the first established session on, by the run's seed.
class FaultInjection {
 public:
  FaultInjection(const RunSpec& spec, support::VirtualSession& session);

  /// Of the next tick.
  int periods() noexcept;
  /// After it. `t_s`: of the hand's motion.
  void step(const recording::Sample& row, const StressHand& hand, const SlaveWatch& slave, double t_s,
            InvariantWatch& invariants) noexcept;
  bool down() const noexcept { return outage_ || dead_; }
  /// So long nothing has come through an outage that is under way.
  double silent_s() const noexcept { return silent_s_; }
  /// Apart from outages and restarts nothing is lost and the station is in time.
  bool clean_besides() const noexcept {
    return spec_.loss == 0 && spec_.drops == Drops::kNone && spec_.late == 0;
  }

 private:
  bool dies_now(const SlaveWatch& slave, double t_s) noexcept;

  const RunSpec& spec_;
  support::VirtualSession& session_;
  Random random_;
  double outage_at_s_ = 2;
  double last_death_s_ = 0;
  double back_at_s_ = 0;
  int leaps_ = 0;
  bool outage_ = false, dead_ = false;
  double silent_s_ = 0;
  std::int64_t touched_ = 0;
  double contact_s_ = -1;
  double last_pos_m_ = 0;
};

}  // namespace telenano::studies::stress

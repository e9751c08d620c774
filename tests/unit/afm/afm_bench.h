#pragma once

#include <optional>

#include "telenano/nve_server/afm/afm_logic.h"
#include "telenano/nve_server/afm_sim/default_scene.h"
#include "tests/support/virtual_afm.h"

namespace telenano::afm {

using support::VirtualAfm;

inline constexpr std::int64_t kMs = 1'000'000;

/// The logic and a simulated controller in virtual time, and what a session wishes.
struct Bench {
  AfmConfig config;
  afm_sim::SimConfig rig;
  std::optional<VirtualAfm> afm;
  PortTarget wish;

  VirtualAfm& start() {
    afm.emplace(config, rig, afm_sim::default_scene());
    return *afm;
  }
  Phase phase() const { return afm->logic().state().phase; }
  bool until(Phase wanted, std::int64_t most_ms = 30000) {
    for (std::int64_t end = afm->now_ns() + most_ms * kMs; afm->now_ns() < end;) {
      if (phase() == wanted) return true;
      run(1);
    }
    return phase() == wanted;
  }
  void run(std::int64_t ms) {
    for (std::int64_t end = afm->now_ns() + ms * kMs; afm->now_ns() < end;) {
      if (wish.session != 0) wish.time_ns = afm->now_ns();
      afm->advance_to(afm->now_ns() + kMs, wish);
    }
  }
  void follow(const Vec3& target) {
    wish.session = 1;
    wish.follow = true;
    wish.target_w_nm = target;
  }
};

}  // namespace telenano::afm

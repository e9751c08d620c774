#include "tests/support/virtual_afm_slave.h"

#include <algorithm>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::support {

VirtualAfmSlave::VirtualAfmSlave(const VirtualAfm& ready)
    : afm_(ready), slave_(ready.logic().config(), exchange_, clock_) {
  clock_.advance_to(afm_.now_ns());
  exchange_->store_state(afm_.logic().state());
}

void VirtualAfmSlave::idle(double dt_s) noexcept {
  exchange_->load_wish(wish_);
  clock_.advance_to(clock_.now_ns() + static_cast<std::int64_t>(dt_s * 1e9));
  afm_.advance_to(clock_.now_ns(), wish_);
  exchange_->store_state(afm_.logic().state());
}

void VirtualAfmSlave::step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept {
  idle(dt_s >= 0 ? std::min(dt_s, 1.0) : 0.0);
  slave_.step(input, dt_s, output);
}

VirtualAfm approached(const afm::AfmConfig& config, const afm_sim::SimConfig& rig,
                      const std::shared_ptr<const scene::Scene>& scene, std::uint64_t seed) {
  VirtualAfm afm(config, rig, scene, seed);
  constexpr std::int64_t kLongNs = 120'000'000'000;
  const afm::PortTarget nothing;
  while (afm.logic().state().phase != afm::Phase::kFollowing) {
    if (afm.now_ns() > kLongNs || !afm.logic().refusal().empty())
      throw RunError("the simulated AFM did not approach: " + std::string(name(afm.logic().state().phase)) +
                     " " + afm.logic().refusal() + " " + afm.logic().news());
    afm.advance_to(afm.now_ns() + 1'000'000, nothing);
  }
  return afm;
}

}  // namespace telenano::support

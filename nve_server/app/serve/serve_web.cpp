#include "telenano/nve_server/app/serve/serve_web.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace telenano::app {
namespace {

constexpr double kPeriodS = 1.0 / 60;
constexpr int kQuietPictures = 30;  // a second: the tip is in nobody's hand

class WatchedSlave final : public slave::Slave {
 public:
  WatchedSlave(std::unique_ptr<slave::Slave> inner, std::shared_ptr<web::TipSlots> slots,
               web::TipSlots::Slot& slot)
      : inner_(std::move(inner)), slots_(std::move(slots)), slot_(slot) {
    slot_.value.store({});
  }
  ~WatchedSlave() override { slot_.taken.store(false, std::memory_order_release); }

  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    inner_->step(input, dt_s, output);
    since_s_ += dt_s;
    if (since_s_ < kPeriodS) return;
    since_s_ = 0;
    web::TipView view;
    for (int i = 0; i < 3; ++i) {
      view.tip_pos_w_nm[static_cast<std::size_t>(i)] = output.tip_pos_w_nm[i];
      view.force_w_nn[static_cast<std::size_t>(i)] = output.force_w_nn[i];
    }
    view.contact_state = static_cast<std::uint32_t>(output.contact_state);
    view.fault_bits = output.fault_bits;
    view.moved = true;
    slot_.value.store(view);
  }
  const slave::SlaveLimits& limits() const noexcept override { return inner_->limits(); }
  std::uint64_t state_hash() const noexcept override { return inner_->state_hash(); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return inner_->save(out); }
  bool load(std::span<const std::uint8_t> bytes) noexcept override { return inner_->load(bytes); }
  void reset() noexcept override { inner_->reset(); }
  std::size_t snapshot_bytes_max() const noexcept override { return inner_->snapshot_bytes_max(); }

 private:
  std::unique_ptr<slave::Slave> inner_;
  std::shared_ptr<web::TipSlots> slots_;
  web::TipSlots::Slot& slot_;
  double since_s_ = kPeriodS;
};

/// JSON knows no NaN: a number that is none is zero here, and the fault bits say why.
double finite(double value) {
  return std::isfinite(value) ? value : 0.0;
}

}  // namespace

std::function<std::unique_ptr<slave::Slave>()> watched(std::function<std::unique_ptr<slave::Slave>()> make,
                                                       std::shared_ptr<web::TipSlots> slots) {
  return [make = std::move(make), slots = std::move(slots)]() -> std::unique_ptr<slave::Slave> {
    auto inner = make();
    if (!inner) return inner;
    web::TipSlots::Slot* const slot = slots->take();
    if (slot == nullptr) return inner;
    return std::make_unique<WatchedSlave>(std::move(inner), slots, *slot);
  };
}

std::string WebState::next() {
  std::string tips;
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    const web::TipSlots::Slot& slot = slots_->slots()[i];
    Seen& seen = seen_[i];
    const std::uint64_t count = slot.value.count();
    seen.quiet = count != seen.count ? 0 : std::min(seen.quiet + 1, 1000);
    seen.count = count;
    web::TipView v;
    if (seen.quiet > kQuietPictures || !slot.taken.load(std::memory_order_acquire) ||
        !slot.value.try_load(v) || !v.moved)
      continue;
    tips += fmt::format(R"({}{{"p":[{},{},{}],"f":[{},{},{}],"c":{},"e":{}}})", tips.empty() ? "" : ",",
                        finite(v.tip_pos_w_nm[0]), finite(v.tip_pos_w_nm[1]), finite(v.tip_pos_w_nm[2]),
                        finite(v.force_w_nn[0]), finite(v.force_w_nn[1]), finite(v.force_w_nn[2]),
                        v.contact_state, v.fault_bits);
  }
  return fmt::format(R"({{"mode":"{}","sessions":{},"tips":[{}]}})", afm_ ? "AFM" : "SIM",
                     workers_.status().sessions, tips);
}

}  // namespace telenano::app

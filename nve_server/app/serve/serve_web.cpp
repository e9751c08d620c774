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
    slot_.set_heights(inner_->heights());
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
  bool say_again(slave::SlaveOutput& output) noexcept override { return inner_->say_again(output); }
  slave::UndoResult undo_marks(std::uint64_t of, slave::SlaveOutput& output) noexcept override {
    return inner_->undo_marks(of, output);
  }
  std::size_t snapshot_bytes_max() const noexcept override { return inner_->snapshot_bytes_max(); }
  std::shared_ptr<const surface::HeightView> heights() const override { return inner_->heights(); }

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

/// Between the four nodes round a place; beyond the rim as at the rim.
double height_nm(const surface::HeightView& view, double x_w_nm, double y_w_nm) {
  const surface::HeightGrid& place = view.place();
  const double c = std::clamp((x_w_nm - place.x_first_nm) / place.dx_nm, 0.0, place.columns - 1.0);
  const double r = std::clamp((y_w_nm - place.y_first_nm) / place.dy_nm, 0.0, place.rows - 1.0);
  const int c0 = std::min(static_cast<int>(c), place.columns - 2);
  const int r0 = std::min(static_cast<int>(r), place.rows - 2);
  const auto along = [&](int row) {
    return std::lerp(static_cast<double>(view.height_nm(c0, row)),
                     static_cast<double>(view.height_nm(c0 + 1, row)), c - c0);
  };
  return std::lerp(along(r0), along(r0 + 1), r - r0);
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
  bool first = true;
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
    if (std::exchange(first, false)) look_at(slot.heights());
    tips += fmt::format(R"({}{{"p":[{},{},{}],"f":[{},{},{}],"c":{},"e":{}}})", tips.empty() ? "" : ",",
                        finite(v.tip_pos_w_nm[0]), finite(v.tip_pos_w_nm[1]), finite(v.tip_pos_w_nm[2]),
                        finite(v.force_w_nn[0]), finite(v.force_w_nn[1]), finite(v.force_w_nn[2]),
                        v.contact_state, v.fault_bits);
  }
  const std::string marks = changes_ > 0 ? fmt::format(R"(,"marks":{})", changes_) : "";
  return fmt::format(R"({{"mode":"{}","sessions":{},"tips":[{}]{}}})", afm_ ? "AFM" : "SIM",
                     workers_.status().sessions, tips, marks);
}

void WebState::look_at(std::shared_ptr<const surface::HeightView> view) {
  const std::uint64_t version = view ? view->version() : 0;
  // A sample without marks looks as the scene's own does.
  if (version == 0) view.reset();
  if (view == shown_ && version == shown_version_) return;
  shown_ = std::move(view);
  shown_version_ = version;
  ++changes_;
}

surface::HeightGrid WebState::heights() const {
  surface::HeightGrid grid = unmarked_;
  if (!shown_) return grid;
  std::size_t i = 0;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column)
      grid.z_nm[i++] =
          height_nm(*shown_, grid.x_first_nm + column * grid.dx_nm, grid.y_first_nm + row * grid.dy_nm);
  }
  return grid;
}

}  // namespace telenano::app

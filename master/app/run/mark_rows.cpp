#include "telenano/master/app/run/mark_rows.h"

#include <array>

namespace telenano::app {

using recording::MarkRow;
using surface::HeightGrid;
using surface::HeightView;

bool MarkRows::is_told_of(const HeightGrid& place) const noexcept {
  return told_.columns == place.columns && told_.rows == place.rows && told_.dx_nm == place.dx_nm &&
         told_.dy_nm == place.dy_nm && told_.x_first_nm == place.x_first_nm &&
         told_.y_first_nm == place.y_first_nm;
}

void MarkRows::tell_of(const HeightView& view, std::vector<MarkRow>& rows) {
  told_ = view.place();
  const double flat_nm = view.height_nm(0, 0);
  // In the order of recording::MarkPlace.
  const std::array<double, recording::kMarkPlaces> values = {static_cast<double>(told_.columns),
                                                             static_cast<double>(told_.rows),
                                                             told_.dx_nm,
                                                             told_.dy_nm,
                                                             told_.x_first_nm,
                                                             told_.y_first_nm,
                                                             flat_nm};
  for (std::uint32_t i = 0; i < values.size(); ++i) rows.push_back({0, MarkRow::kPlace, i, values[i]});
  const HeightGrid scene = sample_.scene();
  if (scene.columns == told_.columns && scene.rows == told_.rows && !scene.z_nm.empty()) {
    known_.assign(scene.z_nm.begin(), scene.z_nm.end());
  } else {
    known_.assign(static_cast<std::size_t>(told_.columns) * static_cast<std::size_t>(told_.rows),
                  static_cast<float>(flat_nm));
  }
}

void MarkRows::set(Sample sample) {
  const std::lock_guard lock(mutex_);
  sample_ = std::move(sample);
  seen_ = nullptr;
}

void MarkRows::newest(std::vector<MarkRow>& rows) {
  const std::lock_guard lock(mutex_);
  const HeightView* const view = sample_.heights ? sample_.heights() : nullptr;
  if (view == nullptr) return;
  const std::uint64_t version = view->version();
  if ((view == seen_ && version == version_) || (version == 0 && told_.columns == 0)) return;
  seen_ = view;
  version_ = version;
  const std::size_t before = rows.size();
  const bool tells = !is_told_of(view->place());
  if (tells) tell_of(*view, rows);
  const std::size_t told = rows.size();
  std::size_t node = 0;
  for (int row = 0; row < view->rows(); ++row) {
    for (int column = 0; column < view->columns(); ++column, ++node) {
      const float height = view->height_nm(column, row);
      if (height == known_[node]) continue;
      known_[node] = height;
      rows.push_back({0, static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row),
                      static_cast<double>(height)});
    }
  }
  if (!tells || rows.size() > told) return;
  rows.resize(before);  // a version without a mark, as after a state that was taken over
  told_ = {};
}

}  // namespace telenano::app

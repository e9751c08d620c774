#include "telenano/master/view_model/marked_ground.h"

#include <cmath>
#include <utility>

namespace telenano::view_model {

using recording::MarkPlace;
using recording::MarkRow;

MarkedGround::MarkedGround(surface::HeightGrid scene, std::vector<MarkRow> rows)
    : scene_(std::move(scene)), rows_(std::move(rows)) {}

bool MarkedGround::move_to(double time_s) {
  bool changed = false;
  if (next_ > 0 && time_s < time_s_) {
    changed = placed_;
    next_ = 0;
    read_ = 0;
    placed_ = false;
  }
  time_s_ = time_s;
  for (; next_ < rows_.size() && rows_[next_].time_s <= time_s; ++next_) {
    apply(rows_[next_]);
    changed = true;
  }
  return changed;
}

void MarkedGround::apply(const MarkRow& row) {
  if (row.column == MarkRow::kPlace) {
    if (row.row == 0) read_ = 0;
    if (row.row != read_ || row.row >= recording::kMarkPlaces) return;
    values_[read_++] = row.value;
    if (read_ == recording::kMarkPlaces) place();
    return;
  }
  if (!placed_ || row.column >= static_cast<std::uint32_t>(grid_.columns) ||
      row.row >= static_cast<std::uint32_t>(grid_.rows) || !std::isfinite(row.value))
    return;
  grid_.z_nm[std::size_t{row.row} * static_cast<std::size_t>(grid_.columns) + row.column] = row.value;
}

void MarkedGround::place() {
  const auto value = [this](MarkPlace which) { return values_[static_cast<std::size_t>(which)]; };
  placed_ = false;
  const double columns = value(MarkPlace::kColumns), rows = value(MarkPlace::kRows);
  if (!(columns >= 2) || !(rows >= 2) || !(columns * rows <= static_cast<double>(kNodesMost))) return;
  for (const double v : values_)
    if (!std::isfinite(v)) return;
  if (!(value(MarkPlace::kDx) > 0) || !(value(MarkPlace::kDy) > 0)) return;
  grid_.columns = static_cast<int>(columns);
  grid_.rows = static_cast<int>(rows);
  grid_.dx_nm = value(MarkPlace::kDx);
  grid_.dy_nm = value(MarkPlace::kDy);
  grid_.x_first_nm = value(MarkPlace::kXFirst);
  grid_.y_first_nm = value(MarkPlace::kYFirst);
  const bool same = scene_.columns == grid_.columns && scene_.rows == grid_.rows && !scene_.z_nm.empty();
  const std::size_t nodes = static_cast<std::size_t>(grid_.columns) * static_cast<std::size_t>(grid_.rows);
  grid_.z_nm = same ? scene_.z_nm : std::vector<double>(nodes, value(MarkPlace::kFlat));
  placed_ = true;
}

}  // namespace telenano::view_model

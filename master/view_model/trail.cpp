#include "telenano/master/view_model/trail.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace telenano::view_model {

Trail::Trail(std::size_t capacity, double step_nm) : step_nm_(step_nm), points_(capacity) {}

void Trail::add(const Vec3& tip_pos_w_nm, bool contact) noexcept {
  if (!is_finite(tip_pos_w_nm)) return;
  if (count_ > 0) {
    const Point& newest = point(count_ - 1);
    if (newest.contact == contact && (newest.pos_w_nm - tip_pos_w_nm).norm() < step_nm_) return;
  }
  points_[next_] = {tip_pos_w_nm, contact};
  next_ = (next_ + 1) % points_.size();
  count_ = std::min(count_ + 1, points_.size());
}

TouchedGround::TouchedGround(std::size_t capacity, double cell_nm)
    : cell_nm_(cell_nm), capacity_(capacity), slots_(std::bit_ceil(2 * capacity), 0) {
  points_.reserve(capacity);
}

void TouchedGround::add(const Vec3& tip_pos_w_nm) {
  if (!is_finite(tip_pos_w_nm)) return;
  const double column = std::floor(tip_pos_w_nm.x() / cell_nm_);
  const double row = std::floor(tip_pos_w_nm.y() / cell_nm_);
  if (std::abs(column) > 1e9 || std::abs(row) > 1e9) return;
  const auto cell_of = [this](const Vec3& p) {
    return std::pair{std::floor(p.x() / cell_nm_), std::floor(p.y() / cell_nm_)};
  };
  const auto hash = static_cast<std::uint64_t>(static_cast<std::int64_t>(column)) * 0x9E3779B97F4A7C15u ^
                    static_cast<std::uint64_t>(static_cast<std::int64_t>(row)) * 0xC2B2AE3D27D4EB4Fu;
  const std::size_t mask = slots_.size() - 1;
  std::size_t slot = (hash ^ (hash >> 29)) & mask;
  while (slots_[slot] != 0) {
    Vec3& there = points_[slots_[slot] - 1];
    if (cell_of(there) == std::pair{column, row}) {
      there = tip_pos_w_nm;  // the newest touch counts: the ground may have changed
      return;
    }
    slot = (slot + 1) & mask;
  }
  if (points_.size() >= capacity_) return;
  lowest_nm_ = points_.empty() ? tip_pos_w_nm.z() : std::min(lowest_nm_, tip_pos_w_nm.z());
  highest_nm_ = points_.empty() ? tip_pos_w_nm.z() : std::max(highest_nm_, tip_pos_w_nm.z());
  points_.push_back(tip_pos_w_nm);
  slots_[slot] = static_cast<std::uint32_t>(points_.size());
}

}  // namespace telenano::view_model

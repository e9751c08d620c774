#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/base/vec3.h"

namespace telenano::view_model {

/// The way that the tip has gone, the newest points of it: one for every `step_nm` of way, or where contact
/// begins or ends.
class Trail {
 public:
  struct Point {
    Vec3 pos_w_nm = Vec3::Zero();
    bool contact = false;
  };

  Trail(std::size_t capacity, double step_nm);

  void add(const Vec3& tip_pos_w_nm, bool contact) noexcept;
  void clear() noexcept { count_ = 0; }

  std::size_t size() const noexcept { return count_; }
  /// 0 the oldest.
  const Point& point(std::size_t i) const noexcept {
    return points_[(next_ + points_.size() - count_ + i) % points_.size()];
  }

 private:
  double step_nm_;
  std::vector<Point> points_;
  std::size_t next_ = 0;
  std::size_t count_ = 0;
};

/// Where the tip has touched the sample, one point to a cell of a square grid: what a person feels out when
/// there is no scan. When full, touching goes on without new points.
class TouchedGround {
 public:
  TouchedGround(std::size_t capacity, double cell_nm);

  void add(const Vec3& tip_pos_w_nm);
  const std::vector<Vec3>& points_w_nm() const noexcept { return points_; }
  double lowest_nm() const noexcept { return lowest_nm_; }
  double highest_nm() const noexcept { return highest_nm_; }

 private:
  double cell_nm_;
  std::size_t capacity_;
  std::vector<Vec3> points_;
  std::vector<std::uint32_t> slots_;  // open addressing; 0 = empty, else index + 1
  double lowest_nm_ = 0;
  double highest_nm_ = 0;
};

}  // namespace telenano::view_model

#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "telenano/common/base/vec3.h"

namespace telenano::afm {

/// Where the base of the lever has been sent, and when: a reading of the force belongs to a stretch of it.
/// Commands hold until the next one. Keeps the last kKept; asked beyond them it answers for what it has.
class MotionHistory {
 public:
  void add(std::int64_t time_ns, const Vec3& pos_w_nm) noexcept {
    entries_[next_ % kKept] = {time_ns, pos_w_nm};
    ++next_;
  }
  void clear() noexcept { next_ = 0; }

  struct Stretch {
    double highest_nm = 0;         ///< largest z held
    double lowest_nm = 0;          ///< and least
    Vec3 low_w_nm = Vec3::Zero();  ///< likewise along each axis
    Vec3 high_w_nm = Vec3::Zero();
    double path_across_nm = 0;      ///< way travelled across
    double path_nm = 0;             ///< way travelled
    Vec3 mean_w_nm = Vec3::Zero();  ///< over time
  };
  /// From `from_ns` to `to_ns`; the position held at its beginning counts. Needs at least one entry.
  Stretch between(std::int64_t from_ns, std::int64_t to_ns) const noexcept {
    Stretch s;
    const std::size_t n = std::min(next_, kKept);
    if (n == 0) return s;
    s.high_w_nm.setConstant(-1e300);
    s.low_w_nm.setConstant(1e300);
    double time = 0;
    std::int64_t until_ns = to_ns;
    Vec3 later = Vec3::Zero();
    bool any = false;
    for (std::size_t i = 1; i <= n; ++i) {
      const Entry& e = entries_[(next_ - i) % kKept];
      if (e.time_ns > to_ns) continue;
      s.high_w_nm = s.high_w_nm.cwiseMax(e.pos_w_nm);
      s.low_w_nm = s.low_w_nm.cwiseMin(e.pos_w_nm);
      const double held = static_cast<double>(until_ns - std::max(e.time_ns, from_ns));
      s.mean_w_nm += held * e.pos_w_nm;
      time += held;
      if (any) {
        s.path_across_nm += (later - e.pos_w_nm).head<2>().norm();
        s.path_nm += (later - e.pos_w_nm).norm();
      }
      later = e.pos_w_nm;
      any = true;
      until_ns = std::max(e.time_ns, from_ns);
      if (e.time_ns <= from_ns) break;
    }
    s.highest_nm = s.high_w_nm.z();
    s.lowest_nm = s.low_w_nm.z();
    s.mean_w_nm = time > 0 ? Vec3(s.mean_w_nm / time) : later;
    return s;
  }

 private:
  struct Entry {
    std::int64_t time_ns = 0;
    Vec3 pos_w_nm = Vec3::Zero();
  };
  static constexpr std::size_t kKept = 1024;
  std::array<Entry, kKept> entries_{};
  std::size_t next_ = 0;
};

/// How deep each of the readings lets the base go: the highest of these bounds, over those that are no older
/// than so long before the newest. A reading costs a few comparisons: bounds that a newer one exceeds are gone.
class BoundHistory {
 public:
  void add(std::int64_t time_ns, double lowest_nm, std::int64_t keep_ns) noexcept {
    while (size_ > 0 && at(size_ - 1).lowest_nm <= lowest_nm) --size_;
    if (size_ == kKept) {
      at(size_ - 1).time_ns = time_ns;  // no room: the higher one of two stays for as long as both
    } else {
      at(size_++) = {time_ns, lowest_nm};
    }
    while (size_ > 0 && at(0).time_ns < time_ns - keep_ns) {
      ++first_;
      --size_;
    }
  }
  void clear() noexcept { size_ = 0; }
  double highest_nm() const noexcept { return size_ > 0 ? entries_[first_ % kKept].lowest_nm : -1e300; }

 private:
  struct Entry {
    std::int64_t time_ns = 0;
    double lowest_nm = 0;
  };
  Entry& at(std::size_t i) noexcept { return entries_[(first_ + i) % kKept]; }

  static constexpr std::size_t kKept = 128;  // 60 ms of 2000 readings a second
  std::array<Entry, kKept> entries_{};
  std::size_t first_ = 0, size_ = 0;
};

}  // namespace telenano::afm

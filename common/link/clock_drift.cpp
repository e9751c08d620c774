#include "telenano/common/link/clock_drift.h"

#include <algorithm>
#include <cmath>

namespace telenano::link {

bool ClockDrift::lower(const Point& a, const Point& b, double slope) noexcept {
  return a.value_ns - b.value_ns < slope * static_cast<double>(a.time_ns - b.time_ns);
}

void ClockDrift::merge(Block& into, const Block& from) const noexcept {
  if (from.rtt_ns < into.rtt_ns) {
    into.rtt_ns = from.rtt_ns;
    into.offset = from.offset;
  }
  if (lower(from.up, into.up, slope_)) into.up = from.up;
  if (lower(from.down, into.down, -slope_)) into.down = from.down;
}

void ClockDrift::add(std::int64_t now_ns, std::int64_t rtt_ns, std::int64_t up_ns,
                     std::int64_t down_ns) noexcept {
  const auto up = static_cast<double>(up_ns);
  const auto down = static_cast<double>(down_ns);
  const Block sample{now_ns, rtt_ns, {now_ns, 0.5 * (up - down)}, {now_ns, up}, {now_ns, down}};
  if (count_ > 0 && now_ns - blocks_[count_ - 1].start_ns < block_ns_) {
    merge(blocks_[count_ - 1], sample);
    return;
  }
  if (count_ > 0) close_block(now_ns);
  blocks_[count_++] = sample;
  find_lowest();
}

void ClockDrift::find_lowest() noexcept {
  if (count_ < 2) return;
  lowest_ = {blocks_[0].up, blocks_[0].down};
  for (std::size_t i = 1; i + 1 < count_; ++i) {
    if (lower(blocks_[i].up, lowest_.up, slope_)) lowest_.up = blocks_[i].up;
    if (lower(blocks_[i].down, lowest_.down, -slope_)) lowest_.down = blocks_[i].down;
  }
}

void ClockDrift::close_block(std::int64_t now_ns) noexcept {
  fit();
  if (count_ < kBlocks) return;
  if (block_ns_ < kBlockMaxNs) {
    for (std::size_t i = 0; i < kBlocks / 2; ++i) {
      Block joined = blocks_[2 * i];
      merge(joined, blocks_[2 * i + 1]);
      blocks_[i] = joined;
    }
    count_ = kBlocks / 2;
    block_ns_ *= 2;
  } else {
    std::shift_left(blocks_.begin(), blocks_.end(), 1);
    --count_;
  }
  // A pause longer than all blocks together says nothing about the time in between.
  if (now_ns - blocks_[count_ - 1].start_ns > static_cast<std::int64_t>(kBlocks) * kBlockMaxNs) count_ = 0;
}

void ClockDrift::fit() noexcept {
  if (count_ < 4) return;
  std::int64_t least_ns = INT64_MAX;
  for (std::size_t i = 0; i < count_; ++i) least_ns = std::min(least_ns, blocks_[i].rtt_ns);
  // Relative to the first block: offsets may be as large as the clocks' origins are apart.
  const Point& origin = blocks_[0].offset;
  const auto weigh = [&](const Block& b) {
    const double sigma_ns = kFloorNs + 0.5 * static_cast<double>(b.rtt_ns - least_ns);
    return 1 / (sigma_ns * sigma_ns);
  };
  double sum = 0, sum_t = 0, sum_y = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    const double w = weigh(blocks_[i]);
    sum += w;
    sum_t += w * static_cast<double>(blocks_[i].offset.time_ns - origin.time_ns);
    sum_y += w * (blocks_[i].offset.value_ns - origin.value_ns);
  }
  const double mean_t = sum_t / sum, mean_y = sum_y / sum;
  double moment = 0, product = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    const double w = weigh(blocks_[i]);
    const double t = static_cast<double>(blocks_[i].offset.time_ns - origin.time_ns) - mean_t;
    moment += w * t * t;
    product += w * t * (blocks_[i].offset.value_ns - origin.value_ns - mean_y);
  }
  if (!(moment > 0)) return;
  slope_ = product / moment;
  slope_error_ = std::sqrt(1 / moment);
  known_ = true;
}

double ClockDrift::base(std::int64_t now_ns, Point Block::*filling, const Point& closed,
                        double slope) const noexcept {
  if (count_ == 0) return 0;
  const double newest_ns = line_at(blocks_[count_ - 1].*filling, now_ns, slope);
  return count_ == 1 ? newest_ns : std::min(line_at(closed, now_ns, slope), newest_ns);
}

}  // namespace telenano::link

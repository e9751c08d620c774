#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::link {

/// How fast the peer's clock runs against ours, and what each way's delay is above its least, from round
/// trips. Fixed memory, no allocation.
///
/// The offset seen in one exchange, θ = ((T2 − T1) + (T3 − T4))/2, is wrong by half of the difference of the
/// two ways' delays. Queues only ever add delay, so the exchange with the least round trip of a stretch of
/// time has the least of that error (the minimum filter of NTP, RFC 5905 section 10). Time is cut into at
/// most kBlocks blocks, each keeping its quickest exchange; the drift is the slope of the weighted least
/// squares line through them, weight 1/σ², σ = kFloorNs + half of what its round trip is above the least of
/// all. When all blocks are used, neighbours are merged and blocks become twice as long, up to kBlockMaxNs;
/// from then on the oldest is forgotten.
///
/// One-way delays cannot be known without a common clock; their excess over the least can. The lower
/// envelope of (T2 − T1) is a line with the drift as slope; each block keeps its lowest point (along that
/// slope), and the base at time t is the lowest of their lines. Likewise downwards with (T4 − T3), whose
/// slope is the drift's negative.
///
/// Good for: clocks that drift steadily (crystals, ±200 ppm). A clock that is stepped makes the drift wrong
/// until the blocks before the step are forgotten; a path whose asymmetry changes looks like drift.
class ClockDrift {
 public:
  void reset() noexcept { *this = {}; }

  /// One exchange: `now_ns` our clock at T4; `up_ns` = T2 − T1 and `down_ns` = T4 − T3, each with the clocks'
  /// unknown offset in it; `rtt_ns` = up + down.
  void add(std::int64_t now_ns, std::int64_t rtt_ns, std::int64_t up_ns, std::int64_t down_ns) noexcept;

  /// At least four blocks, a second: before, the drift counts as 0.
  bool known() const noexcept { return known_; }
  /// Peer's clock against ours, parts per million; positive: the peer's is the faster.
  double drift_ppm() const noexcept { return slope_ * 1e6; }
  /// Its standard error, if the blocks' errors were independent. Large while the link is young or busy.
  double drift_error_ppm() const noexcept { return slope_error_ * 1e6; }

  /// What T2 − T1 would be now over the idle link; likewise T4 − T3. 0 before the first exchange.
  double base_up_ns(std::int64_t now_ns) const noexcept {
    return base(now_ns, &Block::up, lowest_.up, slope_);
  }
  double base_down_ns(std::int64_t now_ns) const noexcept {
    return base(now_ns, &Block::down, lowest_.down, -slope_);
  }

  static constexpr std::size_t kBlocks = 32;
  static constexpr std::int64_t kBlockMinNs = 250'000'000;
  static constexpr std::int64_t kBlockMaxNs = 4'000'000'000;
  static constexpr double kFloorNs = 1000;  ///< of a single offset: time stamps, wake-ups

 private:
  struct Point {
    std::int64_t time_ns = 0;
    double value_ns = 0;
  };
  struct Block {
    std::int64_t start_ns = 0;
    std::int64_t rtt_ns = INT64_MAX;
    Point offset;  ///< of the exchange with that round trip
    Point up;
    Point down;
  };

  /// Of the blocks that are closed the one whose line is lowest; it stays so until another is closed.
  struct Lowest {
    Point up;
    Point down;
  };

  static double line_at(const Point& p, std::int64_t now_ns, double slope) noexcept {
    return p.value_ns + slope * static_cast<double>(now_ns - p.time_ns);
  }
  double base(std::int64_t now_ns, Point Block::*filling, const Point& closed, double slope) const noexcept;
  void find_lowest() noexcept;
  void close_block(std::int64_t now_ns) noexcept;
  void merge(Block& into, const Block& from) const noexcept;
  void fit() noexcept;
  static bool lower(const Point& a, const Point& b, double slope) noexcept;

  std::array<Block, kBlocks> blocks_{};
  std::size_t count_ = 0;  ///< the last of them is being filled
  Lowest lowest_;          ///< with two blocks and more
  std::int64_t block_ns_ = kBlockMinNs;
  bool known_ = false;
  double slope_ = 0;
  double slope_error_ = 0;
};

}  // namespace telenano::link

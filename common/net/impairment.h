#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "telenano/common/base/random.h"

namespace telenano::net {

/// Everything sent from start_ns on, for length_ns, is lost.
struct Outage {
  std::int64_t start_ns = 0;
  std::int64_t length_ns = 0;
};

/// What a measured link did from time_ns on, until the next row.
struct TraceRow {
  std::int64_t time_ns = 0;
  std::int64_t delay_ns = 0;
  bool lost = false;
};

/// What one direction of a link does to datagrams. Times are those of the link: ns since it began.
struct ImpairmentConfig {
  std::int64_t delay_ns = 0;
  std::int64_t jitter_ns =
      0;  ///< added to the delay: standard deviation of a half-normal, exponential mean, or width
  enum class Jitter : std::uint8_t { kUniform, kHalfNormal, kExponential } jitter = Jitter::kUniform;
  bool in_order = true;        ///< a late one delays those behind it (a queue); false: jitter reorders
  double loss = 0;             ///< mean probability
  double burst_datagrams = 1;  ///< mean length of a run of losses; 1 = independent, more = Gilbert–Elliott
  double duplicate = 0;        ///< probability of coming twice
  double reorder = 0;          ///< probability of being held back by reorder_ns, past those sent later
  std::int64_t reorder_ns = 2'000'000;
  bool down = false;  ///< an outage: everything sent is lost

  /// Mean time of a run of losses, whatever is sent meanwhile; 0: runs are counted in datagrams instead.
  std::int64_t burst_ns = 0;
  double corrupt = 0;   ///< probability that one bit, any, is the other one
  double truncate = 0;  ///< probability of being cut to any shorter length, 0 included
  /// Bits a second that the link carries, headers counted (kHeaderBytes); 0: no limit.
  double rate_bit_s = 0;
  /// Room before that link: bytes not yet sent, those of the datagram on its way out included. What does not
  /// fit is lost.
  std::int64_t queue_bytes = 65536;
  /// The delay grows by this much of the time: what a receiver sees whose clock is slow. Never below 0.
  double drift_ppm = 0;
  std::vector<Outage> outages{};
  /// Outages without a plan: mean time from the end of one to the next, and mean length (both exponential);
  /// 0: none. Their times come from the seed alone, not from what is sent.
  std::int64_t outage_gap_ns = 0;
  std::int64_t outage_length_ns = 0;
  /// Replayed: times rise from 0; the delay is added to delay_ns. After the last row, which holds as long as
  /// the one before it, the first one comes again. A single row holds for good.
  std::vector<TraceRow> trace{};
};

/// An IPv4 header and a UDP header: what a datagram weighs on the wire besides its bytes.
constexpr std::size_t kHeaderBytes = 28;

struct ImpairmentCounts {
  std::uint64_t sent = 0;
  std::uint64_t delivered = 0;
  std::uint64_t lost = 0;  ///< by loss, outage or a full queue: the sum of the lost_*
  std::uint64_t duplicated = 0;
  std::uint64_t reordered = 0;  ///< held back
  std::uint64_t corrupted = 0;
  std::uint64_t truncated = 0;
  std::uint64_t lost_chance = 0;
  std::uint64_t lost_outage = 0;
  std::uint64_t lost_trace = 0;
  std::uint64_t lost_rate = 0;  ///< the queue before a slow link was full
  std::uint64_t lost_room = 0;  ///< nowhere to keep it until it arrives
};

/// What becomes of one datagram: up to two copies.
struct Fate {
  struct Copy {
    std::int64_t arrival_ns = 0;
    std::size_t size = 0;  ///< bytes that arrive, from the first on
    bool corrupted = false;
    std::size_t byte = 0;   ///< where, if corrupted
    std::uint8_t mask = 0;  ///< to be xor-ed onto it
  };
  std::array<Copy, 2> copies{};
  std::size_t n = 0;
};

/// Decides, and counts what it decided (all but `delivered`); it neither keeps bytes nor reads a clock. The
/// same seed and the same questions give the same answers on every machine. Loss and outages come before the
/// rate limit: what they take does not use the link. A copy made by duplication passes the limit as well.
class Impairment {
 public:
  Impairment(ImpairmentConfig config, std::uint64_t seed);

  /// A datagram of `size` bytes, sent at `now_ns` (0 or more, not before the last one). Copies beyond `room`
  /// are lost.
  Fate send(std::size_t size, std::int64_t now_ns, std::size_t room) noexcept;

  ImpairmentConfig config;  ///< may be changed while running
  ImpairmentCounts counts;

 private:
  bool lost_by_chance(std::int64_t now_ns) noexcept;
  bool in_outage(std::int64_t now_ns) noexcept;
  const TraceRow* trace_row(std::int64_t now_ns) const noexcept;
  std::int64_t jitter_ns() noexcept;
  /// When the link has sent it; -1 if the queue has no room for it.
  std::int64_t leaves_ns(std::size_t size, std::int64_t now_ns) noexcept;
  void add_copy(Fate& fate, std::size_t size, std::int64_t now_ns, std::int64_t trace_delay_ns,
                std::size_t& room) noexcept;

  Random random_;
  Random outage_random_;
  std::int64_t last_in_order_ns_ = INT64_MIN;
  bool bad_ = false;
  std::int64_t state_at_ns_ = -1;  ///< of bad_, where runs are times; -1: no state yet
  double link_free_ns_ = 0;
  Outage next_outage_{};
  bool next_outage_known_ = false;
};

}  // namespace telenano::net

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::link {

struct RateControlConfig {
  bool adapts = true;     ///< false: `full_hz` is kept whatever the link does
  double full_hz = 1000;  ///< the most that is ever sent: one datagram a tick, or fewer if so asked
  double start_hz = 200;  ///< before the link is known; never above full_hz
  double least_hz = 50;   ///< the least: what a force needs that is held for 20 ms. Never above full_hz
  /// The least while every step of the twin is logged: a datagram carries up to 64 of them (kMaxBatch), and no force
  /// waits for it. At least as many as the steps need, full_hz / kStepsOfADatagram, and never above least_hz.
  double least_with_steps_hz = 20;
  std::size_t redundancy = 0;  ///< commands that a datagram repeats on a link that is not full
  double deadband_most = 4;    ///< a deadband of commands grows up to this factor, at least_hz
};

/// Why the rate is what it is. Stored in files: never renumber.
enum class RateReason : std::uint8_t {
  kFull,     ///< nothing limits it
  kStart,    ///< the link is not known yet
  kQueue,    ///< a queue stood on the way
  kLoss,     ///< more was lost than a link loses by chance
  kSilence,  ///< nothing came back
  kRising,   ///< after one of these, on the way up
  kFixed     ///< a person said which
};
const char* name(RateReason reason) noexcept;

/// What a reply says of how many datagrams there were, all counted from 1 or 0 in a session.
struct ReplyNumbers {
  std::uint64_t command = 0;   ///< that it answers
  std::uint64_t sequence = 0;  ///< its own
  std::uint64_t left_out = 0;  ///< replies without a number, until then (Reply::replies_left_out)

  /// Commands that the server has accepted.
  std::uint64_t accepted() const noexcept { return sequence + left_out; }
};

/// How many datagrams a second the station sends, and how much each of them repeats: as many as the link
/// carries without a queue. It adapts packets, never the tick: ticks without a datagram go with the next.
///
/// Signal: round trips less the server's hold time, against the least of the last 10 to 20 s (LEDBAT's base
/// delay, RFC 6817; both ways count, since each command brings a reply). A queue *stands* if the least
/// round trip of the last 50 ms is above that base by more than the target (CoDel's test, RFC 8289, 3.2):
/// jitter and a machine that stalls for less than this leave one quick exchange. The target is 4 ms, the time
/// between two datagrams, and three times the mean change from one round trip to the next, at most 12 ms. The
/// second part is what another station's datagrams on the same wire add without a queue, and lets whoever
/// sends less give way later, so that shares become equal. The third is jitter: a queue of one's own making
/// grows smoothly. A path that reorders, as one whose jitter is another for each datagram, is no queue at all: there
/// the third part may be 60 ms, and a command that another had overtaken, which a server drops, is not taken for lost: of
/// the way there nothing is known then, and it is taken to lose what the way back does, which is counted exactly.
///
/// Start: 200 Hz, doubled each round trip (20 ms at least) until a queue stands or the rate is the full one:
/// nobody floods a long link for as long as its first answer takes.
///
/// Answer: from a queue of q the rate becomes β times what the link was seen to carry (delivered replies, as
/// GCC does, draft-ietf-rmcat-gcc-02, 5.5), β = 1 − q/100 ms within 0.5 … 0.85: the queue drains within
/// about 0.2 s, and everybody sees the true base again. Then it rises by 40 Hz a second, faster the longer
/// nothing stands in its way (as CUBIC, RFC 9438). Additive up, multiplicative down: shares of those who see
/// the same queue become equal (Chiu and Jain, 1989).
///
/// Loss without a queue is the radio's: up to 10 % each way changes nothing (GCC, 5.6); beyond, the rate
/// falls by half of the loss. Silence halves it (RFC 8085, 3.1.1). Congestion is never answered by more
/// bytes: while a queue stands or the rate is held down by one, nothing is repeated. A round trip that stays
/// long at the least rate is no queue of ours: it becomes the base.
///
/// Replies that the server leaves out (ReplyGate) are no loss: commands are counted by the replies that there are or
/// that were left out, replies by their own numbers. The room that they leave is not for commands: when the force
/// moves, all replies come at once, and a rate that had risen into it would queue up. So while replies are left out the
/// rate stays below what was delivered when a queue stood last. After kProbeNs without a queue every reply is asked for
/// again, the rate rises as ever, and a queue, or the full rate, ends that. How much of the deadband for replies there
/// is follows how far the rate was lowered: none at the full rate, all of it at the least. None while the link has room
/// or is not known, nor where it loses more than a few in a hundred, since of fewer replies each counts more.
///
/// Bulk (pieces of a snapshot or a scene) goes in proportion to this rate. Both fill the same queue, so that one
/// signal holds down both. The proportion is 0.2 pieces for each datagram where a fetch begins, and doubles
/// every 80 ms until a queue stands or it is 2. Bulk gives way first: where the least round trip is above the
/// target without the part for jitter, the proportion falls by 0.7, to 0.5 at the least; else it rises by 0.1 a
/// second.
///
/// Pure: no clock, no allocation, no exception.
class RateControl {
 public:
  RateControl() noexcept : RateControl(RateControlConfig{}) {}
  explicit RateControl(const RateControlConfig& config) noexcept;

  /// Another peer: all that was seen of the link is forgotten, the rate is the full one.
  void reset() noexcept;

  /// One reply that was accepted. `rtt_ns`: without the server's hold time; below 0: not known.
  void on_reply(std::int64_t now_ns, std::int64_t rtt_ns, const ReplyNumbers& reply) noexcept;
  /// A reply that another had overtaken: late, but not lost.
  void on_late_reply() noexcept {
    if (arrived_ < newest_.sequence - first_.sequence) ++arrived_;
    late_share_ += (1 - late_share_) / kLateReplies;
  }

  /// Datagrams carry every step, from now on or no more: another least rate.
  void carry_steps(bool steps) noexcept;
  /// Once a tick, before anything is sent.
  void update(std::int64_t now_ns) noexcept;
  /// May this tick send? `urgent`: it must go whatever the rate; it is paid back by those that follow. Half a
  /// tick early is no sooner than the tick after would be late.
  bool may_send(bool urgent = false) const noexcept { return urgent || credit_ >= 1 - 0.5 * last_income_; }
  /// It did.
  void sent(std::int64_t now_ns) noexcept;

  double rate_hz() const noexcept { return rate_hz_; }
  /// Pieces of bulk that may be asked for in a second; kBulkMost_per_s where the rate does not adapt.
  double bulk_per_s() const noexcept {
    const double per_s = bulk_of_a_datagram_ * rate_hz_;
    return config_.adapts && per_s < kBulkMost_per_s ? per_s : kBulkMost_per_s;
  }
  /// A piece was asked for. After a second without any, a new fetch begins.
  void bulk_sent(std::int64_t now_ns) noexcept;
  static constexpr double kBulkMost_per_s = 2000;  ///< 7 Mbit/s: as much as a server gives of its scene
  double full_hz() const noexcept { return config_.full_hz; }
  /// The least rate that it was lowered to, and how often it was; the full rate before the first time.
  double lowest_hz() const noexcept { return lowest_hz_; }
  std::uint64_t lowered() const noexcept { return lowered_; }
  RateReason reason() const noexcept { return reason_; }
  /// Commands to repeat now.
  std::size_t redundancy() const noexcept { return held_down_ ? 0 : config_.redundancy; }
  /// Factor for a deadband of commands: 1 at the full rate, deadband_most at the least one.
  double deadband_factor() const noexcept;
  /// Share of the deadband of replies: 0 … 1.
  double reply_deadband_share() const noexcept;
  /// Delay above the base in the last window; 0 until there is one.
  double queue_ns() const noexcept { return queue_ns_; }
  double base_ns() const noexcept;

 private:
  struct Sample {
    std::int64_t time_ns = 0;
    std::int64_t rtt_ns = 0;
    std::uint64_t exchanges = 0;  // until then
  };
  static constexpr std::size_t kSamples = 512;
  static constexpr std::int64_t kUnknown = INT64_MAX;

  static constexpr double kLateReplies = 64;  // in the mean of their share

  double least_hz() const noexcept;
  double down() const noexcept;
  bool reorders() const noexcept;
  double jitter_most_ns(std::int64_t now_ns) const noexcept;
  void note_base(std::int64_t now_ns, std::int64_t rtt_ns) noexcept;
  bool standing(std::int64_t now_ns) noexcept;
  double delivered_hz(std::int64_t now_ns) const noexcept;
  void lower(std::int64_t now_ns, double rate_hz, RateReason reason) noexcept;
  void look_for_loss(std::int64_t now_ns) noexcept;
  void rise(std::int64_t now_ns, double dt_s) noexcept;
  bool fetches(std::int64_t now_ns) const noexcept;
  bool bulk_gives_way(std::int64_t now_ns) noexcept;
  void rise_bulk(std::int64_t now_ns, double dt_s) noexcept;
  std::int64_t settle_ns() const noexcept;
  void watch_the_least(std::int64_t now_ns) noexcept;

  RateControlConfig config_;
  bool carries_steps_ = false;
  double rate_hz_ = 0;
  RateReason reason_ = RateReason::kFull;
  bool held_down_ = false;
  double credit_ = 1;
  double last_income_ = 0;
  double bulk_of_a_datagram_ = 0.2;
  bool bulk_begins_ = true;  // nothing has stood in the way of this fetch
  static constexpr std::int64_t kNeverNs = INT64_MIN;
  std::int64_t bulk_ns_ = kNeverNs;
  std::int64_t bulk_lowered_ns_ = 0;
  bool starts_ = false;
  double jitter_ns_ = 0;
  double late_share_ = 0;  // of the last replies, those that another had overtaken
  bool ticked_ = false;
  std::int64_t ticked_ns_ = 0;
  // Replies of late, newest at (count_ − 1) % kSamples.
  std::array<Sample, kSamples> sample_{};
  std::size_t count_ = 0;
  std::int64_t base_now_ns_ = kUnknown;   // of the present block of 10 s
  std::int64_t base_last_ns_ = kUnknown;  // of the one before
  std::int64_t block_ns_ = 0;
  double queue_ns_ = 0;
  bool rests_ = false;  // a lowered rate is given time to be seen
  std::int64_t lowered_ns_ = 0;
  std::uint64_t lowered_ = 0;
  double lowest_hz_ = 0;
  std::int64_t calm_ns_ = 0;       // nothing has stood in the way since then
  std::int64_t at_least_ns_ = -1;  // at the least rate with a queue since then; -1: not
  double least_queue_ns_ = 0;
  // Of the present look at losses.
  ReplyNumbers first_;
  ReplyNumbers newest_;
  std::uint64_t arrived_ = 0;
  std::int64_t loss_since_ns_ = 0;
  double loss_ = 0;              // in the last look
  bool spares_replies_ = false;  // since a queue stood
  double spared_share_ = 0;
  double roof_hz_ = 0;                 // what was delivered then
  std::uint64_t left_out_before_ = 0;  // then
  std::uint64_t exchanges_ = 0;        // commands whose reply has come, or was left out
  // Silence.
  std::int64_t news_ns_ = 0;
  std::int64_t waits_since_ns_ = -1;
};

}  // namespace telenano::link

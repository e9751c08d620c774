#include "telenano/common/link/step_log.h"

namespace telenano::link {
namespace {

// A record's first byte: flags (bits 0 to 2), same target (3), same length (4), and how many more steps say
// the very same (bits 5 to 7; 7: a byte with the number follows the record).
constexpr std::uint8_t kSameTarget = 1u << 3;
constexpr std::uint8_t kSameLength = 1u << 4;
constexpr int kRunShift = 5;
constexpr std::size_t kRecordMost = 1 + 3 * 7 + 5;
constexpr std::int64_t kHeadAgainNs = 10'000'000;  // most bursts of loss are over then

std::uint64_t zigzag(std::int64_t x) noexcept {
  return (static_cast<std::uint64_t>(x) << 1) ^ static_cast<std::uint64_t>(x >> 63);
}
std::int64_t zagzig(std::uint64_t x) noexcept {
  return static_cast<std::int64_t>(x >> 1) ^ -static_cast<std::int64_t>(x & 1);
}

std::size_t put_varint(std::uint8_t* at, std::uint64_t x) noexcept {
  std::size_t n = 0;
  for (; x >= 0x80; x >>= 7) at[n++] = static_cast<std::uint8_t>(x | 0x80);
  at[n++] = static_cast<std::uint8_t>(x);
  return n;
}

// In its shortest form, at most 56 bits.
bool take_varint(std::span<const std::uint8_t> in, std::size_t& at, std::uint64_t& x) noexcept {
  x = 0;
  for (int shift = 0; shift < 56; shift += 7) {
    if (at >= in.size()) return false;
    const std::uint8_t byte = in[at++];
    x |= std::uint64_t{byte & 0x7fu} << shift;
    if (byte < 0x80) return byte != 0 || shift == 0;
  }
  return false;
}

}  // namespace

bool StepWriter::add(const LoggedStep& step) noexcept {
  if (out_[8] >= kMaxBatch) return false;
  if (run_at_ != 0 && step == last_ && (out_[run_at_] >> kRunShift) < 7) {
    out_[run_at_] = static_cast<std::uint8_t>(out_[run_at_] + (1u << kRunShift));
    ++out_[8];
    return true;
  }
  std::uint8_t record[kRecordMost];
  std::size_t n = 1;
  record[0] = static_cast<std::uint8_t>(step.flags & kStepFlags);
  if (step.target == last_.target) {
    record[0] |= kSameTarget;
  } else {
    for (std::size_t axis = 0; axis < 3; ++axis)
      n += put_varint(record + n, zigzag(step.target[axis] - last_.target[axis]));
  }
  if (step.dt_ns == last_.dt_ns) {
    record[0] |= kSameLength;
  } else {
    n += put_varint(record + n, zigzag(std::int64_t{step.dt_ns} - std::int64_t{last_.dt_ns}));
  }
  if (out_.size() - at_ < n) return false;
  std::copy_n(record, n, out_.begin() + static_cast<std::ptrdiff_t>(at_));
  run_at_ = at_;
  at_ += n;
  last_ = step;
  ++out_[8];
  return true;
}

bool read_steps(std::span<const std::uint8_t> bytes, StepBatch& batch) noexcept {
  batch.count = 0;
  batch.first = 0;
  if (bytes.size() <= kStepsHeaderBytes || bytes.size() > kStepsBytesMost) return false;
  std::uint64_t first = 0;
  for (int i = 0; i < 8; ++i) first |= std::uint64_t{bytes[static_cast<std::size_t>(i)]} << (8 * i);
  const std::size_t count = bytes[8];
  if (first == 0 || first > UINT64_MAX / 2 || count == 0 || count > kMaxBatch) return false;
  std::size_t at = kStepsHeaderBytes;
  std::size_t n = 0;
  LoggedStep step{{0, 0, 0}, 0, 0};
  while (at < bytes.size()) {
    const std::uint8_t head = bytes[at++];
    step.flags = head & kStepFlags;
    std::uint64_t x = 0;
    if ((head & kSameTarget) == 0) {
      for (std::int64_t& target : step.target) {
        if (!take_varint(bytes, at, x)) return false;
        target += zagzig(x);
        if (target > kStepTargetMost || target < -kStepTargetMost) return false;
      }
    }
    if ((head & kSameLength) == 0) {
      if (!take_varint(bytes, at, x)) return false;
      const std::int64_t dt_ns = std::int64_t{step.dt_ns} + zagzig(x);
      if (dt_ns < kStepShortestNs || dt_ns > kStepLongestNs) return false;
      step.dt_ns = static_cast<std::uint32_t>(dt_ns);
    }
    if (step.dt_ns == 0) return false;
    const std::size_t more = head >> kRunShift;
    if (n + 1 + more > count) return false;
    for (std::size_t i = 0; i <= more; ++i) batch.step[n++] = step;
  }
  if (n != count) return false;
  batch.first = first;
  batch.count = count;
  return true;
}

bool StepSender::begin(std::uint64_t executed, bool same_log) noexcept {
  if (!enabled()) return false;
  const bool kept = same_log && executed <= newest_ && newest_ - executed < ring_.size();
  if (!kept) newest_ = executed;
  executed_ = executed;
  sent_ = executed;
  last_new_ = again_ = 0;
  again_ns_ = 0;
  waits_ns_ = 0;
  return kept;
}

void StepSender::add(const LoggedStep& step) noexcept {
  ++newest_;
  ring_[newest_ % ring_.size()] = step;
}

std::uint64_t StepSender::oldest() const noexcept {
  const std::uint64_t kept = newest_ >= ring_.size() ? newest_ - ring_.size() + 1 : 1;
  return std::max(executed_ + 1, kept);
}

void StepSender::on_report(const StepReport& report, std::int64_t now_ns, std::int64_t rtt_ns) noexcept {
  if (report.executed > newest_ || report.executed < executed_) return;
  if (report.executed > executed_) {
    executed_ = report.executed;
    sent_ = std::max(sent_, executed_);
    waits_ns_ = now_ns;
  }
  if (again_ != 0 && again_ <= executed_) again_ = 0;
  // Later ones have come, and this one has not.
  const bool missing = report.newest > report.executed && report.newest <= newest_;
  if (missing && again_ == 0 && now_ns - again_ns_ > rtt_ns) {
    send_again(now_ns, false);
    repeated_ = kRepeatedMost;
    last_gap_ns_ = now_ns;
  } else if (missing && again_ == 0 && now_ns - head_ns_ > std::max(rtt_ns / 4, kHeadAgainNs)) {
    send_again(now_ns, true);
  } else if (now_ns - last_gap_ns_ > kQuietNs) {
    repeated_ = kRepeated;
  }
}

void StepSender::send_again(std::int64_t now_ns, bool head_only) noexcept {
  again_ = executed_ + 1;
  head_only_ = head_only;
  head_ns_ = waits_ns_ = now_ns;
  if (!head_only) again_ns_ = now_ns;
}

bool StepSender::urgent(std::int64_t now_ns, std::int64_t wait_ns) noexcept {
  if (again_ != 0) return true;
  if (sent_ < newest_ && at(sent_ + 1).hold != at(newest_).hold) return true;  // they need two datagrams
  if (newest_ - sent_ > kMaxBatch / 2) return true;
  return sent_ > executed_ && waits_ns_ != 0 && now_ns - waits_ns_ > wait_ns;
}

std::uint64_t StepSender::fill(StepWriter& writer, std::uint64_t from) const noexcept {
  std::uint64_t to = from;
  while (to <= newest_ && at(to).hold == at(from).hold && writer.add(at(to))) ++to;
  return to;
}

std::size_t StepSender::write(std::span<std::uint8_t> out, std::int64_t now_ns, std::int64_t wait_ns,
                              bool newest_holding) noexcept {
  if (!enabled() || newest_ == executed_ || out.size() <= kStepsHeaderBytes + kRecordMost) return 0;
  if (waits_ns_ == 0 || sent_ <= executed_) waits_ns_ = now_ns;
  // Without an answer for so long, all that is open goes again, in as many datagrams as it takes.
  if (again_ == 0 && sent_ > executed_ && now_ns - waits_ns_ > wait_ns) send_again(now_ns, false);
  const std::uint64_t at_least = sent_ + 1 > repeated_ ? sent_ + 1 - repeated_ : 1;
  const std::uint64_t repeat = std::min(at_least, std::max<std::uint64_t>(last_new_, 1));
  std::uint64_t from = std::max(oldest(), again_ != 0 ? again_ : repeat);
  // New steps must not starve where much is new.
  if (again_ == 0 && sent_ + 1 > from + kMaxBatch / 2) from = std::max(oldest(), sent_ + 1 - kMaxBatch / 2);
  // One holding a datagram: what it repeats, and what is new in it.
  const std::uint64_t begins_with = newest_holding ? newest_ : std::min(sent_ + 1, newest_);
  if (newest_holding || again_ == 0)
    while (from < begins_with && at(from).hold != at(begins_with).hold) ++from;
  written_hold_ = at(from).hold;
  const std::span<std::uint8_t> room = out.first(std::min(out.size(), kStepsBytesMost));
  StepWriter writer(room, from);
  std::uint64_t to = fill(writer, from);
  // What is repeated must not keep out what is new.
  const bool no_room = to <= newest_ && at(to).hold == written_hold_;
  const bool has_new = sent_ < newest_ && at(sent_ + 1).hold == written_hold_;
  if (again_ == 0 && no_room && from <= sent_ && has_new) {
    writer = StepWriter(room, sent_ + 1);
    to = fill(writer, sent_ + 1);
  }
  if (again_ != 0) {
    again_ = to > sent_ || head_only_ ? 0 : to;
    waits_ns_ = now_ns;
  }
  if (to > sent_ + 1) last_new_ = sent_ + 1;
  sent_ = std::max(sent_, to - 1);
  return writer.count() > 0 ? writer.size() : 0;
}

void StepReceiver::take(const StepBatch& batch, std::int64_t now_ns, std::uint32_t hold) noexcept {
  const bool had_gap = gap();
  for (std::size_t i = 0; i < batch.count; ++i) {
    const std::uint64_t number = batch.first + i;
    if (number <= executed_ || number > executed_ + ring_.size() || has(number)) continue;
    ring_[number % ring_.size()] = batch.step[i];
    ring_[number % ring_.size()].hold = hold;
    here_[number % here_.size()] = number;
    came_ns_[number % came_ns_.size()] = now_ns;
    newest_ = std::max(newest_, number);
  }
  if (gap() && !had_gap) gap_since_ns_ = now_ns;
  if (had_gap && !gap()) gap_closed_ns_ = now_ns;
}

bool StepReceiver::pop(std::int64_t now_ns, LoggedStep& step) noexcept {
  if (filled_)
    bucket_ns_ =
        std::min(1.0 * kBucketNs,
                 bucket_ns_ + kFill * static_cast<double>(std::max<std::int64_t>(now_ns - filled_ns_, 0)));
  filled_ = true;
  filled_ns_ = now_ns;
  if (!waits()) return false;
  step = next();
  if (bucket_ns_ < step.dt_ns) return false;
  bucket_ns_ -= step.dt_ns;
  ++executed_;
  if (gap()) gap_since_ns_ = now_ns;
  return true;
}

void StepReceiver::skip_to_newest(std::uint32_t reason) noexcept {
  if (newest_ <= executed_ + 1) return;
  executed_ = newest_ - 1;
  declare_break(reason);
  break_step_ = newest_;
}

}  // namespace telenano::link

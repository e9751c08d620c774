#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace telenano::station {

/// Which command was sent at which scale: what is on its way when the scale changes crosses at its own.
///
/// The slave's sums stand in its own units; a reply says up to which command they go. What they have grown by
/// since the last reply was exchanged while the commands after that one were carried out, at the scales that
/// those were sent with: at one scale it crosses exactly, and where replies were lost over a change, at the
/// least of theirs, since nobody knows how much of it was when. A price is the hand joules that one aJ at the
/// tip stands for.
class ScaleHistory {
 public:
  /// The numbers of commands begin anew. What the old session's have done comes with the first reply;
  /// `new_slave`: or never, since another slave answers from now on.
  void begin_session(bool new_slave) noexcept {
    for (std::size_t i = 0; i < count_; ++i) pending_ = std::min(pending_, span_[i].price);
    if (new_slave) pending_ = kNone;
    count_ = 0;
    next_ = 0;
  }

  /// A command with this number carries this price; not less than the last number.
  void sent(std::uint64_t sequence, double price) noexcept {
    if (count_ > 0 && span_[count_ - 1].first >= sequence) {  // that tick's command was not sent after all
      span_[count_ - 1].price = price;
      return;
    }
    if (count_ > 0 && span_[count_ - 1].price == price) return;
    if (count_ == kSpans) {
      span_[1] = {span_[0].first, std::min(span_[0].price, span_[1].price)};
      std::shift_left(span_.begin(), span_.end(), 1);
      --count_;
    }
    span_[count_++] = {sequence, price};
  }

  /// The least price at which something may have happened that a reply to command `sequence` is the first to
  /// tell of; `present` if no command is known.
  double answered(std::uint64_t sequence, double present) noexcept {
    const std::uint64_t from = std::min(next_, sequence);
    double least = std::min(pending_, count_ > 0 && span_[0].first > sequence ? present : kNone);
    std::size_t done = 0;
    for (std::size_t i = 0; i < count_ && span_[i].first <= sequence; ++i) {
      const bool over = i + 1 < count_ && span_[i + 1].first <= from;
      if (!over) least = std::min(least, span_[i].price);
      if (i + 1 < count_ && span_[i + 1].first <= sequence + 1) done = i + 1;
    }
    std::shift_left(span_.begin(), span_.begin() + static_cast<std::ptrdiff_t>(count_),
                    static_cast<std::ptrdiff_t>(done));
    count_ -= done;
    pending_ = kNone;
    next_ = std::max(next_, sequence + 1);
    return least < kNone ? least : present;
  }

  /// Changes that may be under way at once; of more the oldest two are taken for one, at the lower price.
  static constexpr std::size_t kSpans = 256;

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  struct Span {
    std::uint64_t first = 0;  // command
    double price = 0;
  };
  std::array<Span, kSpans> span_{};
  std::size_t count_ = 0;
  std::uint64_t next_ = 0;  // first command not yet answered
  double pending_ = kNone;  // least price of what an earlier session's commands may have done
};

}  // namespace telenano::station

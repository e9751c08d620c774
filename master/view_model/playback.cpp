#include "telenano/master/view_model/playback.h"

#include <algorithm>
#include <utility>

namespace telenano::view_model {

Playback::Playback(std::vector<recording::Sample> rows, std::vector<Mark> marks)
    : rows_(std::move(rows)), marks_(std::move(marks)), time_s_(rows_.front().time_s) {}

void Playback::play(bool on) noexcept {
  if (on && time_s_ >= end_s()) seek(begin_s());
  playing_ = on;
}

void Playback::set_speed(double speed) noexcept {
  if (speed > 0) speed_ = std::clamp(speed, kSlowest, kFastest);
}

void Playback::seek(double time_s) noexcept {
  if (!(time_s == time_s)) return;
  time_s_ = std::clamp(time_s, begin_s(), end_s());
  leapt_ = true;
}

void Playback::seek_mark(int way) noexcept {
  constexpr double kHere = 0.25;  // a mark so near before is the one that playing has just left
  double to_s = way > 0 ? end_s() : begin_s();
  for (const Mark& mark : marks_) {
    if (way > 0 && mark.time_s > time_s_) to_s = std::min(to_s, mark.time_s);
    if (way < 0 && mark.time_s < time_s_ - (playing_ ? kHere : 0)) to_s = std::max(to_s, mark.time_s);
  }
  seek(to_s);
}

const Playback::Mark* Playback::newest_mark() const noexcept {
  constexpr double kShownS = 2;
  const Mark* newest = nullptr;
  for (const Mark& mark : marks_) {
    if (mark.time_s <= time_s_ && mark.time_s > time_s_ - kShownS) newest = &mark;
  }
  return newest;
}

void Playback::advance(double dt_s) noexcept {
  if (!playing_ || !(dt_s > 0)) return;
  time_s_ = std::min(time_s_ + speed_ * dt_s, end_s());
  if (time_s_ >= end_s()) playing_ = false;
}

std::size_t Playback::rows_until(double time_s) const noexcept {
  const auto after =
      std::upper_bound(rows_.begin(), rows_.end(), time_s,
                       [](double time, const recording::Sample& row) { return time < row.time_s; });
  return static_cast<std::size_t>(after - rows_.begin());
}

Playback::Passed Playback::take() noexcept {
  Passed passed;
  passed.end = rows_until(time_s_);
  passed.anew = leapt_;
  passed.first = leapt_ ? rows_until(time_s_ - kBeforeS) : taken_;
  // At least the row of the moment.
  if (leapt_ && passed.first == passed.end && passed.end > 0) --passed.first;
  taken_ = passed.end;
  leapt_ = false;
  return passed;
}

}  // namespace telenano::view_model

#include "telenano/master/view_model/force_curve.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "telenano/common/link/messages.h"

namespace telenano::view_model {
namespace {

using Point = ForceCurve::Point;

link::ContactState contact_of(const recording::Sample& sample) noexcept {
  return static_cast<link::ContactState>(sample.contact_state);
}

// Of four points the one with the least and the one with the greatest force stay, so that no peak is lost.
// The first point of all and the last stay too: a segment keeps its ends.
void thin(std::vector<Point>& points) {
  std::vector<Point> kept;
  kept.reserve(points.size() / 2 + 4);
  kept.push_back(points.front());
  std::size_t i = 1;
  for (; i + 4 < points.size(); i += 4) {
    std::size_t least = i;
    std::size_t greatest = i;
    for (std::size_t j = i + 1; j < i + 4; ++j) {
      if (points[j].force_nn < points[least].force_nn) least = j;
      if (points[j].force_nn > points[greatest].force_nn) greatest = j;
    }
    kept.push_back(points[std::min(least, greatest)]);
    if (least != greatest) kept.push_back(points[std::max(least, greatest)]);
  }
  kept.insert(kept.end(), std::next(points.begin(), static_cast<std::ptrdiff_t>(i)), points.end());
  points = std::move(kept);
}

std::size_t extreme_of(const std::vector<Point>& points, int way) noexcept {
  std::size_t extreme = 0;
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (way * (points[i].distance_nm - points[extreme].distance_nm) >= 0) extreme = i;
  }
  return extreme;
}

bool any_contact(const std::vector<Point>& points) noexcept {
  return std::any_of(points.begin(), points.end(), [](const Point& p) { return p.contact; });
}

void write_pull(std::string& out, const char* name, const std::optional<ForceCurve::Pull>& pull) {
  if (!pull) {
    out += fmt::format("# {}: none\n", name);
    return;
  }
  out += fmt::format("# {}: {:.6g} nN at {:.6g} nm", name, pull->force_nn, pull->distance_nm);
  if (pull->leapt)
    out += fmt::format(", leap from {:.6g} nm to {:.6g} nm", pull->leap_from_nm, pull->leap_to_nm);
  out += '\n';
}

void write_segment(std::string& out, const char* name, const ForceCurve::Segment& segment) {
  for (const Point& p : segment.points)
    out += fmt::format("{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}\n", name, p.time_s, p.distance_nm,
                       p.height_nm, p.base_nm, p.force_nn, p.lateral_nn);
}

const char* state_word(ForceCurve::State state) noexcept {
  switch (state) {
    case ForceCurve::State::kUnderWay:
      return "under way";
    case ForceCurve::State::kDone:
      return "done";
    case ForceCurve::State::kCutOff:
      return "cut off";
    case ForceCurve::State::kNone:
      break;
  }
  return "none";
}

}  // namespace

double ForceCurve::Segment::lateral_most_nn() const noexcept {
  double most = 0;
  for (const Point& p : points) most = std::max(most, p.lateral_nn);
  return most;
}

void ForceCurve::start_anew() {
  for (Segment* segment : {&approach_, &retract_}) {
    if (segment->state == State::kUnderWay) segment->state = State::kCutOff;
  }
  // A touch whose end was not seen has no retract that could be trusted later on.
  if (in_touch_ && retract_.state == State::kNone) retract_.state = State::kCutOff;
  in_touch_ = false;
  track_.clear();
  way_ = 0;
  extreme_ = 0;
  any_ = false;
  last_free_ = false;
}

void ForceCurve::take(const recording::Sample& sample, double distance_nm) {
  if (sample.reply_sequence == 0 || sample.reply_sequence == reply_seen_) return;
  reply_seen_ = sample.reply_sequence;
  Point p;
  p.time_s = sample.time_s;
  p.distance_nm = distance_nm;
  p.height_nm = sample.tip_pos_w_nm[2];
  p.base_nm = p.height_nm - sample.deflection_nm;
  p.force_nn = sample.force_w_nn[2];
  p.lateral_nn = std::hypot(sample.force_w_nn[0], sample.force_w_nn[1]);
  p.contact = contact_of(sample) == link::ContactState::kContact;
  const double all = p.time_s + p.distance_nm + p.height_nm + p.base_nm + p.force_nn + p.lateral_nn;
  if (!std::isfinite(all)) return;
  if (any_ && !(p.time_s - last_.time_s >= 0 && p.time_s - last_.time_s <= kBreakS)) start_anew();

  const bool free = contact_of(sample) == link::ContactState::kFree;
  if (any_) {
    const double df = p.force_nn - last_.force_nn;
    // Trapezoids. The work against a lever's spring is then exact: F dF telescopes.
    p.work_aj = last_.work_aj - 0.5 * (p.force_nn + last_.force_nn) * (p.height_nm - last_.height_nm);
    if (free && last_free_) {
      differences_nn2_ += df * df;
      ++differences_;
    }
  }
  last_ = p;
  last_free_ = free;
  any_ = true;

  track_.push_back(p);
  if (track_.size() > kPointsMax) {
    thin(track_);
    extreme_ = extreme_of(track_, way_ == 0 ? 1 : way_);
  }
  if (way_ == 0) {
    const double moved = p.distance_nm - track_.front().distance_nm;
    if (std::abs(moved) < kTurn_nm) return;
    way_ = moved > 0 ? 1 : -1;
    extreme_ = extreme_of(track_, way_);
  } else if (way_ * (p.distance_nm - track_[extreme_].distance_nm) >= 0) {
    extreme_ = track_.size() - 1;
  } else if (std::abs(p.distance_nm - track_[extreme_].distance_nm) >= kTurn_nm) {
    turn(-way_);
  }
  show();
}

// What has come since the extreme belongs to the new segment. The extreme itself is the end of one and the begin
// of the other.
void ForceCurve::turn(int way) {
  const auto split = std::next(track_.begin(), static_cast<std::ptrdiff_t>(extreme_));
  if (way > 0 && in_touch_ && approach_.state == State::kUnderWay) {
    approach_.points.assign(track_.begin(), std::next(split));
    approach_.state = State::kDone;
  }
  if (way < 0 && in_touch_ && retract_.state == State::kUnderWay) {
    if (any_contact({split, track_.end()}) || split->contact) {
      retract_ = {};  // not left yet: pressed again
    } else {
      retract_.points.assign(track_.begin(), std::next(split));
      retract_.state = State::kDone;
      in_touch_ = false;
    }
  }
  track_.erase(track_.begin(), split);
  way_ = way;
  extreme_ = extreme_of(track_, way_);
}

void ForceCurve::show() {
  if (way_ < 0) {
    const bool enters = !in_touch_ && !track_.front().contact && track_.back().contact;
    if (enters) {
      in_touch_ = true;
      retract_ = {};
      approach_.points.clear();
      approach_.state = State::kUnderWay;
      approach_.points = track_;
    } else if (in_touch_ && approach_.state == State::kUnderWay) {
      if (approach_.points.size() < track_.size())
        approach_.points.push_back(track_.back());
      else
        approach_.points = track_;  // thinned
    }
  } else if (way_ > 0 && in_touch_) {
    if (retract_.state == State::kUnderWay && retract_.points.size() + 1 == track_.size()) {
      retract_.points.push_back(track_.back());
    } else {
      retract_.points = track_;
      retract_.state = State::kUnderWay;
    }
    // Out of contact, and with as much way since as no noise makes: it is over, even if the tip now stands.
    if (track_.back().contact) return;
    double left_nm = track_.front().distance_nm;
    for (const Point& p : track_) {
      if (p.contact) left_nm = p.distance_nm;
    }
    const double pull = -track_.back().force_nn;
    double most = 0;
    for (const Point& p : track_) most = std::max(most, -p.force_nn);
    // A neck of attraction beyond the contact is still the retract's.
    if (track_.back().distance_nm - left_nm >= kTurn_nm && pull <= 0.2 * most + kSigmas * noise_nn()) {
      retract_.state = State::kDone;
      in_touch_ = false;
    }
  }
}

double ForceCurve::noise_nn() const noexcept {
  // The difference of two independent values has twice the variance of one.
  return differences_ == 0 ? 0 : std::sqrt(0.5 * differences_nn2_ / static_cast<double>(differences_));
}

std::optional<ForceCurve::Pull> ForceCurve::pull_of(const Segment& segment, int way) const {
  const auto& points = segment.points;
  if (points.empty()) return std::nullopt;
  const auto least = std::min_element(points.begin(), points.end(),
                                      [](const Point& a, const Point& b) { return a.force_nn < b.force_nn; });
  if (-least->force_nn < std::max(kSigmas * noise_nn(), kLeast_nn)) return std::nullopt;
  Pull pull;
  pull.force_nn = least->force_nn;
  pull.distance_nm = least->distance_nm;
  double farthest = 0;
  for (std::size_t i = 1; i < points.size(); ++i) {
    const double tip = way * (points[i].distance_nm - points[i - 1].distance_nm);
    const double base = std::abs(points[i].base_nm - points[i - 1].base_nm);
    const double df = std::abs(points[i].force_nn - points[i - 1].force_nn);
    // A step of the force that its noise makes is no leap, nor is one small against the pull.
    const bool seen = df > std::sqrt(2.0) * kSigmas * noise_nn() && df > -0.2 * pull.force_nn;
    if (!seen || tip < kLeapRatio * base || tip <= farthest) continue;
    farthest = tip;
    pull.leapt = true;
    pull.leap_from_nm = points[i - 1].distance_nm;
    pull.leap_to_nm = points[i].distance_nm;
  }
  return pull;
}

std::optional<ForceCurve::Pull> ForceCurve::snap_in() const {
  return pull_of(approach_, -1);
}

std::optional<ForceCurve::Pull> ForceCurve::pull_off() const {
  if (retract_.state != State::kDone) return std::nullopt;
  return pull_of(retract_, 1);
}

// The loop is closed where the retract ended: farther out only the approach was seen, and its work there
// against a force that reaches far would count as lost.
std::optional<double> ForceCurve::hysteresis_aj() const noexcept {
  if (retract_.state != State::kDone || approach_.points.empty() || retract_.points.empty())
    return std::nullopt;
  const Point& end = retract_.points.back();
  double begin_aj = approach_.points.front().work_aj;
  for (std::size_t i = 1; i < approach_.points.size(); ++i) {
    const Point& a = approach_.points[i - 1];
    const Point& b = approach_.points[i];
    if (a.distance_nm < end.distance_nm || b.distance_nm >= end.distance_nm) continue;
    const double part = (a.distance_nm - end.distance_nm) / (a.distance_nm - b.distance_nm);
    begin_aj = a.work_aj + part * (b.work_aj - a.work_aj);
    break;
  }
  return end.work_aj - begin_aj;
}

std::string ForceCurve::csv() const {
  std::string out = "# force-distance curve of the last touch; force along z, push positive\n";
  out +=
      fmt::format("# approach: {}\n# retract: {}\n", state_word(approach_.state), state_word(retract_.state));
  write_pull(out, "snap-in", snap_in());
  write_pull(out, "pull-off", pull_off());
  const std::optional<double> lost = hysteresis_aj();
  out += lost ? fmt::format("# hysteresis: {:.6g} aJ\n", *lost) : std::string("# hysteresis: none\n");
  out += fmt::format("# noise: {:.6g} nN\n", noise_nn());
  out += "segment,time_s,distance_nm,height_nm,base_nm,force_nn,lateral_nn\n";
  write_segment(out, "approach", approach_);
  write_segment(out, "retract", retract_);
  return out;
}

}  // namespace telenano::view_model

#include "telenano/master/device/replay_device.h"

#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/master/device/sim_device.h"

namespace telenano::device {

void HandTrack::validate(const std::string& source) const {
  if (points.size() < 2)
    throw UserError(source + ": contains no motion of a hand, expected at least two rows");
  if (points.front().time_s != 0) throw UserError(source + ": its motion does not begin at 0 s");
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_finite(points[i].hand_pos_h_m))
      throw UserError(source + ": row " + std::to_string(i) + ": the hand's position is not a finite number");
    if (i > 0 && !(points[i].time_s > points[i - 1].time_s))
      throw UserError(source + ": row " + std::to_string(i) +
                      ": its time is not after that of the row before");
  }
}

ReplayDevice::ReplayDevice(HandTrack track, const std::string& source)
    : track_((track.validate(source), std::move(track))), info_(sim_device_info(PlantConfig{})) {
  info_.name = "replay";
  info_.position_quantum_m = 0;
}

void ReplayDevice::advance(std::int64_t dt_ns) noexcept {
  if (!started_ || held_ || dt_ns <= 0 || dt_ns > kLongestTickNs) return;
  motion_ns_ += dt_ns;
  const double now_s = motion_time_s();
  while (at_ + 1 < track_.points.size() && track_.points[at_ + 1].time_s <= now_s) ++at_;
}

void ReplayDevice::read(DeviceReading& reading) noexcept {
  reading = {};
  const HandTrack::Point& from = track_.points[at_];
  reading.hand_pos_h_m = from.hand_pos_h_m;
  // Before it begins the deadman is held: it begins when the station engages.
  reading.buttons = started_ ? from.buttons & ~static_cast<std::uint32_t>(kButtonStop) : kButtonDeadman;
  if (at_ + 1 == track_.points.size()) return;
  const HandTrack::Point& to = track_.points[at_ + 1];
  const double part = (motion_time_s() - from.time_s) / (to.time_s - from.time_s);
  reading.hand_pos_h_m += part * (to.hand_pos_h_m - from.hand_pos_h_m);
}

Vec3 ReplayDevice::write_force(const Vec3& hand_force_h_n) noexcept {
  if (!is_finite(hand_force_h_n)) return Vec3::Zero();
  const double norm_n = hand_force_h_n.norm();
  return norm_n > info_.force_max_n ? Vec3(hand_force_h_n * (info_.force_max_n / norm_n)) : hand_force_h_n;
}

}  // namespace telenano::device

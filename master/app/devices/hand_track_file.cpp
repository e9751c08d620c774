#include "telenano/master/app/devices/hand_track_file.h"

#include <algorithm>
#include <array>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/recording_reader.h"
#include "telenano/master/station/station.h"

namespace telenano::app {

device::HandTrack load_hand_track(const std::string& path) {
  const recording::RecordingReader reader(path);
  for (const char* column : {"time_s", "hand_pos_h_m", "buttons", "station_mode"}) {
    if (!reader.has(column))
      throw UserError(path + ": no column " + column + ", expected a recording of a session");
  }
  constexpr auto kEngaged = static_cast<std::uint32_t>(station::Mode::kEngaged);
  device::HandTrack track;
  track.points.reserve(reader.rows());
  constexpr std::size_t kBlock = 4096;
  std::vector<recording::Sample> block(kBlock);
  bool begun = false;
  bool followed = true;  // in the row before, the tip followed the hand
  double start_s = 0;
  for (std::size_t first = 0; first < reader.rows(); first += kBlock) {
    const std::size_t count = std::min(kBlock, reader.rows() - first);
    reader.read_samples(first, std::span(block).first(count));
    for (std::size_t i = 0; i < count; ++i) {
      const recording::Sample& sample = block[i];
      const bool follows = sample.station_mode == kEngaged;
      if (!begun && !follows) continue;
      if (!begun) start_s = sample.time_s;
      begun = true;
      // The clutch holds from a row to the next one. The anchor of a station that engages again is where the
      // hand is then, so what the hand did since the last engaged row moved no tip.
      if (!follows && followed && !track.points.empty()) track.points.back().buttons |= device::kButtonClutch;
      const std::uint32_t clutch = follows ? 0 : std::uint32_t{device::kButtonClutch};
      const auto& pos = sample.hand_pos_h_m;
      track.points.push_back(
          {sample.time_s - start_s, Vec3(pos[0], pos[1], pos[2]), sample.buttons | clutch});
      followed = follows;
    }
  }
  if (!begun) throw UserError(path + ": the station never engaged, so there is no motion to play");
  return track;
}

}  // namespace telenano::app

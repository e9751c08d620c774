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
  device::HandTrack track;
  track.points.reserve(reader.rows());
  constexpr std::size_t kBlock = 4096;
  std::vector<recording::Sample> block(kBlock);
  bool engaged = false;
  double start_s = 0;
  for (std::size_t first = 0; first < reader.rows(); first += kBlock) {
    const std::size_t count = std::min(kBlock, reader.rows() - first);
    reader.read_samples(first, std::span(block).first(count));
    for (std::size_t i = 0; i < count; ++i) {
      const recording::Sample& sample = block[i];
      if (!engaged && sample.station_mode != static_cast<std::uint32_t>(station::Mode::kEngaged)) continue;
      if (!engaged) start_s = sample.time_s;
      engaged = true;
      const auto& pos = sample.hand_pos_h_m;
      track.points.push_back({sample.time_s - start_s, Vec3(pos[0], pos[1], pos[2]), sample.buttons});
    }
  }
  if (!engaged) throw UserError(path + ": the station never engaged, so there is no motion to play");
  return track;
}

}  // namespace telenano::app

#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "telenano/common/recording/datagram_row.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/recording/state_piece_row.h"
#include "telenano/master/device/haptic_device.h"
#include "telenano/master/loop/link_options.h"
#include "telenano/master/station/station_config.h"

namespace telenano::studies {

/// A state of the server's slave that the station took in.
struct RecordedState {
  std::int64_t tick = 0;  ///< in which it was whole
  std::uint64_t step = 0;
  std::uint64_t state_hash = 0;
  std::uint32_t breaks = 0;
  std::vector<std::uint8_t> bytes;
};

/// Of pieces in the order in which they came; a state of which one is missing is left out.
std::vector<RecordedState> states_of(const std::vector<recording::StatePieceRow>& pieces);

/// What a recording holds of a session, as a replay needs it.
struct RecordedSession {
  std::filesystem::path path;
  std::string scene_name;
  std::string scene_hash;  ///< 16 hexadecimal digits
  std::string scene_path;  ///< where the station had it; empty: it did not
  std::string scene_text;  ///< the whole file, likewise
  /// What the ground was to the tip: "law", "potential" or "unknown"; before, "foot" or absent.
  std::string surface_force;
  std::string scene_bundle;  ///< all of it (nve_server/scene/scene_bundle.h); empty: it was not fetched
  station::StationConfig station;
  device::DeviceInfo device;
  loop::LinkOptions link;
  std::size_t redundancy = 0;
  std::uint64_t features = 0;         ///< agreed
  std::string twin_scene_hash;        ///< of the twin's scene, likewise; empty: there was none
  double twin_ring_s = 4;             ///< of steps that the station kept
  std::set<std::int64_t> undo_after;  ///< ticks after which a person asked to take marks back
  std::set<std::int64_t> apart_at;    ///< ticks in which twin and server were found apart
  bool tells_of_log = false;          ///< what the replies said of the log of steps is there
  std::int64_t slave_timeout_ns = 0;  ///< silence after which the slave withdraws, by the server's clock
  std::vector<recording::Sample> samples;
  std::vector<recording::DatagramRow> datagrams;
  std::vector<recording::StatePieceRow> state_pieces;
  std::vector<RecordedState> states;
};

/// Throws UserError, one line: not a recording, or one that was made before recordings held what came when.
RecordedSession load_session(const std::filesystem::path& path);

/// By which commands the slave stepped, from the replies' numbers, those that they answer and what they say
/// of the commands before.
struct StepOrder {
  std::set<std::uint64_t> commands;
  /// From this command on (its number) it is not known any more; UINT64_MAX: it is known throughout. Only
  /// where more than 64 commands lie between two replies that came, and some of them had come, but not all.
  std::uint64_t unknown_from = UINT64_MAX;
};
StepOrder step_order(const std::vector<recording::DatagramRow>& datagrams);

/// The newest command whose reply can have come before the recording began; UINT64_MAX: any. Replies are
/// accepted in their order: one that was newer than the first one recorded would have had that one dropped,
/// so it was lost. `any`: one had come, so that a round trip is known; else 0.
std::uint64_t newest_answered_before(const std::vector<recording::DatagramRow>& datagrams, bool any);

}  // namespace telenano::studies

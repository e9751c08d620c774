#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace telenano::recording {

/// One piece of the server's state that the station took in, in the order in which it did (link::SnapshotPiece,
/// without the session's number): what a twin that was apart took up. A replay goes on from there.
struct StatePieceRow {
  static constexpr std::size_t kBytes = 432;  ///< of the state in one piece

  std::int64_t tick = 0;         ///< at whose start it was looked at
  std::uint64_t step = 0;        ///< of the log, the last one executed when the state was frozen
  std::uint64_t state_hash = 0;  ///< then
  std::uint32_t breaks = 0;      ///< declared until then
  std::uint32_t snapshot = 0;    ///< the station's number for the state, from 1
  std::uint32_t piece = 0;       ///< from 0
  std::uint32_t total = 0;       ///< bytes of the whole state
  std::uint32_t size = 0;        ///< of `data`
  std::uint32_t reserved = 0;
  std::array<std::uint8_t, kBytes> data{};
};

static_assert(std::is_trivially_copyable_v<StatePieceRow> && sizeof(StatePieceRow) == 480);

}  // namespace telenano::recording

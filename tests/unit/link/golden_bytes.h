// For golden_values.h, which telenano-schema makes of proto/golden/values.txt: the byte strings, which the codec sets by hand.
#pragma once

#include <algorithm>
#include <cstdint>
#include <initializer_list>

#include "telenano/common/link/messages.h"

namespace telenano::link {

using GoldenBytes = std::initializer_list<std::uint8_t>;
template <class Message>
void set_bytes(Message& m, GoldenBytes bytes) {
  m.size = static_cast<decltype(m.size)>(bytes.size());
  std::copy(bytes.begin(), bytes.end(), m.data.begin());
}
inline void set_bytes(Welcome& m, GoldenBytes bytes) {
  std::copy(bytes.begin(), bytes.end(), m.scene_name.text.begin());
}
inline void set_bytes(SceneListEntry& m, GoldenBytes bytes) {
  std::copy(bytes.begin(), bytes.end(), m.scene_name.text.begin());
}
/// Its steps and repeated commands are messages of their own: see GoldenMessages.
inline void set_bytes(Command&, GoldenBytes) {}
template <class Message>
bool same_bytes(const Message&, const Message&) {
  return true;
}
inline bool same_bytes(const Welcome& a, const Welcome& b) {
  return a.scene_name == b.scene_name;
}
inline bool same_bytes(const SceneListEntry& a, const SceneListEntry& b) {
  return a.scene_name == b.scene_name;
}
template <class Piece>
bool same_piece(const Piece& a, const Piece& b) {
  return a.size == b.size && std::equal(a.data.begin(), a.data.begin() + a.size, b.data.begin());
}
inline bool same_bytes(const SceneChunk& a, const SceneChunk& b) {
  return same_piece(a, b);
}
inline bool same_bytes(const SnapshotPiece& a, const SnapshotPiece& b) {
  return same_piece(a, b);
}

}  // namespace telenano::link

#include <cstring>

#include "telenano/nve_server/server/server.h"

namespace telenano::server {

using link::DropCause;

namespace {

constexpr std::int64_t kFreezeEveryNs = 100'000'000;

}  // namespace

/// A piece of the slave's state. Another number than the last freezes it anew, not more often than
/// kFreezeEveryNs: where marks stay that looks at every node of the surface.
std::size_t Server::on_snapshot_request(const link::SnapshotRequest& request, const net::Address& from,
                                        std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  const std::size_t slot = table_.find(request.session_id);
  const DropCause cause = why_not_own(slot, from, link::kFeatureStepLog);
  if (cause != DropCause::kNone) return drop(cause);
  if (!records_[slot].snapshot_pieces.take(now_ns)) return drop(DropCause::kRateLimited);
  link::FrozenState& frozen = records_[slot].frozen;
  if (request.snapshot != frozen.id) {
    if (frozen.id != 0 && now_ns - frozen.at_ns < kFreezeEveryNs) return drop(DropCause::kRateLimited);
    const link::StepReport report = step_report(slot);
    frozen.id = request.snapshot;
    frozen.step = report.executed;
    frozen.state_hash = report.state_hash;
    frozen.breaks = report.breaks;
    frozen.at_ns = now_ns;
    frozen.size = tip_of(slot).slave->save(frozen.bytes);
  }
  link::SnapshotPiece piece;
  if (!frozen.piece(request.piece, piece)) return drop(DropCause::kOutOfRange);
  piece.session_id = request.session_id;
  return codec_.encode(piece, out);
}

/// Nothing is kept but how much was sent: what is asked for again is sent again, within the same bounds.
std::size_t Server::on_scene_request(const link::SceneRequest& request, const net::Address& from,
                                     std::int64_t now_ns, std::span<std::uint8_t> out) noexcept {
  const std::size_t slot = table_.find(request.session_id);
  const DropCause cause = why_not_own(slot, from, link::kFeatureScene);
  if (cause != DropCause::kNone) return drop(cause);
  const SceneToFetch& scene = *scene_of(slot).scene.to_fetch;
  const std::size_t size = scene.offer.chunk_bytes(request.chunk);
  if (request.bundle != scene.offer.name() || size == 0) return drop(DropCause::kOutOfRange);
  if (!records_[slot].scene_chunks.take(now_ns) || !scene_chunks_.take(now_ns))
    return drop(DropCause::kRateLimited);
  link::SceneChunk& chunk = chunk_;
  chunk.session_id = request.session_id;
  chunk.bundle = request.bundle;
  chunk.chunk = request.chunk;
  chunk.size = static_cast<std::uint32_t>(size);
  std::memcpy(chunk.data.data(), scene.bytes.data() + std::size_t{request.chunk} * link::kSceneChunkBytes,
              size);
  ++counters_.scene_chunks;
  return codec_.encode(chunk, out);
}

}  // namespace telenano::server

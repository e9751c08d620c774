#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "telenano/common/link/messages.h"
#include "telenano/common/link/token_bucket.h"

namespace telenano::link {

/// The station's end of fetching the server's state: asks for it in pieces, again where an answer is late, as
/// many at once as kWindow, and as fast as set_pace() says. Its memory is made once; a state that is larger is not
/// fetched.
class SnapshotFetch {
 public:
  explicit SnapshotFetch(std::size_t bytes_max) {
    data_.resize(bytes_max), asked_ns_.resize(pieces(bytes_max));
  }

  /// From now on: a new one, frozen when the server hears of it.
  void start() noexcept {
    id_ = id_ + 1 == 0 ? 1 : id_ + 1;
    guess_ = total_ > 0 ? pieces(total_) : kFirstGuess;
    total_ = have_ = whole_ = 0;
    known_ = refused_ = false;
    std::fill(asked_ns_.begin(), asked_ns_.end(), kNever);
    active_ = !data_.empty();
  }
  void stop() noexcept { active_ = false; }
  bool active() const noexcept { return active_; }
  /// The server's state is larger than this station has room for, or is none.
  bool refused() const noexcept { return refused_; }
  std::size_t pieces_here() const noexcept { return have_; }
  bool complete() const noexcept { return known_ && have_ == pieces(total_); }

  /// Pieces to ask for in a second, as the link allows; above 0. kPerSecond until it is said.
  void set_pace(double per_s) noexcept { pace_.set_per_s(per_s); }

  /// The next piece to ask for; false: none now.
  bool next(std::int64_t now_ns, std::int64_t wait_ns, SnapshotRequest& request) noexcept {
    if (!active_ || complete()) return false;
    // Until it is known how many there are: as many as the last state had.
    const std::size_t last = known_ ? pieces(total_) : std::min(guess_, asked_ns_.size());
    std::size_t under_way = 0;
    while (whole_ < last && asked_ns_[whole_] == kHere) ++whole_;
    for (std::size_t i = whole_; i < last && under_way < kWindow; ++i) {
      if (asked_ns_[i] == kHere) continue;
      if (asked_ns_[i] != kNever && now_ns - asked_ns_[i] <= wait_ns) {
        ++under_way;
        continue;
      }
      if (!pace_.take(now_ns)) return false;
      asked_ns_[i] = now_ns;
      request.snapshot = id_;
      request.piece = static_cast<std::uint32_t>(i);
      return true;
    }
    return false;
  }

  /// False: not of this snapshot, or one that is here already.
  bool take(const SnapshotPiece& piece) noexcept {
    if (!active_ || piece.snapshot != id_) return false;
    if (piece.total == 0 || piece.total > data_.size()) {
      active_ = false;
      refused_ = true;
      return false;
    }
    if (!known_) {
      known_ = true;
      total_ = piece.total;
      first_ = piece;
    }
    const std::size_t at = std::size_t{piece.piece} * kSnapshotPieceBytes;
    if (piece.total != total_ || piece.step != first_.step || piece.state_hash != first_.state_hash ||
        piece.breaks != first_.breaks || at >= total_ ||
        piece.size != std::min(kSnapshotPieceBytes, total_ - at) || asked_ns_[piece.piece] == kHere)
      return false;
    std::copy_n(piece.data.begin(), piece.size, data_.begin() + static_cast<std::ptrdiff_t>(at));
    asked_ns_[piece.piece] = kHere;
    ++have_;
    return true;
  }

  std::span<const std::uint8_t> data() const noexcept { return std::span(data_).first(total_); }
  std::uint64_t step() const noexcept { return first_.step; }  ///< after which it was frozen
  std::uint64_t state_hash() const noexcept { return first_.state_hash; }
  std::uint32_t breaks() const noexcept { return first_.breaks; }

  static constexpr std::size_t kWindow = 1024;
  static constexpr double kPerSecond = 2000;  ///< 7 Mbit/s: the most, on a link with room

 private:
  static constexpr std::size_t kFirstGuess = 2;  // no scene's state is smaller
  static constexpr double kBurst = 8;
  static constexpr std::int64_t kNever = INT64_MIN;
  static constexpr std::int64_t kHere = INT64_MAX;
  static constexpr std::size_t pieces(std::size_t bytes) noexcept {
    return (bytes + kSnapshotPieceBytes - 1) / kSnapshotPieceBytes;
  }

  std::vector<std::uint8_t> data_;
  std::vector<std::int64_t> asked_ns_;  // by piece
  std::uint32_t id_ = 0;
  std::size_t total_ = 0;
  std::size_t have_ = 0;
  std::size_t whole_ = 0;  // all before it are here
  std::size_t guess_ = kFirstGuess;
  TokenBucket pace_{kPerSecond, kBurst};
  bool known_ = false;
  bool active_ = false;
  bool refused_ = false;
  SnapshotPiece first_;
};

/// The server's end: one frozen state a session.
struct FrozenState {
  std::vector<std::uint8_t> bytes;  ///< as large as it may become, made with the session
  std::size_t size = 0;
  std::uint32_t id = 0;  ///< 0: none
  std::uint64_t step = 0;
  std::uint64_t state_hash = 0;
  std::uint32_t breaks = 0;
  std::int64_t at_ns = 0;

  /// False: there is no such piece.
  bool piece(std::uint32_t number, SnapshotPiece& out) const noexcept {
    const std::size_t at = std::size_t{number} * kSnapshotPieceBytes;
    if (id == 0 || (at >= size && number != 0)) return false;
    out.snapshot = id;
    out.piece = number;
    out.step = step;
    out.state_hash = state_hash;
    out.breaks = breaks;
    out.total = static_cast<std::uint32_t>(size);
    out.size = static_cast<std::uint32_t>(std::min(kSnapshotPieceBytes, size - std::min(at, size)));
    std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), out.size, out.data.begin());
    return true;
  }
};

}  // namespace telenano::link

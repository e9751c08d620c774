#pragma once

#include <cstdint>
#include <optional>

namespace telenano::studies {

/// Has another session moved the shared tip since this one held it? By what the replies say of the slave's state.
///
/// A tip that nobody holds stays as it is: while this session observes, only another one changes the state, or has changed the
/// state of a slave that was new. A tip that withdraws by its own clock changes too, and is free then, so that whose it was
/// does not matter (PortAccount).
class OtherHolders {
 public:
  /// `new_hash`: of the state of a slave that nobody has moved yet.
  explicit OtherHolders(std::uint64_t new_hash) noexcept : new_hash_(new_hash), standing_hash_(new_hash) {}

  void look(bool observes, std::uint64_t state_hash) noexcept {
    if (observes && standing_hash_ && *standing_hash_ != state_hash) moved_ = true;
    standing_hash_.reset();
    if (observes) standing_hash_ = state_hash;
  }
  bool moved() const noexcept { return moved_; }
  /// This session has the tip again, in the state that the others have left it in.
  void taken_up() noexcept { moved_ = false; }
  void begin_slave() noexcept { *this = OtherHolders(new_hash_); }

 private:
  std::uint64_t new_hash_;
  std::optional<std::uint64_t> standing_hash_;  // while this session does not hold the tip
  bool moved_ = false;
};

}  // namespace telenano::studies

#pragma once

#include <cstdint>
#include <string>

namespace telenano::app {

/// Where a station keeps the token of its session, so that one that was killed and started again goes on with
/// the same slave and the same account. Readable by its user only. Removed when the session has ended in order.
class SessionFile {
 public:
  /// Empty path: nothing is kept. Throws UserError for a file that is there and is none of ours.
  explicit SessionFile(std::string path);

  std::uint64_t token() const noexcept { return token_; }  ///< of an earlier run; 0 = none
  /// Writes another token than the last. What cannot be written is said once on standard error.
  void keep(std::uint64_t token);
  void remove() noexcept;

 private:
  std::string path_;
  std::uint64_t token_ = 0;
  bool warned_ = false;
};

}  // namespace telenano::app

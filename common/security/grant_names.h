#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <unordered_map>

namespace telenano::security {

/// What people call local users: they are in no list of keys. Bounded: the first that came are forgotten all at
/// once when there are too many.
///
/// Any thread. Locked for a look, and within handshakes only, which allocate too.
class GrantNames {
 public:
  static constexpr std::size_t kMost = 4096;

  void note(std::uint64_t number, const std::string& name) {
    const std::lock_guard lock(mutex_);
    if (names_.size() >= kMost && names_.count(number) == 0) names_.clear();
    names_[number] = name;
  }
  std::string name_of(std::uint64_t number) const {  ///< "" if not known
    const std::lock_guard lock(mutex_);
    const auto found = names_.find(number);
    return found == names_.end() ? "" : found->second;
  }

 private:
  mutable std::mutex mutex_;
  std::unordered_map<std::uint64_t, std::string> names_;
};

}  // namespace telenano::security

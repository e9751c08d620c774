#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

namespace telenano::security {

/// What the server's end has agreed on with peers, by session id, so that a peer that comes from another
/// address need not agree anew. Several DtlsServers may share one: whichever of them the peer meets then
/// resumes. Bounded; the oldest of a few that share a place gives way. What is in it is secret and is wiped
/// when it goes.
///
/// Any thread. Locked for a copy of some hundred bytes, and only within a handshake, which allocates too.
class ResumptionCache {
 public:
  using Id = std::array<std::uint8_t, 32>;
  /// Names the list of keys under which something was agreed on.
  using List = std::array<std::uint8_t, 32>;
  /// Room for an ECDSA certificate with its names; what is longer is not kept, and its peer agrees anew.
  static constexpr std::size_t kMaxBytes = 4096;

  /// At least `capacity` places, at least one. Throws std::bad_alloc.
  explicit ResumptionCache(std::size_t capacity);
  ~ResumptionCache();
  ResumptionCache(const ResumptionCache&) = delete;
  ResumptionCache& operator=(const ResumptionCache&) = delete;

  void keep(const Id& id, const List& list, std::span<const std::uint8_t> bytes) noexcept;
  /// How many bytes were written to `out`; 0 if there is nothing under this id, or too little room.
  std::size_t look_up(const Id& id, std::span<std::uint8_t> out) noexcept;
  void forget(const Id& id) noexcept;
  /// What was not agreed on under this list. One server after the other gets a new list: what the first ones
  /// have agreed on under it meanwhile stays.
  void forget_others(const List& list) noexcept;
  void forget_all() noexcept;

 private:
  struct Entry {
    Id id{};
    List list{};
    std::uint64_t number = 0;  // when it was kept; 0: nothing
    std::vector<std::uint8_t> bytes;
  };
  static constexpr std::size_t kWays = 4;

  std::span<Entry> places_of(const Id& id) noexcept;
  Entry* find(const Id& id) noexcept;
  static void wipe(Entry& entry) noexcept;

  std::mutex mutex_;
  std::uint64_t kept_ = 0;
  std::vector<Entry> entries_;
};

}  // namespace telenano::security

#pragma once

// Only for the files of this folder.

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "telenano/common/link/siphash.h"
#include "telenano/common/link/token_bucket.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/security/connection_id.h"
#include "telenano/common/security/dtls_access.h"
#include "telenano/common/security/dtls_address_check.h"
#include "telenano/common/security/dtls_channel.h"

namespace telenano::security {

/// One peer of the server, from its first valid cookie on.
struct Association {
  enum class State : std::uint8_t { kFree, kHandshaking, kEstablished };
  State state = State::kFree;
  std::unique_ptr<DtlsChannel> channel;
  net::Address address;
  std::array<std::uint8_t, 32> random{};  ///< of its ClientHello
  PeerIdentity identity;
  std::int64_t since_ns = 0;  ///< begin of the handshake, or last datagram opened
  std::uint64_t newest = 0;   ///< record_number() of those opened
  AddressCheck address_check;
  link::TokenBucket rate{1, 1};
};

/// A fixed number of places for associations, found by the peer's address or by connection id without
/// allocating.
class Associations {
 public:
  using State = Association::State;
  static constexpr std::size_t kNone = SIZE_MAX;

  /// `key`: addresses are hashed under it, so that nobody can choose those that meet.
  Associations(std::size_t capacity, const link::SipKey& key);

  std::size_t size() const noexcept { return places_.size(); }
  Association& operator[](std::size_t place) noexcept { return places_[place]; }
  const Association& operator[](std::size_t place) const noexcept { return places_[place]; }
  auto begin() noexcept { return places_.begin(); }
  auto end() noexcept { return places_.end(); }
  std::size_t count(State state) const noexcept;

  std::size_t find(const net::Address& address, State state) const noexcept;
  /// The established association of this name.
  std::size_t find(const ConnectionId& id) const noexcept;
  /// The established association to which an answer to this address belongs.
  std::size_t find(const net::Address& to) const noexcept;

  /// A free place for a handshake, or the one of the oldest handshake (see `state`), which must give way. Those
  /// under way share a quarter of the room: a crowd that never finishes neither takes the room of sessions nor
  /// keeps others out for long. kNone if all are established.
  std::size_t place_for_handshake() const noexcept;

  /// A peer at this address is in this place, which was free or held an association of another address.
  void enter(std::size_t place, const net::Address& address) noexcept;
  void release(std::size_t place) noexcept;

 private:
  std::uint64_t tag_of(const net::Address& address) const noexcept;
  void leave(std::size_t place) noexcept;
  std::size_t& first_of(std::uint64_t tag) noexcept { return buckets_[tag & (buckets_.size() - 1)]; }
  std::size_t first_of(std::uint64_t tag) const noexcept { return buckets_[tag & (buckets_.size() - 1)]; }

  link::SipKey key_;
  // Those whose tags have the same low bits are a chain through next_of_bucket_. Tag 0: in no chain.
  std::vector<std::uint64_t> tags_;
  std::vector<std::size_t> buckets_;
  std::vector<std::size_t> next_of_bucket_;
  std::vector<Association> places_;
  mutable std::size_t last_ = 0;  // found: mostly the next one's too
};

}  // namespace telenano::security

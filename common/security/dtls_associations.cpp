#include "telenano/common/security/dtls_associations.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace telenano::security {

Associations::Associations(std::size_t capacity, const link::SipKey& key)
    : key_(key),
      tags_(capacity),
      buckets_(std::bit_ceil(2 * capacity), kNone),
      next_of_bucket_(capacity, kNone),
      places_(capacity) {}

std::size_t Associations::count(State state) const noexcept {
  return static_cast<std::size_t>(
      std::count_if(places_.begin(), places_.end(), [&](const Association& a) { return a.state == state; }));
}

std::uint64_t Associations::tag_of(const net::Address& address) const noexcept {
  std::array<std::uint64_t, 3> words{};
  std::memcpy(words.data(), address.ip.data(), 16);
  words[2] = address.port;
  return std::max<std::uint64_t>(link::siphash_words(key_, words), 1);  // 0: in no chain
}

std::size_t Associations::find(const net::Address& address, State state) const noexcept {
  if (last_ < places_.size() && places_[last_].state == state && places_[last_].address == address)
    return last_;
  const std::uint64_t tag = tag_of(address);
  for (std::size_t place = first_of(tag); place != kNone; place = next_of_bucket_[place]) {
    if (tags_[place] == tag && places_[place].state == state && places_[place].address == address) {
      last_ = place;
      return place;
    }
  }
  return kNone;
}

std::size_t Associations::find(const ConnectionId& id) const noexcept {
  if (id.worker != 0 || id.slot >= places_.size()) return kNone;
  const Association& there = places_[id.slot];
  return there.state == State::kEstablished && there.channel->connection_id() == id ? id.slot : kNone;
}

std::size_t Associations::find(const net::Address& to) const noexcept {
  return to.channel != 0 ? find(ConnectionId::of(to.channel)) : find(to, State::kEstablished);
}

std::size_t Associations::place_for_handshake() const noexcept {
  const std::size_t handshakes_max = std::max<std::size_t>(places_.size() / 4, 1);
  std::size_t under_way = 0, oldest = kNone, free = kNone;
  for (std::size_t place = 0; place < places_.size(); ++place) {
    if (places_[place].state == State::kFree && free == kNone) free = place;
    if (places_[place].state != State::kHandshaking) continue;
    ++under_way;
    if (oldest == kNone || places_[place].since_ns < places_[oldest].since_ns) oldest = place;
  }
  return under_way < handshakes_max && free != kNone ? free : oldest;
}

void Associations::enter(std::size_t place, const net::Address& address) noexcept {
  leave(place);
  tags_[place] = tag_of(address);
  std::size_t& first = first_of(tags_[place]);
  next_of_bucket_[place] = first;
  first = place;
}

void Associations::leave(std::size_t place) noexcept {
  if (tags_[place] == 0) return;
  std::size_t* link = &first_of(tags_[place]);
  while (*link != place) link = &next_of_bucket_[*link];
  *link = next_of_bucket_[place];
  tags_[place] = 0;
}

void Associations::release(std::size_t place) noexcept {
  places_[place] = {};
  leave(place);
}

}  // namespace telenano::security

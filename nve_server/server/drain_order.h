#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telenano/common/net/datagram.h"

namespace telenano::server {

/// In which order the datagrams that waited together are looked at: by turns, one of each sender, the oldest
/// first, then the second of each. So who has sent many makes nobody wait for more than one of them. What one
/// sender has sent keeps its order.
///
/// Where as many wait as one drain takes, the server is behind: then all but the newest of each sender are
/// superseded, and their commands' motion is left to it (Server::on_datagram).
class DrainOrder {
 public:
  static constexpr std::size_t kMost = 256;  ///< datagrams of one drain

  struct Item {
    std::uint16_t index = 0;  ///< of the datagram, by its coming
    bool superseded = false;
  };

  /// `from(i)`: sender of datagram i of `count`, at most kMost. Valid until the next call.
  template <class From>
  std::span<const Item> of(std::size_t count, From&& from) noexcept {
    if (count == 1) {
      items_[0] = {};
      return {items_.data(), 1};
    }
    senders_ = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const net::Address& address = from(i);
      // As a rule there are few senders, or each has sent once: then the search is no longer than the batch.
      std::size_t s = 0;
      while (s < senders_ && !(*sender_[s] == address)) ++s;
      if (s == senders_) {
        sender_[senders_++] = &address;
        sent_[s] = 0;
      }
      sender_of_[i] = static_cast<std::uint16_t>(s);
      turn_[i] = sent_[s]++;
    }
    std::size_t written = 0;
    for (std::size_t turn = 0; written < count; ++turn) {
      for (std::size_t i = 0; i < count; ++i) {
        if (turn_[i] != turn) continue;
        items_[written].index = static_cast<std::uint16_t>(i);
        items_[written].superseded = count == kMost && turn + 1u < sent_[sender_of_[i]];
        ++written;
      }
    }
    return {items_.data(), count};
  }

 private:
  std::array<Item, kMost> items_{};
  std::array<const net::Address*, kMost> sender_{};
  std::array<std::uint16_t, kMost> sent_{};
  std::array<std::uint16_t, kMost> sender_of_{};
  std::array<std::uint16_t, kMost> turn_{};
  std::size_t senders_ = 0;
};

}  // namespace telenano::server

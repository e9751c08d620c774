#pragma once

#include <cstring>

#include "telenano/common/link/session_table.h"
#include "telenano/common/net/datagram.h"

namespace telenano::server {

/// Who speaks, as the table of sessions compares it.
inline link::PeerKey peer_key(const net::Address& address) noexcept {
  link::PeerKey key;
  std::memcpy(key.bytes.data(), address.ip.data(), address.ip.size());
  key.bytes[16] = static_cast<std::uint8_t>(address.port & 0xff);
  key.bytes[17] = static_cast<std::uint8_t>(address.port >> 8);
  key.channel = address.channel;
  return key;
}

}  // namespace telenano::server

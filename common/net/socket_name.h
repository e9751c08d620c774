#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "common/net/datagram.h"

namespace telenano::net {

// Addresses as the kernel has them, by hand: Asio's endpoints would check and copy each four times.

/// Of an IPv4 address within an IPv6 one (RFC 4291, 2.5.5.2), as Address holds it.
inline constexpr std::array<std::uint8_t, 12> kV4Prefix = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};

inline bool is_v4(const Address& a) noexcept {
  return std::equal(kV4Prefix.begin(), kV4Prefix.end(), a.ip.begin());
}

/// The longest that an IP socket knows: two of them share a line of the cache.
union SocketName {
  sockaddr_in6 v6;
  sockaddr_in v4;
};

inline Address from_kernel(const SocketName& name) noexcept {
  Address address;
  if (name.v4.sin_family == AF_INET) {
    std::memcpy(address.ip.data(), kV4Prefix.data(), kV4Prefix.size());
    std::memcpy(address.ip.data() + kV4Prefix.size(), &name.v4.sin_addr, 4);
    address.port = ntohs(name.v4.sin_port);
  } else {
    std::memcpy(address.ip.data(), &name.v6.sin6_addr, address.ip.size());
    address.port = ntohs(name.v6.sin6_port);
  }
  return address;
}

/// For a socket of IPv6, which takes IPv4 addresses too, or of IPv4, which takes no others. Its length.
inline socklen_t to_kernel(const Address& address, bool v6_socket, SocketName& name) noexcept {
  if (!v6_socket) {
    name.v4 = {};
    name.v4.sin_family = AF_INET;
    name.v4.sin_port = htons(address.port);
    std::memcpy(&name.v4.sin_addr, address.ip.data() + kV4Prefix.size(), 4);
    return sizeof name.v4;
  }
  name.v6 = {};
  name.v6.sin6_family = AF_INET6;
  name.v6.sin6_port = htons(address.port);
  std::memcpy(&name.v6.sin6_addr, address.ip.data(), address.ip.size());
  return sizeof name.v6;
}

/// Of Asio's endpoints, UDP's or TCP's, where sockets are made.
template <class Endpoint>
Endpoint to_endpoint(const Address& address) {
  SocketName name;
  const socklen_t length = to_kernel(address, !is_v4(address), name);
  Endpoint endpoint;
  std::memcpy(endpoint.data(), &name, length);
  endpoint.resize(length);
  return endpoint;
}

template <class Endpoint>
Address from_endpoint(const Endpoint& endpoint) noexcept {
  SocketName name{};
  std::memcpy(&name, endpoint.data(), std::min(endpoint.size(), sizeof name));
  return from_kernel(name);
}

}  // namespace telenano::net

#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "telenano/common/net/datagram.h"

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

inline bool is_any(const std::array<std::uint8_t, 16>& ip) noexcept {
  constexpr std::array<std::uint8_t, 16> kNone{};
  constexpr std::array<std::uint8_t, 16> kV4Any = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
  return ip == kNone || ip == kV4Any;
}

/// What a socket that listens on every address tells of a datagram, and what it is told for an answer
/// (IP_PKTINFO, ip(7); IPV6_PKTINFO, RFC 3542): which of this machine's addresses.
union HereInfo {
  in_pktinfo v4;
  in6_pktinfo v6;
};
inline constexpr std::size_t kHereControlBytes = CMSG_SPACE(sizeof(HereInfo));

/// Asks the kernel for it. False where it does not tell; answers then leave from where the route says.
inline bool tell_here(int socket, bool v6_socket) noexcept {
  const int on = 1;
  return v6_socket ? ::setsockopt(socket, IPPROTO_IPV6, IPV6_RECVPKTINFO, &on, sizeof on) == 0
                   : ::setsockopt(socket, IPPROTO_IP, IP_PKTINFO, &on, sizeof on) == 0;
}

inline bool tells_here(int socket, bool v6_socket) noexcept {
  int on = 0;
  socklen_t size = sizeof on;
  return (v6_socket ? ::getsockopt(socket, IPPROTO_IPV6, IPV6_RECVPKTINFO, &on, &size)
                    : ::getsockopt(socket, IPPROTO_IP, IP_PKTINFO, &on, &size)) == 0 &&
         on != 0;
}

/// `part` of what came with a datagram, if it is that; else `here` stays.
inline void here_of(const cmsghdr& part, std::array<std::uint8_t, 16>& here) noexcept {
  if (part.cmsg_level == IPPROTO_IP && part.cmsg_type == IP_PKTINFO) {
    in_pktinfo info;
    std::memcpy(&info, CMSG_DATA(&part), sizeof info);
    // Not ipi_addr, which of a broadcast is no address that an answer could have.
    std::memcpy(here.data(), kV4Prefix.data(), kV4Prefix.size());
    std::memcpy(here.data() + kV4Prefix.size(), &info.ipi_spec_dst, 4);
  } else if (part.cmsg_level == IPPROTO_IPV6 && part.cmsg_type == IPV6_PKTINFO) {
    in6_pktinfo info;  // of IPv4 within it too
    std::memcpy(&info, CMSG_DATA(&part), sizeof info);
    std::memcpy(here.data(), &info.ipi6_addr, here.size());
  }
}

/// Makes a datagram leave from `here`, any interface. `control`: kHereControlBytes, aligned as a cmsghdr.
inline void leave_from(const std::array<std::uint8_t, 16>& here, bool v6_socket, void* control,
                       msghdr& header) noexcept {
  header.msg_control = control;
  header.msg_controllen = kHereControlBytes;
  cmsghdr& part = *CMSG_FIRSTHDR(&header);
  if (v6_socket) {
    in6_pktinfo info{};
    std::memcpy(&info.ipi6_addr, here.data(), here.size());
    part.cmsg_level = IPPROTO_IPV6;
    part.cmsg_type = IPV6_PKTINFO;
    part.cmsg_len = CMSG_LEN(sizeof info);
    std::memcpy(CMSG_DATA(&part), &info, sizeof info);
    header.msg_controllen = CMSG_SPACE(sizeof info);
  } else {
    in_pktinfo info{};
    std::memcpy(&info.ipi_spec_dst, here.data() + kV4Prefix.size(), 4);
    part.cmsg_level = IPPROTO_IP;
    part.cmsg_type = IP_PKTINFO;
    part.cmsg_len = CMSG_LEN(sizeof info);
    std::memcpy(CMSG_DATA(&part), &info, sizeof info);
    header.msg_controllen = CMSG_SPACE(sizeof info);
  }
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

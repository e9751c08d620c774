#include "telenano/common/net/peer_user.h"

#include <arpa/inet.h>
#include <linux/inet_diag.h>
#include <linux/netlink.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <string>

#include "telenano/common/base/error.h"

namespace telenano::net {
namespace {

constexpr std::array<std::uint8_t, 12> kMapped{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};

bool is_mapped(const Address& address) noexcept {
  return std::equal(kMapped.begin(), kMapped.end(), address.ip.begin());
}

void write(const Address& address, bool mapped, __be32* to) noexcept {
  if (mapped) {
    std::memcpy(to, address.ip.data() + kMapped.size(), 4);
  } else {
    std::memcpy(to, address.ip.data(), address.ip.size());
  }
}

}  // namespace

PeerUser::PeerUser() {
  socket_ = ::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, NETLINK_SOCK_DIAG);
  // A socket of one's own, whose user is known.
  const int own = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof at;
  Address self;
  std::copy(kMapped.begin(), kMapped.end(), self.ip.begin());
  std::memcpy(self.ip.data() + kMapped.size(), &at.sin_addr.s_addr, 4);
  bool good = socket_ >= 0 && own >= 0 &&
              ::bind(own, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0 &&
              ::getsockname(own, reinterpret_cast<sockaddr*>(&at), &size) == 0;
  self.port = ntohs(at.sin_port);
  Address other = self;
  other.port = 9;
  good = good && of(self, other) == std::optional<std::uint32_t>(::geteuid());
  if (own >= 0) ::close(own);
  if (good) return;
  if (socket_ >= 0) ::close(socket_);
  throw UserError(
      "--local-users: this kernel does not tell the owner of a socket (udp_diag); use --keys instead");
}

PeerUser::~PeerUser() {
  if (socket_ >= 0) ::close(socket_);
}

std::optional<std::uint32_t> PeerUser::of(const Address& peer, const Address& local) noexcept {
  struct {
    nlmsghdr head;
    inet_diag_req_v2 question;
  } ask{};
  const bool mapped = is_mapped(peer);
  ask.head.nlmsg_len = sizeof ask;
  ask.head.nlmsg_type = SOCK_DIAG_BY_FAMILY;
  ask.head.nlmsg_flags = NLM_F_REQUEST;
  ask.head.nlmsg_seq = ++number_;
  ask.question.sdiag_family = mapped ? AF_INET : AF_INET6;
  ask.question.sdiag_protocol = IPPROTO_UDP;
  ask.question.idiag_states = ~0u;
  // As a datagram to the wanted socket would say it: from us, to the peer.
  ask.question.id.idiag_sport = htons(local.port);
  ask.question.id.idiag_dport = htons(peer.port);
  write(local, mapped, ask.question.id.idiag_src);
  write(peer, mapped, ask.question.id.idiag_dst);
  ask.question.id.idiag_cookie[0] = ask.question.id.idiag_cookie[1] = INET_DIAG_NOCOOKIE;
  if (::send(socket_, &ask, sizeof ask, 0) != static_cast<ssize_t>(sizeof ask)) return std::nullopt;
  // The kernel answers before send() returns. What is older is of a question that was given up.
  for (;;) {
    alignas(nlmsghdr) std::array<char, 2048> answer;
    const ssize_t n = ::recv(socket_, answer.data(), answer.size(), 0);
    if (n < 0 && errno == EINTR) continue;
    if (n < static_cast<ssize_t>(sizeof(nlmsghdr))) return std::nullopt;
    nlmsghdr head;
    std::memcpy(&head, answer.data(), sizeof head);
    if (head.nlmsg_seq != number_) continue;
    inet_diag_msg found;
    if (head.nlmsg_type != SOCK_DIAG_BY_FAMILY || static_cast<std::size_t>(n) < NLMSG_HDRLEN + sizeof found)
      return std::nullopt;
    std::memcpy(&found, answer.data() + NLMSG_HDRLEN, sizeof found);
    if (found.id.idiag_sport != htons(peer.port)) return std::nullopt;
    return found.idiag_uid;
  }
}

}  // namespace telenano::net

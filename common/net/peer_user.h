#pragma once

#include <cstdint>
#include <optional>

#include "telenano/common/net/datagram.h"

namespace telenano::net {

/// Which user of this machine has the UDP socket that a datagram came from: the kernel's own word (sock_diag(7)), not
/// the sender's. For peers on loopback, where nobody but root can write under an address that is another socket's.
class PeerUser {
 public:
  /// Throws UserError where this kernel does not say.
  PeerUser();
  ~PeerUser();
  PeerUser(const PeerUser&) = delete;
  PeerUser& operator=(const PeerUser&) = delete;

  /// The number of the user of the socket at `peer` that may talk to `local`; none: there is no such socket, or no
  /// word. Neither waits nor allocates; takes some microseconds.
  std::optional<std::uint32_t> of(const Address& peer, const Address& local) noexcept;

 private:
  int socket_ = -1;
  std::uint32_t number_ = 0;  // of the question
};

}  // namespace telenano::net

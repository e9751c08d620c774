#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/link/token_bucket.h"
#include "telenano/common/net/datagram.h"
#include "telenano/common/net/peer_user.h"
#include "telenano/common/rt/clock.h"

namespace telenano::app {

/// Who of this machine may come in without a key, on loopback, and what each may do.
struct LocalUserList {
  struct User {
    std::string name;  ///< as it was given
    std::uint32_t number = 0;
    net::Rights rights = net::Rights::kOperate;
    std::uint64_t identity = 0;  ///< net::Standing::identity
  };
  std::vector<User> users;

  const User* find(std::uint32_t number) const noexcept;
  /// "lab:operate,1001:observe". Throws UserError, one line: an unknown user, no right, one who comes twice.
  static LocalUserList parse(const std::string& text);
};

/// In front of a socket on loopback: lets through what comes from sockets of those users, with their right and a
/// number of theirs, so that a session is its user's alone and a share of the server is one user's. A user is asked
/// for with each Hello, since a port may be another user's by then; between, whoever has the port would also have to
/// know the session's number. Allocates nothing after it was made.
class LocalUsers final : public net::Datagram {
 public:
  /// `wire` and `clock` must outlive it. `peers`: places for those that are known. Throws as net::PeerUser does.
  LocalUsers(LocalUserList list, std::size_t peers, const net::Address& local, net::Datagram& wire,
             const rt::Clock& clock);

  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override {
    return wire_.send(bytes, to);
  }
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override;
  void flush() noexcept override { wire_.flush(); }

  /// Datagrams of nobody who is named. Any thread.
  std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  struct Known {
    net::Address address;
    const LocalUserList::User* user = nullptr;  // null: nobody of the list
    bool filled = false;
  };
  const LocalUserList::User* user_of(const net::Address& from, bool anew) noexcept;

  LocalUserList list_;
  net::PeerUser kernel_;
  net::Address local_;
  net::Datagram& wire_;
  const rt::Clock& clock_;
  link::TokenBucket questions_;
  std::vector<Known> known_;  // by a hash of the address; a newer one takes the place
  std::atomic<std::uint64_t> refused_{0};
};

}  // namespace telenano::app

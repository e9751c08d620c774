#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/net/datagram.h"
#include "telenano/master/connection/server_access.h"
#include "telenano/master/connection/server_link.h"

namespace telenano::connection {

/// "A,B" → "A", "B". Throws UserError for an empty place.
std::vector<std::string> server_names(const std::string& list, const char* flag = "--server",
                                      const char* expected = "HOST:PORT,HOST:PORT");

/// The servers that a station may have its session with, in the order in which it asks them: after the last
/// comes the first. One of them is the current one. As a Datagram it is the way to that one, whichever it is,
/// under one and the same address: who sends and receives need not know that there are several.
///
/// Going on to another one allocates nothing but what a secure handshake does (DtlsClient).
class ServerList final : public net::Datagram {
 public:
  /// `access.server`: HOST:PORT, or several with commas between. Throws UserError as ServerLink does.
  explicit ServerList(const ServerAccess& access);

  std::size_t size() const noexcept { return servers_.size(); }
  std::size_t current() const noexcept { return current_; }
  const std::string& name() const noexcept { return now().access.server; }  ///< of the current one
  const ServerAccess& access() const noexcept { return now().access; }
  const net::Address& address() const noexcept { return now().address; }
  ServerLink& link() noexcept { return servers_[current_]->link; }
  const ServerLink& link() const noexcept { return now().link; }
  void go_on() noexcept { current_ = (current_ + 1) % servers_.size(); }
  /// The network has answered that nobody listens there; it may be older than the newest attempt.
  bool nobody_listens() const noexcept { return now().link.nobody_listens(); }
  bool set_dscp(int dscp) noexcept;
  /// ServerLink::practise, of all.
  void practise(const link::PracticeLink& link);

  /// The address under which all are known to who uses this as a Datagram.
  const net::Address& as() const noexcept { return servers_.front()->address; }
  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override;
  void flush() noexcept override { link().datagram().flush(); }

 private:
  struct Server {
    Server(const ServerAccess& a, const net::Address& at) : access(a), address(at), link(a, at) {}
    ServerAccess access;
    net::Address address;
    ServerLink link;
  };
  const Server& now() const noexcept { return *servers_[current_]; }

  std::vector<std::unique_ptr<Server>> servers_;
  std::size_t current_ = 0;
};

}  // namespace telenano::connection

#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "telenano/common/net/udp.h"
#include "telenano/common/rt/steady_clock.h"
#include "telenano/common/security/dtls_client.h"
#include "telenano/master/connection/practice_datagram.h"
#include "telenano/master/connection/server_access.h"

namespace telenano::connection {

/// The way to the server: plain UDP on loopback, DTLS over it wherever a key or a certificate is given, which
/// it must be off loopback.
class ServerLink {
 public:
  /// Throws UserError for flags that do not go together or files that do not serve.
  ServerLink(const ServerAccess& options, const net::Address& server);

  /// Waits for the handshake. Throws RunError, one line with what to do: nobody answers, one side refuses the
  /// other, or `stop`. Nothing to do over plain UDP.
  void secure(const ServerAccess& options, const std::atomic<bool>& stop);

  net::Datagram& datagram() noexcept;
  /// From now on over a link that is worse by this, a stop and a Bye included; a secure handshake is not
  /// slowed. The first call allocates.
  void practise(const link::PracticeLink& link);
  bool is_secure() const noexcept { return dtls_ != nullptr; }
  /// Why there is no secure session any more, for the end of a message: "; the server does not know …", or
  /// "".
  std::string failure() const;
  /// Why nothing comes from `server`, as far as the network tells, and what to do: the end of a message.
  std::string advice(const std::string& server) const;
  /// Marks what is sent; false where the system does not let us.
  bool set_dscp(int dscp) noexcept { return socket_.set_dscp(dscp); }
  void wait_readable(std::int64_t timeout_ns) noexcept { socket_.wait_readable(timeout_ns); }

 private:
  net::Udp socket_;
  rt::SteadyClock clock_;
  std::unique_ptr<security::DtlsClient> dtls_;
  std::unique_ptr<PracticeDatagram> practice_;  // over the other two
};

/// Throws UserError as ServerLink does for what a station shows and expects, without a server.
void require_credentials(const ServerAccess& options);

/// How this station shows who it is, for the recording: "none", "key omega-1", "certificate FILE".
std::string describe_security(const ServerAccess& options);

}  // namespace telenano::connection

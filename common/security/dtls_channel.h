#pragma once

// Only for the files of this folder: with dtls_channel.cpp and dtls_context.*, all that knows OpenSSL's
// types.

#include <openssl/ssl.h>

#include <memory>
#include <optional>
#include <span>

#include "telenano/common/net/datagram.h"
#include "telenano/common/security/connection_id.h"

namespace telenano::security {

/// One end of a DTLS association with one peer: OpenSSL's state machine between a wire and a plain side.
/// OpenSSL reads exactly the datagram that it is handed and sends straight to the wire, so that borders of
/// datagrams stay, and nothing is queued or allocated in between.
class DtlsChannel {
 public:
  /// Null if there is no memory.
  static std::unique_ptr<DtlsChannel> make(SSL_CTX* context, net::Datagram& wire,
                                           const net::Address& peer) noexcept;
  ~DtlsChannel();
  DtlsChannel(const DtlsChannel&) = delete;
  DtlsChannel& operator=(const DtlsChannel&) = delete;

  SSL* ssl() noexcept { return ssl_; }
  const net::Address& peer() const noexcept { return peer_; }
  void set_peer(const net::Address& peer) noexcept { peer_ = peer; }

  /// Of the server's end, before its handshake: what it gives to a station that asks for one.
  void give_connection_id(const ConnectionId& id) noexcept { connection_id_ = id; }
  /// What the one end has given and the other has asked for; none where either does not know of such.
  std::optional<ConnectionId> connection_id() const noexcept {
    return agreed_ ? connection_id_ : std::nullopt;
  }
  /// From now on what is sent begins with it. For the station's end.
  void show_connection_id() noexcept { shows_id_ = agreed_; }

  /// The datagram that the next call of OpenSSL reads; must live until forget().
  void offer(std::span<const std::uint8_t> datagram) noexcept { incoming_ = datagram; }
  void forget() noexcept { incoming_ = {}; }

  enum class Step : std::uint8_t { kWaiting, kDone, kFailed };
  /// Goes on with the handshake as far as the offered datagram (or, with none, a timer) carries it.
  Step handshake() noexcept;
  /// Repeats the last flight if its time has come.
  Step on_timer() noexcept;

  enum class Open : std::uint8_t { kData, kNothing, kClosed };
  /// Opens one sealed datagram into `plain`. kNothing: forged, repeated, too old, too short for a seal, or
  /// not data.
  Open open(std::span<const std::uint8_t> datagram, std::span<std::uint8_t> plain,
            std::size_t& size) noexcept;
  /// Seals and sends. Established channels only.
  net::SendStatus send(std::span<const std::uint8_t> plain) noexcept;
  /// Tells the peer that this association is over.
  void close() noexcept;
  /// Over without a word, because another one takes its place. OpenSSL holds an association that just goes
  /// away for a broken one and would let nobody resume what it had agreed on.
  void retire() noexcept;

 private:
  DtlsChannel(net::Datagram& wire, const net::Address& peer) noexcept : wire_(wire), peer_(peer) {}
  static const BIO_METHOD* bio_method() noexcept;
  friend void offer_connection_ids(SSL_CTX* context, bool server);
  net::SendStatus to_wire(std::span<const std::uint8_t> bytes) noexcept;

  net::Datagram& wire_;
  net::Address peer_;
  std::span<const std::uint8_t> incoming_;
  net::SendStatus sent_ = net::SendStatus::kSent;
  SSL* ssl_ = nullptr;
  std::optional<ConnectionId> connection_id_;
  std::array<std::uint8_t, ConnectionId::kBytes> given_{};
  bool agreed_ = false;  // on connection_id_: asked for in one Hello, given in the other
  bool shows_id_ = false;
};

/// Has every association of this context ask for a connection id (a station's), or give one to whoever asks
/// (a server's). Throws RunError.
void offer_connection_ids(SSL_CTX* context, bool server);

}  // namespace telenano::security

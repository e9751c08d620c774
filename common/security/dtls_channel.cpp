#include "telenano/common/security/dtls_channel.h"

#include <openssl/bio.h>
#include <openssl/err.h>

#include <algorithm>
#include <new>

#include "telenano/common/base/error.h"
#include "telenano/common/security/dtls_context.h"
#include "telenano/common/security/dtls_record.h"

namespace telenano::security {

// OpenSSL's memory BIOs lose the borders of datagrams; this one is handed a datagram at a time.
const BIO_METHOD* DtlsChannel::bio_method() noexcept {
  static const BIO_METHOD* const method = [] {
    BIO_METHOD* const m = BIO_meth_new(BIO_get_new_index() | BIO_TYPE_SOURCE_SINK, "telenano datagram");
    if (m == nullptr) return m;
    BIO_meth_set_create(m, [](BIO* bio) {
      BIO_set_init(bio, 1);
      return 1;
    });
    BIO_meth_set_read(m, [](BIO* bio, char* out, int capacity) {
      BIO_clear_retry_flags(bio);
      auto& self = *static_cast<DtlsChannel*>(BIO_get_data(bio));
      if (self.incoming_.empty() || capacity <= 0) {
        BIO_set_retry_read(bio);
        return -1;
      }
      const std::size_t n = std::min(self.incoming_.size(), static_cast<std::size_t>(capacity));
      std::copy_n(self.incoming_.begin(), n, out);
      self.incoming_ = {};
      return static_cast<int>(n);
    });
    // The network may lose a datagram at any time, so a full queue is no error to OpenSSL.
    BIO_meth_set_write(m, [](BIO* bio, const char* bytes, int size) {
      BIO_clear_retry_flags(bio);
      auto& self = *static_cast<DtlsChannel*>(BIO_get_data(bio));
      self.sent_ =
          self.to_wire({reinterpret_cast<const std::uint8_t*>(bytes), static_cast<std::size_t>(size)});
      return size;
    });
    BIO_meth_set_ctrl(m, [](BIO*, int command, long, void*) -> long {
      switch (command) {
        case BIO_CTRL_FLUSH:
          return 1;
        case BIO_CTRL_DGRAM_QUERY_MTU:
        case BIO_CTRL_DGRAM_GET_FALLBACK_MTU:
          return static_cast<long>(kHandshakeMtu);
        default:
          return 0;
      }
    });
    return m;
  }();
  return method;
}

net::SendStatus DtlsChannel::to_wire(std::span<const std::uint8_t> bytes) noexcept {
  std::array<std::uint8_t, kMaxWireBytes> named;
  constexpr std::size_t kPrefix = std::tuple_size_v<ConnectionPrefix>;
  if (!shows_id_ || bytes.size() > named.size() - kPrefix) return wire_.send(bytes, peer_);
  const auto id = connection_id_->bytes();
  named[0] = kConnectionMark;
  std::copy(id.begin(), id.end(), named.begin() + 1);
  std::copy(bytes.begin(), bytes.end(), named.begin() + kPrefix);
  return wire_.send({named.data(), kPrefix + bytes.size()}, peer_);
}

std::unique_ptr<DtlsChannel> DtlsChannel::make(SSL_CTX* context, net::Datagram& wire,
                                               const net::Address& peer) noexcept {
  std::unique_ptr<DtlsChannel> channel(new (std::nothrow) DtlsChannel(wire, peer));
  if (!channel || bio_method() == nullptr) return nullptr;
  channel->ssl_ = SSL_new(context);
  BIO* const bio = BIO_new(bio_method());
  if (channel->ssl_ == nullptr || bio == nullptr) {
    BIO_free(bio);
    return nullptr;
  }
  BIO_set_data(bio, channel.get());
  SSL_set_app_data(channel->ssl_, channel.get());
  SSL_set_bio(channel->ssl_, bio, bio);  // takes it over
  SSL_set_mtu(channel->ssl_, static_cast<long>(kHandshakeMtu));
  // First repetition after 200 ms, as the protocol's own Hello; then twice as long each time, at most 2 s.
  DTLS_set_timer_cb(channel->ssl_, [](SSL*, unsigned last_us) {
    return last_us == 0 ? 200'000u : std::min(2 * last_us, 2'000'000u);
  });
  return channel;
}

DtlsChannel::~DtlsChannel() {
  SSL_free(ssl_);
}

namespace {

/// Of the suite agreed on. Only ChaCha20-Poly1305 seals with less than AES-GCM.
std::size_t seal_bytes(const SSL* ssl) noexcept {
  const SSL_CIPHER* const suite = SSL_get_current_cipher(ssl);
  const bool chacha = suite != nullptr && SSL_CIPHER_get_cipher_nid(suite) == NID_chacha20_poly1305;
  return chacha ? kChaChaSealBytes : kAesGcmSealBytes;
}

DtlsChannel& channel_of(SSL* ssl) noexcept {
  return *static_cast<DtlsChannel*>(SSL_get_app_data(ssl));
}

}  // namespace

DtlsChannel::Step DtlsChannel::handshake() noexcept {
  // Which suite it will be is not known yet. No sealed part of a handshake is as short as the longer seal.
  if (!well_formed(incoming_, kAesGcmSealBytes)) forget();
  ERR_clear_error();
  const int result = SSL_do_handshake(ssl_);
  forget();
  if (result == 1) return Step::kDone;
  const int error = SSL_get_error(ssl_, result);
  return error == SSL_ERROR_WANT_READ || error == SSL_ERROR_WANT_WRITE ? Step::kWaiting : Step::kFailed;
}

DtlsChannel::Step DtlsChannel::on_timer() noexcept {
  timeval left{};
  // The time to the next repetition, by the wall clock: OpenSSL knows no other.
  if (DTLSv1_get_timeout(ssl_, &left) != 1 || left.tv_sec > 0 || left.tv_usec > 0) return Step::kWaiting;
  ERR_clear_error();
  return DTLSv1_handle_timeout(ssl_) < 0 ? Step::kFailed : Step::kWaiting;
}

DtlsChannel::Open DtlsChannel::open(std::span<const std::uint8_t> datagram, std::span<std::uint8_t> plain,
                                    std::size_t& size) noexcept {
  if (!well_formed(datagram, seal_bytes(ssl_))) return Open::kNothing;
  ERR_clear_error();
  offer(datagram);
  const int n = SSL_read(ssl_, plain.data(), static_cast<int>(plain.size()));
  forget();
  if (n > 0) {
    size = static_cast<std::size_t>(n);
    // One record a datagram. What else there is must not wait for the next one: it would come a tick late,
    // for ever.
    std::array<std::uint8_t, 64> rest;
    while (SSL_has_pending(ssl_) != 0 && SSL_read(ssl_, rest.data(), static_cast<int>(rest.size())) > 0) {
    }
    return Open::kData;
  }
  const int error = SSL_get_error(ssl_, n);
  return error == SSL_ERROR_WANT_READ || error == SSL_ERROR_WANT_WRITE ? Open::kNothing : Open::kClosed;
}

net::SendStatus DtlsChannel::send(std::span<const std::uint8_t> plain) noexcept {
  ERR_clear_error();
  sent_ = net::SendStatus::kFailed;
  const int n = SSL_write(ssl_, plain.data(), static_cast<int>(plain.size()));
  return n == static_cast<int>(plain.size()) ? sent_ : net::SendStatus::kFailed;
}

void DtlsChannel::close() noexcept {
  ERR_clear_error();
  if (SSL_is_init_finished(ssl_) != 0) SSL_shutdown(ssl_);
}

void DtlsChannel::retire() noexcept {
  SSL_set_shutdown(ssl_, SSL_SENT_SHUTDOWN | SSL_RECEIVED_SHUTDOWN);
}

// OpenSSL shows the server's answer only to a station that has asked, and sends it only to one.
void offer_connection_ids(SSL_CTX* context, bool server) {
  const SSL_custom_ext_add_cb_ex ask = [](SSL*, unsigned, unsigned, const unsigned char** out,
                                          std::size_t* size, X509*, std::size_t, int*, void*) {
    *out = nullptr;
    *size = 0;
    return 1;
  };
  const SSL_custom_ext_add_cb_ex give = [](SSL* ssl, unsigned, unsigned, const unsigned char** out,
                                           std::size_t* size, X509*, std::size_t, int*, void*) {
    DtlsChannel& channel = channel_of(ssl);
    if (!channel.connection_id_) return 0;
    channel.given_ = channel.connection_id_->bytes();
    channel.agreed_ = true;
    *out = channel.given_.data();
    *size = channel.given_.size();
    return 1;
  };
  const SSL_custom_ext_parse_cb_ex take = [](SSL* ssl, unsigned, unsigned, const unsigned char* in,
                                             std::size_t size, X509*, std::size_t, int* alert, void*) {
    DtlsChannel& channel = channel_of(ssl);
    if (size != ConnectionId::kBytes) {
      *alert = SSL_AD_DECODE_ERROR;
      return 0;
    }
    channel.connection_id_ = ConnectionId::read({in, size});
    channel.agreed_ = true;
    return 1;
  };
  const SSL_custom_ext_parse_cb_ex asked = [](SSL*, unsigned, unsigned, const unsigned char*, std::size_t,
                                              X509*, std::size_t, int*, void*) { return 1; };
  constexpr unsigned kWhere = SSL_EXT_CLIENT_HELLO | SSL_EXT_TLS1_2_SERVER_HELLO;
  if (SSL_CTX_add_custom_ext(context, kConnectionExtension, kWhere, server ? give : ask, nullptr, nullptr,
                             server ? asked : take, nullptr) != 1)
    throw RunError("DTLS cannot be set up: " + openssl_reason());
}

}  // namespace telenano::security

#include "telenano/common/security/dtls_channel.h"

#include <openssl/bio.h>
#include <openssl/err.h>

#include <algorithm>
#include <new>

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
      self.sent_ = self.wire_.send(
          {reinterpret_cast<const std::uint8_t*>(bytes), static_cast<std::size_t>(size)}, self.peer_);
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

DtlsChannel::Step DtlsChannel::handshake() noexcept {
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

}  // namespace telenano::security

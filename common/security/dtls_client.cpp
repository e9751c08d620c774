#include "telenano/common/security/dtls_client.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <array>

#include "telenano/common/base/error.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/security/dtls_channel.h"
#include "telenano/common/security/dtls_context.h"
#include "telenano/common/security/dtls_record.h"

namespace telenano::security {
namespace {

constexpr int kNoAlert = -1;

// Type of the protocol's Hello (PROTOCOL.md 1): the only datagram that waits for the end of a handshake. It
// starts or resumes a session; everything else is superseded a tick later.
bool is_hello(std::span<const std::uint8_t> bytes) noexcept {
  return bytes.size() == link::kMaxDatagramBytes && bytes[5] == 1;
}

// What the server's alert means (RFC 5246 7.2.2, RFC 4279), and what to do.
std::string alert_text(int alert, const std::string& who) {
  switch (alert) {
    case SSL_AD_UNKNOWN_PSK_IDENTITY:
      return "the server does not know " + who +
             ": on the server's machine, telenano-nve keys list shows whom it knows and what has expired, "
             "keys new makes a key";
    case SSL_AD_BAD_CERTIFICATE:
      return "the server refuses " + who +
             ": it is not in the server's list of keys; add it there under [[certificate]]";
    case SSL_AD_CERTIFICATE_EXPIRED:
      return "the server refuses " + who + ": it has expired; renew it, or set the clocks";
    case SSL_AD_UNKNOWN_CA:
    case SSL_AD_CERTIFICATE_UNKNOWN:
      return "the server refuses " + who +
             ": it does not know the authority that has signed it; see the server's --ca";
    case SSL_AD_PROTOCOL_VERSION:
      return "the server speaks another version of DTLS than 1.2; update the older side";
    case SSL_AD_HANDSHAKE_FAILURE:
      return "the server and this station agree on no way of proving who they are: a server with --keys "
             "takes "
             "--key, one that knows public keys (keys add) takes --identity, one with --cert takes --cert, "
             "and both "
             "speak DTLS 1.2";
    default:
      return "the server refuses " + who + " (" + SSL_alert_desc_string_long(alert) + ")";
  }
}

struct FreeSession {
  void operator()(SSL_SESSION* session) const noexcept { SSL_SESSION_free(session); }
};

}  // namespace

struct DtlsClient::Impl {
  Impl(const DtlsClientConfig& c, net::Datagram& w, const net::Address& to, const rt::Clock& time)
      : config(c),
        context(make_context(false, c.key.has_value(), c.certificates, c.identity)),
        wire(w),
        server(to),
        clock(time) {
    const int shown =
        (config.key ? 1 : 0) + (config.certificates ? 1 : 0) + (config.identity.empty() ? 0 : 1);
    if (shown != 1) throw UserError("a secure session needs one of --key, --identity and --cert");
    if (!config.identity.empty())
      SSL_CTX_set_verify(context.get(), SSL_CTX_get_verify_mode(context.get()), &Impl::on_server_key);
    SSL_CTX_set_app_data(context.get(), this);
    SSL_CTX_set_psk_client_callback(context.get(), &Impl::on_psk);
    if (config.connection_id) offer_connection_ids(context.get(), false);
    now_ns = clock.now_ns();
    begin();
  }

  ~Impl() {
    if (current) current->close();
  }

  static unsigned on_psk(SSL* ssl, const char*, char* identity, unsigned identity_room, unsigned char* key,
                         unsigned key_room) {
    const Impl& self = *static_cast<Impl*>(SSL_CTX_get_app_data(SSL_get_SSL_CTX(ssl)));
    const StationKey& own = *self.config.key;
    if (own.identity.size() >= identity_room || key_room < Psk::kBytes) return 0;
    *std::copy(own.identity.begin(), own.identity.end(), identity) = '\0';
    std::copy(own.psk.bytes.begin(), own.psk.bytes.end(), key);
    return static_cast<unsigned>(Psk::kBytes);
  }

  // The server's certificate is signed by itself; its key must be the one that this station was told.
  static int on_server_key(int, X509_STORE_CTX* store) {
    const SSL* const ssl =
        static_cast<SSL*>(X509_STORE_CTX_get_ex_data(store, SSL_get_ex_data_X509_STORE_CTX_idx()));
    Impl& self = *static_cast<Impl*>(SSL_CTX_get_app_data(SSL_get_SSL_CTX(ssl)));
    const bool leaf = X509_STORE_CTX_get_error_depth(store) == 0;
    CertificateIdentity shown;
    const bool good = leaf && identify(X509_STORE_CTX_get_current_cert(store), shown) &&
                      std::any_of(self.config.server_keys.begin(), self.config.server_keys.end(),
                                  [&](const std::string& key) { return key == shown.public_key.data(); });
    if (leaf) self.server_key = shown.public_key;
    X509_STORE_CTX_set_error(store, good || !leaf ? X509_V_OK : X509_V_ERR_CERT_REJECTED);
    return good || !leaf ? 1 : 0;
  }

  // The certificate must name whom this station was told to talk to.
  bool expect_server_name(SSL* ssl) const noexcept {
    X509_VERIFY_PARAM* const expected = SSL_get0_param(ssl);
    return X509_VERIFY_PARAM_set1_ip_asc(expected, config.server_name.c_str()) == 1 ||
           SSL_set1_host(ssl, config.server_name.c_str()) == 1;
  }

  void begin() noexcept {
    attempt_ns = now_ns;
    answered = false;
    fresh = DtlsChannel::make(context.get(), wire, server);
    if (!fresh) return;
    SSL_set_connect_state(fresh->ssl());
    if (config.certificates && !expect_server_name(fresh->ssl())) {
      fresh.reset();
      return;
    }
    if (session) SSL_set_session(fresh->ssl(), session.get());
    advance({});
  }

  void give_up() noexcept {
    fresh.reset();
    attempt_ns = now_ns;
  }

  void advance(std::span<const std::uint8_t> bytes) noexcept {
    fresh->offer(bytes);
    switch (fresh->handshake()) {
      case DtlsChannel::Step::kWaiting:
        return;
      case DtlsChannel::Step::kFailed:
        note_failure();
        return give_up();
      case DtlsChannel::Step::kDone:
        break;
    }
    ++counters.handshakes;
    if (SSL_session_reused(fresh->ssl()) != 0) ++counters.resumed;
    session.reset(SSL_get1_session(fresh->ssl()));
    if (current) current->retire();
    current = std::move(fresh);
    current->show_connection_id();
    unanswered = false;
    alert = kNoAlert;
    verify = X509_V_OK;
    if (hello_waits) current->send(hello);
    hello_waits = false;
  }

  void note_failure() noexcept {
    session.reset();  // perhaps it was the resumption that the server did not like
    verify = SSL_get_verify_result(fresh->ssl());
    const int reason = ERR_GET_REASON(ERR_peek_error());
    alert = reason >= SSL_AD_REASON_OFFSET ? reason - SSL_AD_REASON_OFFSET : kNoAlert;
    if (verify == X509_V_OK && alert == kNoAlert) alert = SSL_AD_HANDSHAKE_FAILURE;
  }

  void on_time() noexcept {
    if (fresh) {
      if (now_ns - attempt_ns > config.handshake_timeout_ns ||
          fresh->on_timer() == DtlsChannel::Step::kFailed)
        give_up();
      return;
    }
    const bool silent = current && unanswered && now_ns - unanswered_ns > config.silence_ns;
    if ((!current || silent) && now_ns - attempt_ns > config.retry_ns) begin();
  }

  /// Is this the server's question whether we are where we seem to be? Then it is answered at once.
  bool answer_question(std::span<const std::uint8_t> plain) noexcept {
    AddressProof proof;
    if (plain.size() != proof.size() ||
        !std::equal(kAddressQuestion.begin(), kAddressQuestion.end(), plain.begin()))
      return false;
    std::copy(plain.begin(), plain.end(), proof.begin());
    std::copy(kAddressAnswer.begin(), kAddressAnswer.end(), proof.begin());
    current->send(proof);
    ++counters.proofs;
    return true;
  }

  bool open(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> buffer,
            net::Received& received) noexcept {
    switch (current->open(bytes, buffer, received.size)) {
      case DtlsChannel::Open::kData:
        ++counters.opened;
        unanswered = false;
        if (answer_question(buffer.first(std::min(received.size, buffer.size())))) return false;
        received.standing = {true, net::Rights::kAdminister};
        return true;
      case DtlsChannel::Open::kNothing:
        ++counters.forged;
        return false;
      case DtlsChannel::Open::kClosed:  // the server has said so, under seal
        current->retire();
        current.reset();
        return false;
    }
    return false;
  }

  bool on_wire(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> buffer,
               net::Received& received) noexcept {
    const RecordKind kind = kind_of(bytes);
    const bool data = kind == RecordKind::kData || kind == RecordKind::kAlert;
    const bool in_clear = bytes.size() > 4 && bytes[3] == 0 && bytes[4] == 0;
    if (kind == RecordKind::kNotDtls || !(received.from == server)) {
      ++counters.forged;
      return false;
    }
    // An alert in the clear can only belong to a handshake; under seal, or data, to what is established.
    if (fresh && (!current || in_clear || !data)) {
      answered = true;
      advance(bytes);
      return false;
    }
    if (current) return open(bytes, buffer, received);
    ++counters.forged;
    return false;
  }

  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
    now_ns = clock.now_ns();
    for (int i = 0; i < kDatagramsPerReceive; ++i) {
      if (!wire.receive(cipher, received)) break;
      if (received.size > cipher.size()) {
        ++counters.forged;
      } else if (on_wire({cipher.data(), received.size}, buffer, received)) {
        return true;
      }
    }
    on_time();
    return false;
  }

  net::SendStatus send(std::span<const std::uint8_t> bytes) noexcept {
    if (fresh || !current) {
      if (is_hello(bytes)) {
        std::copy(bytes.begin(), bytes.end(), hello.begin());
        hello_waits = true;
      }
    }
    if (!current) return net::SendStatus::kWouldBlock;
    if (!unanswered) {
      unanswered = true;
      unanswered_ns = now_ns;
    }
    return current->send(bytes);
  }

  std::string who() const {
    if (!config.identity.empty()) return "the public key of " + config.identity;
    return config.key ? "the key '" + config.key->identity + "'"
                      : "the certificate " + config.certificates->certificate;
  }

  DtlsClientConfig config;
  std::array<char, 65> server_key{};  // that the server has shown last
  DtlsContext context;
  net::Datagram& wire;
  net::Address server;
  const rt::Clock& clock;
  std::unique_ptr<SSL_SESSION, FreeSession> session;
  std::unique_ptr<DtlsChannel> current;  // established
  std::unique_ptr<DtlsChannel> fresh;    // handshake under way
  bool answered = false;                 // has anything come in this attempt?
  int alert = kNoAlert;                  // that ended the last attempt
  long verify = X509_V_OK;               // what was wrong with the server's certificate
  bool hello_waits = false;
  std::array<std::uint8_t, link::kMaxDatagramBytes> hello{};
  std::int64_t now_ns = 0;
  std::int64_t attempt_ns = 0;     // begin of the attempt under way, or end of the last
  bool unanswered = false;         // something was sent since the server was last heard,
  std::int64_t unanswered_ns = 0;  // the first of it then
  std::array<std::uint8_t, kMaxWireBytes> cipher{};
  Counters counters;
};

DtlsClient::DtlsClient(const DtlsClientConfig& config, net::Datagram& wire, const net::Address& server,
                       const rt::Clock& clock)
    : impl_(std::make_unique<Impl>(config, wire, server, clock)) {}

DtlsClient::~DtlsClient() = default;

net::SendStatus DtlsClient::send(std::span<const std::uint8_t> bytes, const net::Address&) noexcept {
  return impl_->send(bytes);
}

bool DtlsClient::receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
  return impl_->receive(buffer, received);
}

bool DtlsClient::established() const noexcept {
  return impl_->current != nullptr;
}

bool DtlsClient::refused() const noexcept {
  return impl_->alert != kNoAlert || impl_->verify != X509_V_OK;
}

std::string DtlsClient::failure() const {
  if (impl_->verify != X509_V_OK && !impl_->config.identity.empty()) {
    return std::string("the server is not the one of --server-key, it shows sha256:") +
           impl_->server_key.data() + "; ask whoever runs it: telenano-nve keys identity prints its key";
  }
  if (impl_->alert == SSL_AD_BAD_CERTIFICATE && !impl_->config.identity.empty()) {
    return "the server does not know " + impl_->who() +
           ": on the server's machine, telenano-nve keys list shows whom it knows and what has expired; "
           "telenano-master "
           "enroll prints the line that adds it";
  }
  if (impl_->verify == X509_V_ERR_HOSTNAME_MISMATCH || impl_->verify == X509_V_ERR_IP_ADDRESS_MISMATCH) {
    return "the server's certificate is not for '" + impl_->config.server_name +
           "'; call the server by the name or address that its certificate has";
  }
  if (impl_->verify == X509_V_ERR_CERT_HAS_EXPIRED)
    return "the server's certificate has expired; have it renewed, or set this machine's clock";
  if (impl_->verify == X509_V_ERR_CERT_NOT_YET_VALID)
    return "the server's certificate is not valid yet; set this machine's clock";
  if (impl_->verify != X509_V_OK) {
    return std::string("the server's certificate is signed by none of --ca ") +
           impl_->config.certificates->authority + " (" + X509_verify_cert_error_string(impl_->verify) + ")";
  }
  if (impl_->alert != kNoAlert) return alert_text(impl_->alert, impl_->who());
  if (impl_->answered) {
    return "the server answers, but the handshake does not come to its end: most likely " + impl_->who() +
           " is not the one that the server has under this name";
  }
  return "";
}

const DtlsClient::Counters& DtlsClient::counters() const noexcept {
  return impl_->counters;
}

}  // namespace telenano::security

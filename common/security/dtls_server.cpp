#include "telenano/common/security/dtls_server.h"

#include <openssl/err.h>
#include <openssl/rand.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/link/siphash.h"
#include "telenano/common/link/token_bucket.h"
#include "telenano/common/rt/thread_time.h"
#include "telenano/common/security/dtls_access.h"
#include "telenano/common/security/dtls_associations.h"
#include "telenano/common/security/dtls_channel.h"
#include "telenano/common/security/dtls_context.h"
#include "telenano/common/security/dtls_cookie.h"
#include "telenano/common/security/dtls_record.h"
#include "telenano/common/security/dtls_resumption.h"
#include "telenano/common/security/handshake_budget.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;
using State = Association::State;

constexpr std::size_t kNone = Associations::kNone;
constexpr std::int64_t kTickNs = 5'000'000;
constexpr std::size_t kAddressBuckets = 256;

// What the caller leaves out.
DtlsServerConfig completed(DtlsServerConfig config) {
  if (!config.resumption) config.resumption = std::make_shared<ResumptionCache>(4 * config.capacity);
  return config;
}

link::SipKey random_sip_key() {
  link::SipKey key;
  if (RAND_bytes(reinterpret_cast<unsigned char*>(&key), sizeof key) != 1)
    throw RunError("no random numbers: " + openssl_reason());
  return key;
}

}  // namespace

struct DtlsServer::Impl {
  Impl(const DtlsServerConfig& c, KeyList k, net::Datagram& w, const rt::Clock& time,
       const rt::Clock* work_time)
      : config(completed(c)),
        access(c.certificates.has_value(), std::move(k)),
        context(make_context(true, true, c.certificates, c.identity)),
        wire(w),
        clock(time),
        work(work_time != nullptr ? *work_time : thread_time),
        peers(c.capacity, hash_key),
        addresses(kAddressBuckets, {c.handshakes_per_address_s, c.handshakes_per_address_burst}),
        strangers(c.cookies_per_s, std::max(1.0, c.cookies_per_s / 10)),
        budget(c.handshake_share, c.handshake_burst_ns) {
    SSL_CTX* const ssl = context.get();
    SSL_CTX_set_app_data(ssl, this);
    SSL_CTX_set_psk_server_callback(ssl, &Impl::on_psk);
    SSL_CTX_set_cookie_generate_cb(ssl, &Impl::on_cookie_wanted);
    SSL_CTX_set_cookie_verify_cb(ssl, &Impl::on_cookie);
    SSL_CTX_set_verify(ssl, SSL_CTX_get_verify_mode(ssl), &Impl::on_certificate);
    if (config.connection_ids) offer_connection_ids(ssl, true);
    // A station that roams resumes what it had agreed on, which saves a round trip.
    resume_by(ssl, *config.resumption);
    resume_under(ssl, nullptr, access.list_name());
    listener = DtlsChannel::make(ssl, wire, {});
    if (!listener || !nothing) throw RunError("DTLS cannot be set up: " + openssl_reason());
  }

  ~Impl() {
    for (Association& peer : peers) {
      if (peer.state == State::kEstablished) peer.channel->close();
    }
    delete fresh_keys.load();
    delete retired_keys.load();
  }

  static Impl& of(SSL* ssl) noexcept {
    return *static_cast<Impl*>(SSL_CTX_get_app_data(SSL_get_SSL_CTX(ssl)));
  }

  // --- OpenSSL's questions -------------------------------------------------------------------------------

  static int on_cookie_wanted(SSL* ssl, unsigned char* out, unsigned* size) {
    Impl& self = of(ssl);
    const auto cookie = self.cookies.make(self.speaking->peer(), self.now_ns);
    if (!cookie) return 0;
    std::copy(cookie->begin(), cookie->end(), out);
    *size = static_cast<unsigned>(cookie->size());
    self.counters.add(Event::kCookies);
    return 1;
  }

  static int on_cookie(SSL* ssl, const unsigned char* shown, unsigned size) {
    Impl& self = of(ssl);
    return self.cookies.fits({shown, size}, self.speaking->peer(), self.now_ns) ? 1 : 0;
  }

  static unsigned on_psk(SSL* ssl, const char* identity, unsigned char* out, unsigned capacity) {
    Impl& self = of(ssl);
    const std::optional<Psk> psk = self.access.psk_of(identity);
    if (!psk || capacity < Psk::kBytes) {
      self.counters.add(Event::kUnknownKey);
      return 0;  // alert unknown_psk_identity: names are no secret, and a person is told what to mend
    }
    std::copy(psk->bytes.begin(), psk->bytes.end(), out);
    return static_cast<unsigned>(Psk::kBytes);
  }

  // After OpenSSL's own judgement of each certificate, from the authority's down to the peer's.
  static int on_certificate(int good, X509_STORE_CTX* store) {
    SSL* const ssl =
        static_cast<SSL*>(X509_STORE_CTX_get_ex_data(store, SSL_get_ex_data_X509_STORE_CTX_idx()));
    Impl& self = of(ssl);
    if (X509_STORE_CTX_get_error_depth(store) == 0)
      good = self.access.allows_certificate(store, good == 1) ? 1 : 0;
    if (good != 1) self.counters.add(Event::kRefusedCertificate);
    return good;
  }

  // --- keys ----------------------------------------------------------------------------------------------

  /// Ends what the new list no longer allows. An identity with another key or right ends too: it may come
  /// again with what it has now.
  void adopt_keys() noexcept {
    const KeyList* const fresh = fresh_keys.exchange(nullptr, std::memory_order_acq_rel);
    if (fresh == nullptr) return;
    // Handed over again, as at every start: whoever is at it goes on.
    if (name_of(*fresh) == access.list_name()) {
      delete retired_keys.exchange(fresh, std::memory_order_acq_rel);
      return;
    }
    std::unique_ptr<const KeyList> former = access.adopt(std::unique_ptr<const KeyList>(fresh));
    // A resumed session would not show its key again. What was agreed on under this list stays.
    resume_under(context.get(), listener->ssl(), access.list_name());
    config.resumption->forget_others(access.list_name());
    for (std::size_t place = 0; place < peers.size(); ++place) {
      Association& peer = peers[place];
      if (peer.state == State::kFree) continue;
      if (peer.state == State::kHandshaking) {  // it may have been given a key that is no more
        peers.release(place);
        continue;
      }
      if (const auto identity = access.still_allowed(peer.channel->ssl(), peer.identity, *former)) {
        peer.identity = *identity;
        continue;
      }
      counters.add(Event::kRevoked);
      peer.channel->close();
      peers.release(place);
    }
    // The thread that brings lists frees the old one.
    delete retired_keys.exchange(former.release(), std::memory_order_acq_rel);
  }

  // --- handshakes ----------------------------------------------------------------------------------------

  link::TokenBucket& bucket_of(const net::Address& address) noexcept {
    std::array<std::uint64_t, 2> words{};
    std::memcpy(words.data(), address.ip.data(), 16);
    return addresses[link::siphash_words(hash_key, words) % kAddressBuckets];
  }

  /// Ends the handshake that must give way, if one must.
  std::size_t place_for_handshake() noexcept {
    const std::size_t place = peers.place_for_handshake();
    if (place != kNone && peers[place].state == State::kHandshaking) fail(place);
    return place;
  }

  void on_client_hello(std::span<const std::uint8_t> bytes, const net::Address& from) noexcept {
    ClientHelloView hello;
    if (!parse_client_hello(bytes, hello)) return counters.add(Event::kNotDtls);
    if (const std::size_t place = peers.find(from, State::kEstablished);
        place != kNone && peers[place].random == hello.random)
      return counters.add(Event::kForged);  // long done: a late repetition
    const std::size_t under_way = peers.find(from, State::kHandshaking);
    const bool again = under_way != kNone && peers[under_way].random == hello.random;
    if (!strangers.take(now_ns)) return counters.add(Event::kRateLimited);
    if (again) {
      if (hello.has_cookie) advance(under_way, bytes);
      return;
    }
    if (hello.has_cookie && !bucket_of(from).take(now_ns)) return counters.add(Event::kRateLimited);

    speaking = listener.get();
    listener->set_peer(from);
    listener->offer(bytes);
    ERR_clear_error();
    const int result = DTLSv1_listen(listener->ssl(), nothing.get());
    listener->forget();
    if (result != 1) return;  // it was sent a cookie, or made no sense
    std::unique_ptr<DtlsChannel> next = DtlsChannel::make(context.get(), wire, {});
    const std::size_t place = under_way != kNone ? under_way : place_for_handshake();
    if (!next || place == kNone) {
      // The listener has taken this Hello in: what it knows now must not reach the next stranger.
      if (next) listener = std::move(next);
      return counters.add(Event::kFull);
    }
    peers.release(place);
    Association& peer = peers[place];
    peer.state = State::kHandshaking;
    peer.channel = std::move(listener);
    peer.address = from;
    peer.random = hello.random;
    peer.since_ns = now_ns;
    name(place);
    peers.enter(place, from);
    listener = std::move(next);
    advance(place, {});
  }

  /// What the station will show, if it asks.
  void name(std::size_t place) noexcept {
    ConnectionId id{0, static_cast<std::uint16_t>(place), 0};
    if (RAND_bytes(reinterpret_cast<unsigned char*>(&id.random), sizeof id.random) == 1)
      peers[place].channel->give_connection_id(id);
  }

  void fail(std::size_t place) noexcept {
    counters.add(Event::kHandshakesFailed);
    peers.release(place);
  }

  void advance(std::size_t place, std::span<const std::uint8_t> bytes) noexcept {
    Association& peer = peers[place];
    speaking = peer.channel.get();
    peer.channel->offer(bytes);
    switch (peer.channel->handshake()) {
      case DtlsChannel::Step::kWaiting:
        return;
      case DtlsChannel::Step::kFailed:
        return fail(place);
      case DtlsChannel::Step::kDone:
        break;
    }
    const std::optional<PeerIdentity> identity = access.identify_peer(peer.channel->ssl());
    if (!identity) {
      peer.channel->close();
      return fail(place);
    }
    peer.identity = *identity;
    counters.add(Event::kHandshakesDone);
    // More than one, where others have come to this address and gone on without a word.
    for (std::size_t old; (old = peers.find(peer.address, State::kEstablished)) != kNone;) {
      peers[old].channel->retire();
      peers.release(old);
    }
    peer.state = State::kEstablished;
    peer.since_ns = now_ns;
    peer.rate = {config.datagrams_per_peer_s, config.datagrams_per_peer_burst};
  }

  /// A step of a handshake, which the budget allows or not.
  template <class Step>
  void within_budget(bool allowed, Step&& step) noexcept {
    if (!allowed) return counters.add(Event::kRateLimited);
    const std::int64_t begin_ns = work.now_ns();
    step();
    budget.charge(work.now_ns() - begin_ns);
  }

  void tick() noexcept {
    next_tick_ns = now_ns + kTickNs;
    for (std::size_t place = 0; place < peers.size(); ++place) {
      Association& peer = peers[place];
      if (peer.state == State::kHandshaking) {
        speaking = peer.channel.get();
        if (now_ns - peer.since_ns > config.handshake_timeout_ns ||
            peer.channel->on_timer() == DtlsChannel::Step::kFailed) {
          fail(place);
        }
      } else if (peer.state == State::kEstablished && now_ns - peer.since_ns > config.idle_ns) {
        counters.add(Event::kIdle);
        peer.channel->close();
        peers.release(place);
      }
    }
  }

  // --- the exchange --------------------------------------------------------------------------------------

  /// Where its station is, after a datagram of this number that came from there. Only a newer one than all
  /// before says so: those that were overtaken come from where it was, and one that somebody holds back to
  /// send it from elsewhere has been overtaken by then.
  void follow(std::size_t place, std::uint64_t number, std::size_t size, const net::Address& from) noexcept {
    Association& peer = peers[place];
    if (number > peer.newest) {
      peer.newest = number;
      if (!(peer.address == from)) {
        counters.add(Event::kMoved);
        peers.enter(place, from);
        peer.address_check.begin(now_ns);
      }
      peer.address = from;           // which of this machine's addresses it writes to
      peer.channel->set_peer(from);  // may have changed too
    }
    if (peer.address_check.proven() || !(peer.address == from)) return;
    if (const auto question = peer.address_check.heard(size, now_ns)) tell(peer, *question);
  }

  static net::SendStatus tell(Association& peer, std::span<const std::uint8_t> plain) noexcept {
    if (!peer.address_check.may_send(plain.size() + kRecordHeaderBytes + kAesGcmSealBytes))
      return net::SendStatus::kWouldBlock;
    return peer.channel->send(plain);
  }

  /// Opens a datagram that is not part of a handshake in the clear. True if there is something to read.
  bool open(std::size_t place, std::span<const std::uint8_t> bytes, std::span<std::uint8_t> buffer,
            net::Received& received) noexcept {
    Association& peer = peers[place];
    if (!peer.rate.take(now_ns)) {
      counters.add(Event::kRateLimited);
      return false;
    }
    speaking = peer.channel.get();
    switch (peer.channel->open(bytes, buffer, received.size)) {
      case DtlsChannel::Open::kData:
        counters.add(Event::kOpened);
        peer.since_ns = now_ns;
        if (const auto plain = buffer.first(std::min(received.size, buffer.size()));
            peer.channel->connection_id() && AddressCheck::is_answer(plain)) {
          // It shows who hears at the address asked, not where its station is (RFC 9000, 9.1).
          if (!(peer.address == received.from)) return false;
          peer.newest = std::max(peer.newest, record_number(bytes));
          peer.address_check.take_answer(plain);
          return false;
        }
        follow(place, record_number(bytes), bytes.size(), received.from);
        received.from.channel = 0;
        if (peer.channel->connection_id()) {
          received.from = peer.address;
          received.from.channel = peer.channel->connection_id()->number();
        }
        received.standing = {peer.address_check.proven(), peer.identity.rights, peer.identity.number};
        return true;
      case DtlsChannel::Open::kNothing:
        counters.add(Event::kForged);
        return false;
      case DtlsChannel::Open::kClosed:
        counters.add(Event::kClosed);
        peers.release(place);
        return false;
    }
    return false;
  }

  /// A datagram that shows whose it is, wherever it comes from.
  bool on_named(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> buffer,
                net::Received& received) noexcept {
    const auto record = bytes.subspan(std::tuple_size_v<ConnectionPrefix>);
    const RecordKind kind = kind_of(record);
    if (kind != RecordKind::kData && kind != RecordKind::kAlert) {
      counters.add(Event::kNotDtls);
      return false;
    }
    const std::size_t place = peers.find(ConnectionId::read(bytes.subspan(1)));
    if (place != kNone) return open(place, record, buffer, received);
    counters.add(Event::kNoHandshake);
    return false;
  }

  bool on_wire(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> buffer,
               net::Received& received) noexcept {
    if (bytes.size() > std::tuple_size_v<ConnectionPrefix> && bytes[0] == kConnectionMark)
      return on_named(bytes, buffer, received);
    const RecordKind kind = kind_of(bytes);
    if (kind == RecordKind::kNotDtls) {
      counters.add(Event::kNotDtls);
      return false;
    }
    if (kind == RecordKind::kClientHello) {
      within_budget(budget.allows(now_ns), [&] { on_client_hello(bytes, received.from); });
      return false;
    }
    // Data and alerts concern what is established, a handshake's parts the one under way; each the other if
    // there is only that (the last part may come again when all is done, data may overtake it).
    const bool data = kind == RecordKind::kData || kind == RecordKind::kAlert;
    const std::size_t first = peers.find(received.from, data ? State::kEstablished : State::kHandshaking);
    const std::size_t place =
        first != kNone ? first : peers.find(received.from, data ? State::kHandshaking : State::kEstablished);
    if (place == kNone) {
      counters.add(Event::kNoHandshake);
      return false;
    }
    if (peers[place].state == State::kEstablished) return open(place, bytes, buffer, received);
    // Data cannot end a handshake; its last flight, which the data has overtaken, can. So data takes no
    // overdraft.
    within_budget(data ? budget.allows(now_ns) : budget.allows_to_go_on(now_ns),
                  [&] { advance(place, bytes); });
    return false;
  }

  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
    now_ns = clock.now_ns();
    if (fresh_keys.load(std::memory_order_relaxed) != nullptr) adopt_keys();
    if (now_ns >= next_tick_ns) tick();
    for (int i = 0; i < kDatagramsPerReceive; ++i) {
      if (!wire.receive(cipher, received)) return false;
      if (received.size > cipher.size()) {
        counters.add(Event::kOversize);
        continue;
      }
      if (on_wire({cipher.data(), received.size}, buffer, received)) return true;
    }
    return false;
  }

  DtlsServerConfig config;
  DtlsAccess access;
  std::atomic<const KeyList*> fresh_keys{nullptr};
  std::atomic<const KeyList*> retired_keys{nullptr};
  DtlsContext context;
  net::Datagram& wire;
  const rt::Clock& clock;
  const rt::ThreadTime thread_time;
  const rt::Clock& work;  // what handshakes are charged by
  const CookieMaker cookies;
  const link::SipKey hash_key = random_sip_key();  // of addresses
  Associations peers;
  std::vector<link::TokenBucket> addresses;
  link::TokenBucket strangers;
  HandshakeBudget budget;
  std::unique_ptr<DtlsChannel> listener;  // hears strangers; becomes the channel of the one that is taken in
  DtlsChannel* speaking = nullptr;        // whose callbacks run
  struct FreeAddress {
    void operator()(BIO_ADDR* address) const noexcept { BIO_ADDR_free(address); }
  };
  std::unique_ptr<BIO_ADDR, FreeAddress> nothing{BIO_ADDR_new()};  // that DTLSv1_listen wants to fill
  std::int64_t now_ns = 0;
  std::int64_t next_tick_ns = 0;
  std::array<std::uint8_t, kMaxWireBytes> cipher{};
  SecurityCounters counters;
};

DtlsServer::DtlsServer(const DtlsServerConfig& config, KeyList keys, net::Datagram& wire,
                       const rt::Clock& clock, const rt::Clock* work)
    : impl_(std::make_unique<Impl>(config, std::move(keys), wire, clock, work)) {}

DtlsServer::~DtlsServer() = default;

bool DtlsServer::receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept {
  return impl_->receive(buffer, received);
}

net::SendStatus DtlsServer::send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept {
  const std::size_t place = impl_->peers.find(to);
  return place == kNone ? net::SendStatus::kFailed : impl_->tell(impl_->peers[place], bytes);
}

void DtlsServer::flush() noexcept {
  impl_->wire.flush();
}

void DtlsServer::offer_keys(KeyList keys) {
  delete impl_->retired_keys.exchange(nullptr, std::memory_order_acq_rel);
  delete impl_->fresh_keys.exchange(new KeyList(std::move(keys)), std::memory_order_acq_rel);
}

const SecurityCounters& DtlsServer::counters() const noexcept {
  return impl_->counters;
}

std::size_t DtlsServer::established() const noexcept {
  return impl_->peers.count(State::kEstablished);
}

std::size_t DtlsServer::under_way() const noexcept {
  return impl_->peers.count(State::kHandshaking);
}

const char* DtlsServer::identity(const net::Address& address) const noexcept {
  const std::size_t place = impl_->peers.find(address);
  return place == kNone ? "" : impl_->peers[place].identity.name.data();
}

}  // namespace telenano::security

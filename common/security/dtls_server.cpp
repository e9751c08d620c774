#include "telenano/common/security/dtls_server.h"

#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cstring>
#include <new>
#include <string_view>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/link/siphash.h"
#include "telenano/common/link/token_bucket.h"
#include "telenano/common/rt/thread_time.h"
#include "telenano/common/security/dtls_channel.h"
#include "telenano/common/security/dtls_context.h"
#include "telenano/common/security/dtls_record.h"
#include "telenano/common/security/dtls_resumption.h"
#include "telenano/common/security/handshake_budget.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;

constexpr std::size_t kNone = SIZE_MAX;
constexpr std::int64_t kCookieSlotNs = 30'000'000'000;
constexpr std::int64_t kTickNs = 5'000'000;
// What is not for the loop behind must not keep it from its time-outs for long.
constexpr int kDatagramsPerReceive = 64;
constexpr std::size_t kAddressBuckets = 256;
// What may be sent to an address that has not answered yet, of what came from there (RFC 9000, 8).
constexpr std::uint64_t kUnprovenShare = 3;
// A question that is not answered is asked again.
constexpr std::int64_t kQuestionEveryNs = 20'000'000;

using Cookie = std::array<std::uint8_t, 32>;

}  // namespace

struct DtlsServer::Impl {
  enum class State : std::uint8_t { kFree, kHandshaking, kEstablished };

  struct Peer {
    State state = State::kFree;
    std::unique_ptr<DtlsChannel> channel;
    net::Address address;
    std::array<std::uint8_t, 32> random{};  // of its ClientHello
    std::array<char, 65> identity{};
    net::Rights rights = net::Rights::kObserve;
    std::uint64_t number = 0;   // of its identity: net::Standing::identity
    std::int64_t since_ns = 0;  // begin of the handshake, or last datagram opened
    std::uint64_t newest = 0;   // record_number() of those opened
    // Since it came to an address that it has not answered from: bytes each way, and what it is asked.
    bool proven = true;
    std::uint64_t heard_bytes = 0;
    std::uint64_t told_bytes = 0;
    std::int64_t asked_ns = 0;
    bool can_ask = false;
    std::array<std::uint8_t, 8> question{};
    link::TokenBucket rate{1, 1};
  };

  Impl(const DtlsServerConfig& c, KeyList k, net::Datagram& w, const rt::Clock& time,
       const rt::Clock* work_time)
      : config(c),
        keys(std::make_unique<const KeyList>(std::move(k))),
        list_name(name_of(*keys)),
        context(make_context(true, true, c.certificates, c.identity)),
        wire(w),
        clock(time),
        work(work_time != nullptr ? *work_time : thread_time),
        tags(c.capacity),
        buckets(std::bit_ceil(2 * c.capacity), kNone),
        next_of_bucket(c.capacity, kNone),
        peers(c.capacity),
        addresses(kAddressBuckets, {c.handshakes_per_address_s, c.handshakes_per_address_burst}),
        strangers(c.cookies_per_s, std::max(1.0, c.cookies_per_s / 10)),
        budget(c.handshake_share, c.handshake_burst_ns) {
    if (RAND_bytes(secret.data(), static_cast<int>(secret.size())) != 1 ||
        RAND_bytes(reinterpret_cast<unsigned char*>(&tag_key), sizeof tag_key) != 1) {
      throw RunError("no random numbers: " + openssl_reason());
    }
    SSL_CTX* const ssl = context.get();
    SSL_CTX_set_app_data(ssl, this);
    SSL_CTX_set_psk_server_callback(ssl, &Impl::on_psk);
    SSL_CTX_set_cookie_generate_cb(ssl, &Impl::on_cookie_wanted);
    SSL_CTX_set_cookie_verify_cb(ssl, &Impl::on_cookie);
    SSL_CTX_set_verify(ssl, SSL_CTX_get_verify_mode(ssl), &Impl::on_certificate);
    // A station that roams resumes what it had agreed on, which saves a round trip.
    if (!config.unix_time_s) {
      config.unix_time_s = [] {
        const auto now = std::chrono::system_clock::now().time_since_epoch();
        return std::chrono::floor<std::chrono::seconds>(now).count();
      };
    }
    if (!config.resumption) config.resumption = std::make_shared<ResumptionCache>(4 * c.capacity);
    if (config.connection_ids) offer_connection_ids(ssl, true);
    resume_by(ssl, *config.resumption);
    resume_under(ssl, nullptr, list_name);
    listener = DtlsChannel::make(ssl, wire, {});
    if (!listener || !nothing) throw RunError("DTLS cannot be set up: " + openssl_reason());
  }

  ~Impl() {
    for (Peer& peer : peers) {
      if (peer.state == State::kEstablished) peer.channel->close();
    }
    delete fresh_keys.load();
    delete retired_keys.load();
  }

  static Impl& of(SSL* ssl) noexcept {
    return *static_cast<Impl*>(SSL_CTX_get_app_data(SSL_get_SSL_CTX(ssl)));
  }

  // --- strangers -----------------------------------------------------------------------------------------

  /// HMAC-SHA-256 under a secret of this start, over address, port and time slot: nothing is kept for whom it
  /// was made. False if OpenSSL has no memory.
  bool make_cookie(const net::Address& address, std::int64_t slot, Cookie& cookie) const noexcept {
    std::array<std::uint8_t, 26> text{};
    std::copy(address.ip.begin(), address.ip.end(), text.begin());
    text[16] = static_cast<std::uint8_t>(address.port & 0xff);
    text[17] = static_cast<std::uint8_t>(address.port >> 8);
    std::memcpy(text.data() + 18, &slot, sizeof slot);
    unsigned size = 0;
    return HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()), text.data(), text.size(),
                cookie.data(), &size) != nullptr &&
           size == cookie.size();
  }

  static int on_cookie_wanted(SSL* ssl, unsigned char* out, unsigned* size) {
    Impl& self = of(ssl);
    Cookie cookie;
    if (!self.make_cookie(self.speaking->peer(), self.now_ns / kCookieSlotNs, cookie)) return 0;
    std::copy(cookie.begin(), cookie.end(), out);
    *size = static_cast<unsigned>(cookie.size());
    self.counters.add(Event::kCookies);
    return 1;
  }

  // The present slot and the last; compared in constant time, so that a guess is not told how much of it
  // fits.
  static int on_cookie(SSL* ssl, const unsigned char* shown, unsigned size) {
    Impl& self = of(ssl);
    Cookie cookie;
    if (size != cookie.size()) return 0;
    const std::int64_t slot = self.now_ns / kCookieSlotNs;
    bool fits = false;
    for (const std::int64_t s : {slot, slot - 1}) {
      fits |= self.make_cookie(self.speaking->peer(), s, cookie) &&
              CRYPTO_memcmp(cookie.data(), shown, size) == 0;
    }
    return fits ? 1 : 0;
  }

  // --- keys ----------------------------------------------------------------------------------------------

  static unsigned on_psk(SSL* ssl, const char* identity, unsigned char* out, unsigned capacity) {
    Impl& self = of(ssl);
    const std::optional<Grant> grant =
        identity != nullptr ? self.grant_of(*self.keys, identity) : std::nullopt;
    // A token that has expired begins nothing; what it has begun may go on, and be resumed.
    const bool over = grant && grant->expires_s && *grant->expires_s <= self.config.unix_time_s();
    if (!grant || over || capacity < Psk::kBytes) {
      self.counters.add(Event::kUnknownKey);
      return 0;  // alert unknown_psk_identity: names are no secret, and a person is told what to mend
    }
    std::copy(grant->psk.bytes.begin(), grant->psk.bytes.end(), out);
    return static_cast<unsigned>(Psk::kBytes);
  }

  static std::optional<Grant> grant_of(const KeyList& list, std::string_view identity) noexcept {
    try {
      return list.find_grant(identity);
    } catch (...) {  // no memory, or no hash
      return std::nullopt;
    }
  }

  // After OpenSSL's own judgement of each certificate, from the authority's down to the peer's.
  static int on_certificate(int good, X509_STORE_CTX* store) {
    SSL* const ssl =
        static_cast<SSL*>(X509_STORE_CTX_get_ex_data(store, SSL_get_ex_data_X509_STORE_CTX_idx()));
    Impl& self = of(ssl);
    if (X509_STORE_CTX_get_error_depth(store) == 0) {
      CertificateIdentity identity;
      const bool known = identify(X509_STORE_CTX_get_current_cert(store), identity);
      // Known by its key, whoever has signed it and whenever; that the peer has the key, the handshake proves.
      if (known && self.keys->find_public_key(identity.public_key.data()) != nullptr) {
        X509_STORE_CTX_set_error(store, X509_V_OK);
        return 1;
      }
      if (!known || !self.config.certificates ||
          (good == 1 &&
           self.keys->find_certificate(identity.name.data(), identity.fingerprint.data()) == nullptr)) {
        X509_STORE_CTX_set_error(store, X509_V_ERR_CERT_REJECTED);
        good = 0;
      }
    }
    if (good != 1) self.counters.add(Event::kRefusedCertificate);
    return good;
  }

  /// Who is at the other end, by the list as it is now: also for a resumed association, whose key may have
  /// been revoked in between.
  bool find_identity(Peer& peer) noexcept {
    SSL* const ssl = peer.channel->ssl();
    peer.identity = {};
    if (X509* const certificate = SSL_get0_peer_certificate(ssl)) {
      CertificateIdentity identity;
      if (!identify(certificate, identity)) return false;
      if (const PublicKeyEntry* const known = keys->find_public_key(identity.public_key.data())) {
        std::copy_n(known->identity.begin(), std::min(known->identity.size(), peer.identity.size() - 1),
                    peer.identity.begin());
        peer.rights = known->rights;
        peer.number = identity_number('p', known->identity);
        return true;
      }
      if (!config.certificates) return false;
      const CertificateEntry* const entry =
          keys->find_certificate(identity.name.data(), identity.fingerprint.data());
      if (entry == nullptr) return false;
      peer.identity = entry->name.empty() ? identity.fingerprint : identity.name;
      peer.rights = entry->rights;
      peer.number = identity_number('c', peer.identity.data());
      return true;
    }
    const char* const name = SSL_get_psk_identity(ssl);
    const std::string_view shown = name != nullptr ? name : "";
    const std::optional<Grant> grant = grant_of(*keys, shown);
    if (!grant) return false;
    std::copy_n(shown.begin(), std::min(shown.size(), peer.identity.size() - 1), peer.identity.begin());
    peer.rights = grant->rights;
    peer.number = grant->number;
    if (grant->expires_s && config.grant_names) note_name(*grant);
    return true;
  }

  void note_name(const Grant& grant) const noexcept {
    try {
      config.grant_names->note(grant.number, grant.name);
    } catch (...) {  // no memory: the number is said instead
    }
  }

  /// Ends what the new list no longer allows. An identity with another key or right ends too: it may come
  /// again with what it has now.
  void adopt_keys() noexcept {
    const KeyList* const fresh = fresh_keys.exchange(nullptr, std::memory_order_acq_rel);
    if (fresh == nullptr) return;
    const ListName name = name_of(*fresh);
    if (name == list_name) {  // handed over again, as at every start: whoever is at it goes on
      delete retired_keys.exchange(fresh, std::memory_order_acq_rel);
      return;
    }
    std::unique_ptr<const KeyList> old = std::move(keys);
    keys.reset(fresh);
    list_name = name;
    // A resumed session would not show its key again. What another worker has agreed on under the new list
    // stays: not all adopt it at the same moment.
    resume_under(context.get(), listener->ssl(), list_name);
    config.resumption->forget_others(list_name);
    for (std::size_t slot = 0; slot < peers.size(); ++slot) {
      Peer& peer = peers[slot];
      if (peer.state == State::kFree) continue;
      if (peer.state == State::kHandshaking) {  // it may have been given a key that is no more
        release(slot);
        continue;
      }
      const net::Rights rights = peer.rights;
      const bool by_name = SSL_get0_peer_certificate(peer.channel->ssl()) == nullptr;
      const std::optional<Grant> before = by_name ? grant_of(*old, peer.identity.data()) : std::nullopt;
      const std::optional<Grant> after = grant_of(*keys, peer.identity.data());
      const bool same_key = !before || (after && equal(before->psk, after->psk));
      if (find_identity(peer) && same_key && peer.rights == rights) continue;
      counters.add(Event::kRevoked);
      peer.channel->close();
      release(slot);
    }
    // The thread that brings lists frees the old one.
    delete retired_keys.exchange(old.release(), std::memory_order_acq_rel);
  }

  // --- the table -----------------------------------------------------------------------------------------

  std::uint64_t tag_of(const net::Address& address) const noexcept {
    std::array<std::uint64_t, 3> words{};
    std::memcpy(words.data(), address.ip.data(), 16);
    words[2] = address.port;
    return std::max<std::uint64_t>(link::siphash_words(tag_key, words), 1);  // 0: free
  }

  std::size_t find(const net::Address& address, State state) const noexcept {
    if (last < peers.size() && peers[last].state == state && peers[last].address == address) return last;
    const std::uint64_t tag = tag_of(address);
    for (std::size_t slot = first_of(tag); slot != kNone; slot = next_of_bucket[slot]) {
      if (tags[slot] == tag && peers[slot].state == state && peers[slot].address == address) {
        last = slot;
        return slot;
      }
    }
    return kNone;
  }

  /// The association of this name.
  std::size_t find(const ConnectionId& id) const noexcept {
    if (id.worker != config.worker || id.slot >= peers.size()) return kNone;
    const Peer& peer = peers[id.slot];
    return peer.state == State::kEstablished && peer.channel->connection_id() == id ? id.slot : kNone;
  }

  /// The association to which an answer to this address belongs.
  std::size_t find(const net::Address& to) const noexcept {
    return to.channel != 0 ? find(ConnectionId::of(to.channel)) : find(to, State::kEstablished);
  }

  std::size_t count(State state) const noexcept {
    return static_cast<std::size_t>(
        std::count_if(peers.begin(), peers.end(), [&](const Peer& peer) { return peer.state == state; }));
  }

  void release(std::size_t slot) noexcept {
    peers[slot] = {};
    leave(slot);
  }

  void leave(std::size_t slot) noexcept {
    if (tags[slot] == 0) return;
    std::size_t* link = &first_of(tags[slot]);
    while (*link != slot) link = &next_of_bucket[*link];
    *link = next_of_bucket[slot];
    tags[slot] = 0;
  }

  void enter(std::size_t slot, const net::Address& address) noexcept {  // a slot that has left
    tags[slot] = tag_of(address);
    std::size_t& first = first_of(tags[slot]);
    next_of_bucket[slot] = first;
    first = slot;
  }

  std::size_t& first_of(std::uint64_t tag) noexcept { return buckets[tag & (buckets.size() - 1)]; }
  std::size_t first_of(std::uint64_t tag) const noexcept { return buckets[tag & (buckets.size() - 1)]; }

  /// A slot for a handshake. Those under way share a quarter of the room, and the oldest of them gives way: a
  /// crowd that never finishes neither takes the room of sessions nor keeps others out for long.
  std::size_t free_slot() noexcept {
    const std::size_t handshakes_max = std::max<std::size_t>(peers.size() / 4, 1);
    std::size_t under_way = 0, oldest = kNone, free = kNone;
    for (std::size_t slot = 0; slot < peers.size(); ++slot) {
      if (peers[slot].state == State::kFree && free == kNone) free = slot;
      if (peers[slot].state != State::kHandshaking) continue;
      ++under_way;
      if (oldest == kNone || peers[slot].since_ns < peers[oldest].since_ns) oldest = slot;
    }
    if (under_way < handshakes_max && free != kNone) return free;
    if (oldest == kNone) return kNone;
    counters.add(Event::kHandshakesFailed);
    release(oldest);
    return oldest;
  }

  // --- handshakes ----------------------------------------------------------------------------------------

  link::TokenBucket& bucket_of(const net::Address& address) noexcept {
    std::array<std::uint64_t, 2> words{};
    std::memcpy(words.data(), address.ip.data(), 16);
    return addresses[link::siphash_words(tag_key, words) % kAddressBuckets];
  }

  void on_client_hello(std::span<const std::uint8_t> bytes, const net::Address& from) noexcept {
    ClientHelloView hello;
    if (!parse_client_hello(bytes, hello)) return counters.add(Event::kNotDtls);
    if (const std::size_t slot = find(from, State::kEstablished);
        slot != kNone && peers[slot].random == hello.random)
      return counters.add(Event::kForged);  // long done: a late repetition
    const std::size_t under_way = find(from, State::kHandshaking);
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
    const std::size_t slot = under_way != kNone ? under_way : free_slot();
    if (!next || slot == kNone) {
      // The listener has taken this Hello in: what it knows now must not reach the next stranger.
      if (next) listener = std::move(next);
      return counters.add(Event::kFull);
    }
    release(slot);
    Peer& peer = peers[slot];
    peer.state = State::kHandshaking;
    peer.channel = std::move(listener);
    peer.address = from;
    peer.random = hello.random;
    peer.since_ns = now_ns;
    name(slot);
    enter(slot, from);
    listener = std::move(next);
    advance(slot, {});
  }

  /// What the station will show, if it asks.
  void name(std::size_t slot) noexcept {
    ConnectionId id{config.worker, static_cast<std::uint16_t>(slot), 0};
    if (RAND_bytes(reinterpret_cast<unsigned char*>(&id.random), sizeof id.random) == 1)
      peers[slot].channel->give_connection_id(id);
  }

  void fail(std::size_t slot) noexcept {
    counters.add(Event::kHandshakesFailed);
    release(slot);
  }

  void advance(std::size_t slot, std::span<const std::uint8_t> bytes) noexcept {
    Peer& peer = peers[slot];
    speaking = peer.channel.get();
    peer.channel->offer(bytes);
    switch (peer.channel->handshake()) {
      case DtlsChannel::Step::kWaiting:
        return;
      case DtlsChannel::Step::kFailed:
        return fail(slot);
      case DtlsChannel::Step::kDone:
        break;
    }
    if (!find_identity(peer)) {
      peer.channel->close();
      return fail(slot);
    }
    counters.add(Event::kHandshakesDone);
    // More than one, where others have come to this address and gone on without a word.
    for (std::size_t old; (old = find(peer.address, State::kEstablished)) != kNone;) {
      peers[old].channel->retire();
      release(old);
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
    for (std::size_t slot = 0; slot < peers.size(); ++slot) {
      Peer& peer = peers[slot];
      if (peer.state == State::kHandshaking) {
        speaking = peer.channel.get();
        if (now_ns - peer.since_ns > config.handshake_timeout_ns ||
            peer.channel->on_timer() == DtlsChannel::Step::kFailed) {
          fail(slot);
        }
      } else if (peer.state == State::kEstablished && now_ns - peer.since_ns > config.idle_ns) {
        counters.add(Event::kIdle);
        peer.channel->close();
        release(slot);
      }
    }
  }

  // --- the exchange --------------------------------------------------------------------------------------

  /// Where its station is, after a datagram of this number that came from there. Only a newer one than all
  /// before says so: those that were overtaken come from where it was, and one that somebody holds back to
  /// send it from elsewhere has been overtaken by then.
  void follow(std::size_t slot, std::uint64_t number, std::size_t size, const net::Address& from) noexcept {
    Peer& peer = peers[slot];
    if (number > peer.newest) {
      peer.newest = number;
      if (!(peer.address == from)) {
        counters.add(Event::kMoved);
        leave(slot);
        enter(slot, from);
        peer.proven = false;
        peer.heard_bytes = peer.told_bytes = 0;
        peer.asked_ns = now_ns - kQuestionEveryNs;
        // Without a random number nobody is asked, and the station is sent less.
        peer.can_ask = RAND_bytes(peer.question.data(), static_cast<int>(peer.question.size())) == 1;
      }
      peer.address = from;           // which of this machine's addresses it writes to
      peer.channel->set_peer(from);  // may have changed too
    }
    if (peer.proven || !(peer.address == from)) return;
    peer.heard_bytes += size;
    if (!peer.can_ask || now_ns - peer.asked_ns < kQuestionEveryNs) return;
    peer.asked_ns = now_ns;
    AddressProof proof;
    std::copy(kAddressQuestion.begin(), kAddressQuestion.end(), proof.begin());
    std::copy(peer.question.begin(), peer.question.end(), proof.begin() + kAddressQuestion.size());
    tell(peer, proof);
  }

  /// Is this an answer to follow()'s question, and not for the loop behind? If it shows, from where the
  /// station is now, that it hears what is sent there, it is sent all.
  static bool take_answer(Peer& peer, const net::Address& from,
                          std::span<const std::uint8_t> plain) noexcept {
    if (plain.size() != std::tuple_size_v<AddressProof> ||
        !std::equal(kAddressAnswer.begin(), kAddressAnswer.end(), plain.begin()))
      return false;
    const auto shown = plain.subspan(kAddressAnswer.size());
    if (!peer.proven && peer.can_ask && peer.address == from &&
        CRYPTO_memcmp(shown.data(), peer.question.data(), shown.size()) == 0)
      peer.proven = true;
    return true;
  }

  net::SendStatus tell(Peer& peer, std::span<const std::uint8_t> plain) noexcept {
    if (!peer.proven) {
      const std::uint64_t bytes = plain.size() + kRecordHeaderBytes + kAesGcmSealBytes;
      if (peer.told_bytes + bytes > kUnprovenShare * peer.heard_bytes) return net::SendStatus::kWouldBlock;
      peer.told_bytes += bytes;
    }
    return peer.channel->send(plain);
  }

  /// Opens a datagram that is not part of a handshake in the clear. True if there is something to read.
  bool open(std::size_t slot, std::span<const std::uint8_t> bytes, std::span<std::uint8_t> buffer,
            net::Received& received) noexcept {
    Peer& peer = peers[slot];
    if (!peer.rate.take(now_ns)) {
      counters.add(Event::kRateLimited);
      return false;
    }
    speaking = peer.channel.get();
    switch (peer.channel->open(bytes, buffer, received.size)) {
      case DtlsChannel::Open::kData:
        counters.add(Event::kOpened);
        peer.since_ns = now_ns;
        follow(slot, record_number(bytes), bytes.size(), received.from);
        received.from.channel = 0;
        if (peer.channel->connection_id()) {
          if (take_answer(peer, received.from, buffer.first(std::min(received.size, buffer.size()))))
            return false;
          received.from = peer.address;
          received.from.channel = peer.channel->connection_id()->number();
        }
        received.standing = {peer.proven, peer.rights, peer.number};
        return true;
      case DtlsChannel::Open::kNothing:
        counters.add(Event::kForged);
        return false;
      case DtlsChannel::Open::kClosed:
        counters.add(Event::kClosed);
        release(slot);
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
    const std::size_t slot = find(ConnectionId::read(bytes.subspan(1)));
    if (slot != kNone) return open(slot, record, buffer, received);
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
    const std::size_t first = find(received.from, data ? State::kEstablished : State::kHandshaking);
    const std::size_t slot =
        first != kNone ? first : find(received.from, data ? State::kHandshaking : State::kEstablished);
    if (slot == kNone) {
      counters.add(Event::kNoHandshake);
      return false;
    }
    if (peers[slot].state == State::kEstablished) return open(slot, bytes, buffer, received);
    // Data cannot end a handshake; its last flight, which the data has overtaken, can. So data takes no
    // overdraft.
    within_budget(data ? budget.allows(now_ns) : budget.allows_to_go_on(now_ns),
                  [&] { advance(slot, bytes); });
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
  std::unique_ptr<const KeyList> keys;
  ListName list_name;
  std::atomic<const KeyList*> fresh_keys{nullptr};
  std::atomic<const KeyList*> retired_keys{nullptr};
  DtlsContext context;
  net::Datagram& wire;
  const rt::Clock& clock;
  const rt::ThreadTime thread_time;
  const rt::Clock& work;  // what handshakes are charged by
  std::array<std::uint8_t, 32> secret{};
  link::SipKey tag_key;
  // Found by the tag of its address: those with the same low bits are a chain through next_of_bucket.
  std::vector<std::uint64_t> tags;
  std::vector<std::size_t> buckets;
  std::vector<std::size_t> next_of_bucket;
  std::vector<Peer> peers;
  mutable std::size_t last = 0;  // found: mostly the next one's too
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
  const std::size_t slot = impl_->find(to);
  return slot == kNone ? net::SendStatus::kFailed : impl_->tell(impl_->peers[slot], bytes);
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
  return impl_->count(Impl::State::kEstablished);
}

std::size_t DtlsServer::under_way() const noexcept {
  return impl_->count(Impl::State::kHandshaking);
}

const char* DtlsServer::identity(const net::Address& address) const noexcept {
  const std::size_t slot = impl_->find(address);
  return slot == kNone ? "" : impl_->peers[slot].identity.data();
}

}  // namespace telenano::security

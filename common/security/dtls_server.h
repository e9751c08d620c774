#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/common/security/certificate_files.h"
#include "telenano/common/security/key_list.h"
#include "telenano/common/security/resumption_cache.h"
#include "telenano/common/security/security_counters.h"

namespace telenano::security {

struct DtlsServerConfig {
  std::optional<CertificateFiles> certificates;  ///< left out: pre-shared keys only
  std::string
      identity;  ///< file of the server's own key pair (identity_file.h); used without certificates; "": none
  std::size_t capacity = 128;  ///< associations at once, those under way included; 1 … 16384
  bool connection_ids = true;  ///< know a station that comes to another address by the id that it was given
  std::int64_t handshake_timeout_ns = 5'000'000'000;
  /// An association that nobody uses is forgotten. Longer than a session can be resumed, so that a station
  /// that comes back need not make a new one.
  std::int64_t idle_ns = 120'000'000'000;
  /// Of several that serve one port: a peer that comes back resumes with whichever it meets. Left out: its
  /// own.
  std::shared_ptr<ResumptionCache> resumption;
  double handshake_share = 0.1;                 ///< of the loop's time, in the long run
  std::int64_t handshake_burst_ns = 2'000'000;  ///< and at once
  double cookies_per_s = 20000;                 ///< answers to strangers, all together
  double handshakes_per_address_s = 4;          ///< begun, for one IP address
  double handshakes_per_address_burst = 16;
  double datagrams_per_peer_s = 20000;  ///< sealed ones; a station sends 8000 at most
  double datagrams_per_peer_burst = 5000;
};

/// The server's secure end: a Datagram that opens what comes from the wire and seals what goes out, so that
/// the loop behind it sees only plain datagrams of peers whose key is in the list, with their rights.
///
/// - A stranger costs a cookie (HMAC-SHA-256 of its address under a secret made at each start) and keeps no
///   state; the answer is smaller than the question.
/// - Handshakes run inside receive(), one step at a time, within a share of the loop's time.
/// - A valid datagram of an established association is opened, and one is sealed, without allocating. Forged
///   and repeated ones are counted.
/// - A peer that comes again from the same address makes a second association, which takes the first one's
///   place only when it is complete: nobody can end a session by a false ClientHello.
/// - An association goes with its station to another address, with its next datagram that is newer than all
///   before and shows a connection id. Until the station has answered from there, it is sent no more than
///   three times what came from there: a station that writes under a false address is no amplifier.
///
/// One thread, except offer_keys() and counters(). Nothing throws after construction.
class DtlsServer final : public net::Datagram {
 public:
  /// `wire` and the clocks must outlive it. `work` measures what handshakes take of this thread; left out:
  /// its processor time. Throws UserError for certificates that do not serve.
  DtlsServer(const DtlsServerConfig& config, KeyList keys, net::Datagram& wire, const rt::Clock& clock,
             const rt::Clock* work = nullptr);
  ~DtlsServer() override;  ///< tells every peer
  DtlsServer(const DtlsServer&) = delete;
  DtlsServer& operator=(const DtlsServer&) = delete;

  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override;
  void flush() noexcept override;

  /// From another thread: the list from now on. Associations whose key or right is no longer the same end
  /// with the loop's next datagram or idle look.
  void offer_keys(KeyList keys);

  const SecurityCounters& counters() const noexcept;
  std::size_t established() const noexcept;  ///< associations
  std::size_t under_way() const noexcept;    ///< handshakes
  /// Identity of the peer at an address ("" if none): a key's or public key's identity, a certificate's common
  /// name or its fingerprint.
  const char* identity(const net::Address& address) const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::security

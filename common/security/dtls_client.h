#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "telenano/common/net/datagram.h"
#include "telenano/common/rt/clock.h"
#include "telenano/common/security/certificate_files.h"
#include "telenano/common/security/key_list.h"

namespace telenano::security {

struct DtlsClientConfig {
  std::optional<StationKey> key;                 ///< either this
  std::optional<CertificateFiles> certificates;  ///< or these,
  std::string identity;  ///< or this file of the station's own key pair (identity_file.h), with
  std::vector<std::string>
      server_keys;          ///< the servers' public keys, 64 digits each, of which one must be shown
  std::string server_name;  ///< host or address that the server's certificate must name
  /// Nothing from the server for so long while something is sent: the association may be gone, or this
  /// machine's address another one. A new one is made beside it. A little more than the session's own
  /// patience (200 ms), and once more after every failed attempt.
  std::int64_t silence_ns = 250'000'000;
  std::int64_t handshake_timeout_ns = 3'000'000'000;
  std::int64_t retry_ns = 500'000'000;  ///< between a failed attempt and the next
  /// Ask the server to know this station wherever it is (connection_id.h).
  bool connection_id = true;
};

/// The station's secure end: a Datagram to one server that seals what is sent and opens what comes.
///
/// Its handshakes run inside receive(), which must be called regularly (each tick). While there is no
/// association, what is sent is lost, as on any network, but for the newest Hello, which goes out with the
/// end of the handshake. When this machine's address changes, what is sent is still known for this
/// association's by its connection id. When the server falls silent, a new handshake goes on beside the old
/// association and takes its place when it is complete; keys that were agreed on before are resumed, which
/// saves a round trip. Sending and receiving over an established association
/// allocate nothing; a handshake does, and takes 0.3 ms with a pre-shared key, 1 ms with certificates.
///
/// One thread. Nothing throws after construction.
class DtlsClient final : public net::Datagram {
 public:
  /// `wire` and `clock` must outlive it. Throws UserError for certificates that do not serve.
  DtlsClient(const DtlsClientConfig& config, net::Datagram& wire, const net::Address& server,
             const rt::Clock& clock);
  ~DtlsClient() override;  ///< tells the server
  DtlsClient(const DtlsClient&) = delete;
  DtlsClient& operator=(const DtlsClient&) = delete;

  net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override;
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override;

  bool established() const noexcept;
  /// Has an attempt ended because one side refuses the other? Trying again will hardly help.
  bool refused() const noexcept;
  /// Why there is no association: one line for a person, with what to do. Allocates.
  std::string failure() const;

  struct Counters {
    std::uint64_t opened = 0;
    std::uint64_t forged = 0;      ///< seal does not fit, repeated or too old, from others, or not DTLS
    std::uint64_t handshakes = 0;  ///< completed
    std::uint64_t resumed = 0;     ///< of those, with keys agreed on before
    std::uint64_t proofs = 0;      ///< times that the server has asked whether this is our address
  };
  const Counters& counters() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::security

#pragma once

// Only for the files of this folder.

#include <openssl/ssl.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>

#include "telenano/common/net/datagram.h"
#include "telenano/common/security/dtls_resumption.h"
#include "telenano/common/security/key_list.h"

namespace telenano::security {

/// Who is at the other end of an association, and what it may do.
struct PeerIdentity {
  std::array<char, 65> name{};
  net::Rights rights = net::Rights::kObserve;
  std::uint64_t number = 0;  ///< net::Standing::identity
};

/// Who may come in, by the list of keys in force: the answers to OpenSSL's questions during a handshake, and the
/// identity of whoever has completed one. Nothing throws after construction.
class DtlsAccess {
 public:
  /// `certificates`: also those that an authority has signed.
  DtlsAccess(bool certificates, KeyList keys);

  const ListName& list_name() const noexcept { return list_name_; }
  /// The list from now on; returns the former one.
  std::unique_ptr<const KeyList> adopt(std::unique_ptr<const KeyList> keys) noexcept;

  /// The secret behind a name that was shown in a handshake. None: unknown.
  std::optional<Psk> psk_of(const char* shown) const noexcept;
  /// The peer's own certificate, after OpenSSL's judgement of it. Sets the store's error; false: refused.
  bool allows_certificate(X509_STORE_CTX* store, bool good) const noexcept;

  /// Who is at the other end, by the list as it is now: also for a resumed association, whose key may have
  /// been revoked in between. None: nobody of the list.
  std::optional<PeerIdentity> identify_peer(SSL* ssl) const noexcept;
  /// As identify_peer(), for one that came in under `former`: none also if it has another key or right now.
  std::optional<PeerIdentity> still_allowed(SSL* ssl, const PeerIdentity& peer,
                                            const KeyList& former) const noexcept;

 private:
  std::optional<PeerIdentity> identify_by_certificate(X509* certificate) const noexcept;
  std::optional<PeerIdentity> identify_by_psk(std::string_view shown) const noexcept;

  bool certificates_;
  std::unique_ptr<const KeyList> keys_;
  ListName list_name_;
};

}  // namespace telenano::security

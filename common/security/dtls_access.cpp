#include "telenano/common/security/dtls_access.h"

#include <openssl/ssl.h>

#include <algorithm>
#include <utility>

#include "telenano/common/security/dtls_context.h"

namespace telenano::security {
namespace {

void copy_name(std::string_view from, std::array<char, 65>& to) noexcept {
  std::copy_n(from.begin(), std::min(from.size(), to.size() - 1), to.begin());
}

}  // namespace

DtlsAccess::DtlsAccess(bool certificates, KeyList keys)
    : certificates_(certificates),
      keys_(std::make_unique<const KeyList>(std::move(keys))),
      list_name_(name_of(*keys_)) {}

std::unique_ptr<const KeyList> DtlsAccess::adopt(std::unique_ptr<const KeyList> keys) noexcept {
  list_name_ = name_of(*keys);
  return std::exchange(keys_, std::move(keys));
}

std::optional<Psk> DtlsAccess::psk_of(const char* shown) const noexcept {
  if (shown == nullptr) return std::nullopt;
  const KeyEntry* const key = keys_->find_key(shown);
  return key != nullptr ? std::optional(key->psk) : std::nullopt;
}

bool DtlsAccess::allows_certificate(X509_STORE_CTX* store, bool good) const noexcept {
  CertificateIdentity identity;
  const bool known = identify(X509_STORE_CTX_get_current_cert(store), identity);
  // Known by its key, whoever has signed it and whenever; that the peer has the key, the handshake proves.
  if (known && keys_->find_public_key(identity.public_key.data()) != nullptr) {
    X509_STORE_CTX_set_error(store, X509_V_OK);
    return true;
  }
  if (!known || !certificates_ ||
      (good && keys_->find_certificate(identity.name.data(), identity.fingerprint.data()) == nullptr)) {
    X509_STORE_CTX_set_error(store, X509_V_ERR_CERT_REJECTED);
    return false;
  }
  return good;
}

std::optional<PeerIdentity> DtlsAccess::identify_by_certificate(X509* certificate) const noexcept {
  CertificateIdentity shown;
  if (!identify(certificate, shown)) return std::nullopt;
  PeerIdentity peer;
  if (const PublicKeyEntry* const known = keys_->find_public_key(shown.public_key.data())) {
    copy_name(known->identity, peer.name);
    peer.rights = known->rights;
    peer.number = identity_number('p', known->identity);
    return peer;
  }
  if (!certificates_) return std::nullopt;
  const CertificateEntry* const entry = keys_->find_certificate(shown.name.data(), shown.fingerprint.data());
  if (entry == nullptr) return std::nullopt;
  peer.name = entry->name.empty() ? shown.fingerprint : shown.name;
  peer.rights = entry->rights;
  peer.number = identity_number('c', peer.name.data());
  return peer;
}

std::optional<PeerIdentity> DtlsAccess::identify_by_psk(std::string_view shown) const noexcept {
  const KeyEntry* const key = keys_->find_key(shown);
  if (key == nullptr) return std::nullopt;
  PeerIdentity peer;
  copy_name(shown, peer.name);
  peer.rights = key->rights;
  peer.number = identity_number('k', shown);
  return peer;
}

std::optional<PeerIdentity> DtlsAccess::identify_peer(SSL* ssl) const noexcept {
  if (X509* const certificate = SSL_get0_peer_certificate(ssl)) return identify_by_certificate(certificate);
  const char* const name = SSL_get_psk_identity(ssl);
  return identify_by_psk(name != nullptr ? name : "");
}

std::optional<PeerIdentity> DtlsAccess::still_allowed(SSL* ssl, const PeerIdentity& peer,
                                                      const KeyList& former) const noexcept {
  const bool by_name = SSL_get0_peer_certificate(ssl) == nullptr;
  const KeyEntry* const before = by_name ? former.find_key(peer.name.data()) : nullptr;
  const KeyEntry* const after = keys_->find_key(peer.name.data());
  const bool same_key = before == nullptr || (after != nullptr && equal(before->psk, after->psk));
  const std::optional<PeerIdentity> now = identify_peer(ssl);
  return same_key && now && now->rights == peer.rights ? now : std::nullopt;
}

}  // namespace telenano::security

#pragma once

// Only for the files of this folder.

#include <openssl/ssl.h>

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "telenano/common/security/certificate_files.h"

namespace telenano::security {

struct FreeContext {
  void operator()(SSL_CTX* context) const noexcept { SSL_CTX_free(context); }
};
using DtlsContext = std::unique_ptr<SSL_CTX, FreeContext>;

/// DTLS 1.2 only, AES-128-GCM only, no renegotiation, no compression; the peer's certificate is asked for and
/// verified. Throws UserError if a file is wrong, does not fit the others, or if the certificate is expired.
/// `identity`: a file as create_identity() writes it, used where there is no certificate of an authority's; "":
/// none. Whom the other end's key then belongs to is for the caller's own look at it.
DtlsContext make_context(bool server, bool use_psk, const std::optional<CertificateFiles>& files,
                         const std::string& identity = "");

/// Throws UserError for a file that holds none.
void use_identity(SSL_CTX* context, const std::string& path, const std::string& what);

/// Common name and SHA-256 of the peer's certificate, and SHA-256 of its public key; false if it has none or it cannot be read.
struct CertificateIdentity {
  static constexpr std::size_t kNameBytes = 64;
  std::array<char, kNameBytes + 1> name{};  ///< empty if longer or absent
  std::array<char, 65> fingerprint{};
  std::array<char, 65> public_key{};
};
bool identify(X509* certificate, CertificateIdentity& identity) noexcept;

/// What OpenSSL has put on this thread's error queue, its first entry, for a person.
std::string openssl_reason();

}  // namespace telenano::security

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
DtlsContext make_context(bool server, bool use_psk, const std::optional<CertificateFiles>& files);

/// Common name and SHA-256 of the peer's verified certificate; false if it has none or it cannot be read.
struct CertificateIdentity {
  static constexpr std::size_t kNameBytes = 64;
  std::array<char, kNameBytes + 1> name{};  ///< empty if longer or absent
  std::array<char, 65> fingerprint{};
};
bool identify(X509* certificate, CertificateIdentity& identity) noexcept;

/// What OpenSSL has put on this thread's error queue, its first entry, for a person.
std::string openssl_reason();

}  // namespace telenano::security

#include "telenano/common/security/dtls_context.h"

#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <string_view>

#include "telenano/common/base/error.h"
#include "telenano/common/security/private_file.h"

namespace telenano::security {
namespace {

// With forward secrecy: what was recorded stays secret when a key is lost later. Of OpenSSL 3.0's suites with
// pre-shared keys and a curve, one has a cipher that seals and opens in a single pass. Stations of before
// know only the one without.
constexpr const char* kPskSuites = "ECDHE-PSK-CHACHA20-POLY1305:PSK-AES128-GCM-SHA256";
// AES-GCM for its speed on every x86-64.
constexpr const char* kCertificateSuites = "ECDHE-ECDSA-AES128-GCM-SHA256:ECDHE-RSA-AES128-GCM-SHA256";

[[noreturn]] void fail(const std::string& flag, const std::string& path, const std::string& why) {
  throw UserError(flag + " " + path + ": " + why);
}

std::string time_text(const ASN1_TIME* time) {
  BIO* const memory = BIO_new(BIO_s_mem());
  ASN1_TIME_print(memory, time);
  char* text = nullptr;
  const long size = BIO_get_mem_data(memory, &text);
  std::string result(text, static_cast<std::size_t>(std::max(size, 0L)));
  BIO_free(memory);
  return result;
}

void load_certificates(SSL_CTX* context, const CertificateFiles& files) {
  ERR_clear_error();
  if (SSL_CTX_use_certificate_chain_file(context, files.certificate.c_str()) != 1)
    fail("--cert", files.certificate, "no certificate in PEM form (" + openssl_reason() + ")");
  const X509* const own = SSL_CTX_get0_certificate(context);
  if (X509_cmp_current_time(X509_get0_notAfter(own)) < 0) {
    fail("--cert", files.certificate,
         "has expired on " + time_text(X509_get0_notAfter(own)) + "; renew it, or set this machine's clock");
  }
  if (X509_cmp_current_time(X509_get0_notBefore(own)) > 0) {
    fail("--cert", files.certificate,
         "is valid only from " + time_text(X509_get0_notBefore(own)) + "; wait, or set this machine's clock");
  }
  require_private_file(files.key, "--cert-key");
  // Never ask at the terminal for a passphrase: a server starts without one.
  SSL_CTX_set_default_passwd_cb(context, [](char*, int, int, void*) { return 0; });
  if (SSL_CTX_use_PrivateKey_file(context, files.key.c_str(), SSL_FILETYPE_PEM) != 1) {
    fail("--cert-key", files.key,
         "no private key in PEM form without a passphrase that fits " + files.certificate + " (" +
             openssl_reason() + ")");
  }
  if (SSL_CTX_load_verify_file(context, files.authority.c_str()) != 1)
    fail("--ca", files.authority, "no certificates in PEM form (" + openssl_reason() + ")");
}

}  // namespace

std::string openssl_reason() {
  const unsigned long code = ERR_peek_error();
  const char* const text = ERR_reason_error_string(code);
  return text != nullptr ? text : "reason unknown";
}

DtlsContext make_context(bool server, bool use_psk, const std::optional<CertificateFiles>& files,
                         const std::string& identity) {
  DtlsContext context(SSL_CTX_new(server ? DTLS_server_method() : DTLS_client_method()));
  if (!context) throw RunError("DTLS cannot be set up: " + openssl_reason());
  SSL_CTX* const c = context.get();
  SSL_CTX_set_min_proto_version(c, DTLS1_2_VERSION);
  // Tickets would put the station's certificate into its next ClientHello, which must fit one datagram; the
  // server keeps a bounded cache of sessions instead.
  SSL_CTX_set_options(c, SSL_OP_NO_TICKET | SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION |
                             SSL_OP_NO_QUERY_MTU | SSL_OP_CIPHER_SERVER_PREFERENCE);
  std::string suites;
  if (use_psk) suites = kPskSuites;
  if (files || !identity.empty()) suites += (suites.empty() ? "" : ":") + std::string(kCertificateSuites);
  if (SSL_CTX_set_cipher_list(c, suites.c_str()) != 1)
    throw RunError("DTLS cannot be set up: this OpenSSL has none of " + suites);
  if (files) {
    load_certificates(c, *files);
    if (server) {
      SSL_CTX_set_client_CA_list(c, SSL_load_client_CA_file(files->authority.c_str()));
    }
  }
  if (!files && !identity.empty()) use_identity(c, identity, server ? "--keys" : "--identity");
  // A suite of pre-shared keys sends no certificates; every other one must have the peer's.
  SSL_CTX_set_verify(c, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, nullptr);
  return context;
}

bool identify(X509* certificate, CertificateIdentity& identity) noexcept {
  if (certificate == nullptr) return false;
  identity = {};
  // Room for one letter more than is allowed. A name that is longer, or has a zero inside, is none.
  std::array<char, CertificateIdentity::kNameBytes + 2> name{};
  const int length = X509_NAME_get_text_by_NID(X509_get_subject_name(certificate), NID_commonName,
                                               name.data(), static_cast<int>(name.size()));
  const std::size_t size_of_name = std::string_view(name.data()).size();
  if (length >= 0 && static_cast<std::size_t>(length) == size_of_name &&
      size_of_name <= CertificateIdentity::kNameBytes)
    std::copy_n(name.begin(), size_of_name, identity.name.begin());
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  const auto write = [&](std::array<char, 65>& to) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    for (std::size_t i = 0; i < 32; ++i) {
      to[2 * i] = kDigits[digest[i] / 16];
      to[2 * i + 1] = kDigits[digest[i] % 16];
    }
  };
  if (X509_digest(certificate, EVP_sha256(), digest.data(), &size) != 1 || size != 32) return false;
  write(identity.fingerprint);
  unsigned char* key = nullptr;
  const int key_size = i2d_X509_PUBKEY(X509_get_X509_PUBKEY(certificate), &key);
  const bool good = key_size > 0 && EVP_Digest(key, static_cast<std::size_t>(key_size), digest.data(), &size,
                                               EVP_sha256(), nullptr) == 1;
  OPENSSL_free(key);
  if (!good || size != 32) return false;
  write(identity.public_key);
  return true;
}

}  // namespace telenano::security

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509.h>

#include <memory>

#include "telenano/common/base/error.h"
#include "telenano/common/security/dtls_context.h"
#include "telenano/common/security/identity_file.h"
#include "telenano/common/security/private_file.h"

namespace telenano::security {
namespace {

struct FreeBio {
  void operator()(BIO* bio) const noexcept { BIO_free_all(bio); }
};
struct FreeKey {
  void operator()(EVP_PKEY* key) const noexcept { EVP_PKEY_free(key); }
};
struct FreeCertificate {
  void operator()(X509* certificate) const noexcept { X509_free(certificate); }
};
using Bio = std::unique_ptr<BIO, FreeBio>;
using Key = std::unique_ptr<EVP_PKEY, FreeKey>;
using Certificate = std::unique_ptr<X509, FreeCertificate>;

/// Signed by itself. What it says is not looked at; its times are such that no program finds it too old or new.
Certificate certificate_of(EVP_PKEY* key) {
  Certificate made(X509_new());
  X509* const c = made.get();
  std::uint64_t serial = 0;
  const std::string name = "telenano";
  const bool good =
      c != nullptr && RAND_bytes(reinterpret_cast<unsigned char*>(&serial), sizeof serial) == 1 &&
      X509_set_version(c, 2) == 1 && ASN1_INTEGER_set_uint64(X509_get_serialNumber(c), serial >> 1) == 1 &&
      ASN1_TIME_set_string_X509(X509_getm_notBefore(c), "20000101000000Z") == 1 &&
      ASN1_TIME_set_string_X509(X509_getm_notAfter(c), "99991231235959Z") == 1 &&
      X509_set_pubkey(c, key) == 1 &&
      X509_NAME_add_entry_by_txt(X509_get_subject_name(c), "CN", MBSTRING_ASC,
                                 reinterpret_cast<const unsigned char*>(name.data()),
                                 static_cast<int>(name.size()), -1, 0) == 1 &&
      X509_set_issuer_name(c, X509_get_subject_name(c)) == 1 && X509_sign(c, key, EVP_sha256()) > 0;
  if (!good) throw RunError("an identity cannot be made: " + openssl_reason());
  return made;
}

std::string name_of(X509* certificate) {
  CertificateIdentity identity;
  if (!identify(certificate, identity)) throw RunError("a public key cannot be named: " + openssl_reason());
  return std::string("sha256:") + identity.public_key.data();
}

int no_passphrase(char*, int, int, void*) {
  return 0;  // never ask at the terminal
}

struct Pair {
  Key key;
  Certificate certificate;
};

Pair read_pair(const std::string& path, const std::string& what) {
  std::string text = read_private_file(path, what);
  const Bio memory(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  Pair pair;
  if (memory) {
    pair.key.reset(PEM_read_bio_PrivateKey(memory.get(), nullptr, &no_passphrase, nullptr));
    pair.certificate.reset(PEM_read_bio_X509(memory.get(), nullptr, &no_passphrase, nullptr));
  }
  OPENSSL_cleanse(text.data(), text.size());
  if (!pair.key || !pair.certificate || X509_check_private_key(pair.certificate.get(), pair.key.get()) != 1)
    throw UserError(what + " " + path +
                    ": holds no identity; telenano-master enroll (for a station) and telenano-nve "
                    "keys identity (for a server) make one");
  return pair;
}

}  // namespace

std::string create_identity(const std::string& path, const std::string& what) {
  const Key key(EVP_EC_gen("P-256"));
  if (!key) throw RunError("an identity cannot be made: " + openssl_reason());
  const Certificate certificate = certificate_of(key.get());
  const Bio memory(BIO_new(BIO_s_mem()));
  if (!memory ||
      PEM_write_bio_PrivateKey(memory.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1 ||
      PEM_write_bio_X509(memory.get(), certificate.get()) != 1)
    throw RunError("an identity cannot be made: " + openssl_reason());
  char* text = nullptr;
  const long size = BIO_get_mem_data(memory.get(), &text);
  const std::string name = name_of(certificate.get());
  std::string content = "# The identity " + name + ". It stays on the machine that has made it.\n";
  content.append(text, static_cast<std::size_t>(size));
  OPENSSL_cleanse(text, static_cast<std::size_t>(size));
  create_private_file(path, content, what);
  OPENSSL_cleanse(content.data(), content.size());
  return name;
}

std::string read_identity_name(const std::string& path, const std::string& what) {
  return name_of(read_pair(path, what).certificate.get());
}

void use_identity(SSL_CTX* context, const std::string& path, const std::string& what) {
  const Pair pair = read_pair(path, what);
  if (SSL_CTX_use_certificate(context, pair.certificate.get()) != 1 ||
      SSL_CTX_use_PrivateKey(context, pair.key.get()) != 1)
    throw RunError("DTLS cannot be set up with " + path + ": " + openssl_reason());
}

}  // namespace telenano::security

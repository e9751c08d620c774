#include "telenano/common/hash/sha256.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include "telenano/common/base/error.h"

namespace telenano {

Sha256 sha256(std::string_view bytes) {
  Sha256 hash{};
  unsigned int size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), hash.data(), &size, EVP_sha256(), nullptr) != 1 ||
      size != hash.size())
    throw RunError("OpenSSL has no SHA-256");
  return hash;
}

Sha256 hmac_sha256(const std::array<std::uint8_t, 32>& key, std::string_view text) {
  Sha256 hash{};
  unsigned int size = 0;
  if (HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()),
           reinterpret_cast<const unsigned char*>(text.data()), text.size(), hash.data(), &size) == nullptr ||
      size != hash.size())
    throw RunError("OpenSSL has no HMAC with SHA-256");
  return hash;
}

bool has_sha256() noexcept {
  return true;
}

}  // namespace telenano

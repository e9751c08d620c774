#include "telenano/common/hash/sha256.h"

#include <openssl/evp.h>

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

bool has_sha256() noexcept {
  return true;
}

}  // namespace telenano

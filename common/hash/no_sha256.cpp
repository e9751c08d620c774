#include "telenano/common/base/error.h"
#include "telenano/common/hash/sha256.h"

namespace telenano {

Sha256 sha256(std::string_view) {
  throw RunError("this build has no OpenSSL, and so no SHA-256");
}

Sha256 hmac_sha256(const std::array<std::uint8_t, 32>&, std::string_view) {
  throw RunError("this build has no OpenSSL, and so no SHA-256");
}

bool has_sha256() noexcept {
  return false;
}

}  // namespace telenano

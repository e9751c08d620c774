#include "telenano/common/security/dtls_cookie.h"

#include <openssl/crypto.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>

#include <algorithm>
#include <cstring>

#include "telenano/common/base/error.h"
#include "telenano/common/security/dtls_context.h"

namespace telenano::security {
namespace {

constexpr std::int64_t kSlotNs = 30'000'000'000;

}  // namespace

CookieMaker::CookieMaker() {
  if (RAND_bytes(secret_.data(), static_cast<int>(secret_.size())) != 1)
    throw RunError("no random numbers: " + openssl_reason());
}

std::optional<CookieMaker::Cookie> CookieMaker::of_slot(const net::Address& address,
                                                        std::int64_t slot) const noexcept {
  std::array<std::uint8_t, 26> text{};
  std::copy(address.ip.begin(), address.ip.end(), text.begin());
  text[16] = static_cast<std::uint8_t>(address.port & 0xff);
  text[17] = static_cast<std::uint8_t>(address.port >> 8);
  std::memcpy(text.data() + 18, &slot, sizeof slot);
  Cookie cookie;
  unsigned size = 0;
  const bool made = HMAC(EVP_sha256(), secret_.data(), static_cast<int>(secret_.size()), text.data(),
                         text.size(), cookie.data(), &size) != nullptr &&
                    size == cookie.size();
  return made ? std::optional(cookie) : std::nullopt;
}

std::optional<CookieMaker::Cookie> CookieMaker::make(const net::Address& address,
                                                     std::int64_t now_ns) const noexcept {
  return of_slot(address, now_ns / kSlotNs);
}

bool CookieMaker::fits(std::span<const std::uint8_t> shown, const net::Address& address,
                       std::int64_t now_ns) const noexcept {
  if (shown.size() != std::tuple_size_v<Cookie>) return false;
  const std::int64_t present = now_ns / kSlotNs;
  bool fits = false;
  for (const std::int64_t slot : {present, present - 1}) {
    const std::optional<Cookie> cookie = of_slot(address, slot);
    fits |= cookie && CRYPTO_memcmp(cookie->data(), shown.data(), shown.size()) == 0;
  }
  return fits;
}

}  // namespace telenano::security

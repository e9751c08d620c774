#include "telenano/common/hash/sha256.h"

namespace telenano {

std::string hex(const Sha256& hash) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : hash) text.append({kDigits[byte >> 4], kDigits[byte & 15]});
  return text;
}

std::uint64_t short_name(const Sha256& hash) noexcept {
  std::uint64_t name = 0;
  for (int i = 7; i >= 0; --i) name = name << 8 | hash[static_cast<std::size_t>(i)];
  return name;
}

}  // namespace telenano

#include "telenano/common/security/dtls_address_check.h"

#include <openssl/crypto.h>
#include <openssl/rand.h>

#include <algorithm>

namespace telenano::security {
namespace {

// What may be sent to an address that has not answered yet, of what came from there.
constexpr std::uint64_t kUnprovenShare = 3;
// A question that is not answered is asked again.
constexpr std::int64_t kQuestionEveryNs = 20'000'000;

}  // namespace

void AddressCheck::begin(std::int64_t now_ns) noexcept {
  proven_ = false;
  heard_bytes_ = told_bytes_ = 0;
  asked_ns_ = now_ns - kQuestionEveryNs;
  can_ask_ = RAND_bytes(question_.data(), static_cast<int>(question_.size())) == 1;
}

std::optional<AddressProof> AddressCheck::heard(std::uint64_t bytes, std::int64_t now_ns) noexcept {
  heard_bytes_ += bytes;
  if (!can_ask_ || now_ns - asked_ns_ < kQuestionEveryNs) return std::nullopt;
  asked_ns_ = now_ns;
  AddressProof proof;
  std::copy(kAddressQuestion.begin(), kAddressQuestion.end(), proof.begin());
  std::copy(question_.begin(), question_.end(), proof.begin() + kAddressQuestion.size());
  return proof;
}

bool AddressCheck::may_send(std::uint64_t bytes) noexcept {
  if (proven_) return true;
  if (told_bytes_ + bytes > kUnprovenShare * heard_bytes_) return false;
  told_bytes_ += bytes;
  return true;
}

bool AddressCheck::is_answer(std::span<const std::uint8_t> plain) noexcept {
  return plain.size() == std::tuple_size_v<AddressProof> &&
         std::equal(kAddressAnswer.begin(), kAddressAnswer.end(), plain.begin());
}

void AddressCheck::take_answer(std::span<const std::uint8_t> plain) noexcept {
  const auto shown = plain.subspan(kAddressAnswer.size());
  if (!proven_ && can_ask_ && CRYPTO_memcmp(shown.data(), question_.data(), shown.size()) == 0)
    proven_ = true;
}

}  // namespace telenano::security

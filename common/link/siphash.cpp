#include "telenano/common/link/siphash.h"

#include <bit>
#include <cstddef>

namespace telenano::link {
namespace {

class Sip {
 public:
  explicit Sip(const SipKey& key) noexcept
      : v0_(key.k0 ^ 0x736f6d6570736575ull),
        v1_(key.k1 ^ 0x646f72616e646f6dull),
        v2_(key.k0 ^ 0x6c7967656e657261ull),
        v3_(key.k1 ^ 0x7465646279746573ull) {}

  void word(std::uint64_t m) noexcept {
    v3_ ^= m;
    round();
    round();
    v0_ ^= m;
  }

  std::uint64_t finish() noexcept {
    v2_ ^= 0xff;
    for (int i = 0; i < 4; ++i) round();
    return v0_ ^ v1_ ^ v2_ ^ v3_;
  }

 private:
  void round() noexcept {
    v0_ += v1_;
    v1_ = std::rotl(v1_, 13) ^ v0_;
    v0_ = std::rotl(v0_, 32);
    v2_ += v3_;
    v3_ = std::rotl(v3_, 16) ^ v2_;
    v0_ += v3_;
    v3_ = std::rotl(v3_, 21) ^ v0_;
    v2_ += v1_;
    v1_ = std::rotl(v1_, 17) ^ v2_;
    v2_ = std::rotl(v2_, 32);
  }

  std::uint64_t v0_, v1_, v2_, v3_;
};

}  // namespace

std::uint64_t siphash(const SipKey& key, std::span<const std::uint8_t> bytes) noexcept {
  Sip sip(key);
  std::size_t at = 0;
  for (; at + 8 <= bytes.size(); at += 8) {
    std::uint64_t m = 0;
    for (std::size_t i = 0; i < 8; ++i) m |= static_cast<std::uint64_t>(bytes[at + i]) << (8 * i);
    sip.word(m);
  }
  std::uint64_t last = static_cast<std::uint64_t>(bytes.size() & 0xff) << 56;
  for (std::size_t i = 0; at + i < bytes.size(); ++i)
    last |= static_cast<std::uint64_t>(bytes[at + i]) << (8 * i);
  sip.word(last);
  return sip.finish();
}

std::uint64_t siphash_words(const SipKey& key, std::span<const std::uint64_t> words) noexcept {
  Sip sip(key);
  for (const std::uint64_t m : words) sip.word(m);
  sip.word(static_cast<std::uint64_t>((words.size() * 8) & 0xff) << 56);
  return sip.finish();
}

}  // namespace telenano::link

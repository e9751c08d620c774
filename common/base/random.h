#pragma once

#include <cmath>
#include <cstdint>

#include "telenano/common/base/det_math.h"

namespace telenano {

/// Seeded randomness that gives the same numbers everywhere (the standard's distributions do not).
/// xoshiro256++ 1.0 (Blackman & Vigna 2019, public domain), seeded by splitmix64. Not for secrets.
class Random {
 public:
  explicit Random(std::uint64_t seed) noexcept {
    for (auto& word : state_) word = splitmix64(seed);
  }

  std::uint64_t bits() noexcept {
    const std::uint64_t result = rotl(state_[0] + state_[3], 23) + state_[0];
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = rotl(state_[3], 45);
    return result;
  }

  double uniform() noexcept { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }  ///< [0, 1)
  double uniform(double low, double high) noexcept { return low + (high - low) * uniform(); }
  /// 0 … n-1 for n >= 1; the bias is below n/2^64.
  std::uint64_t below(std::uint64_t n) noexcept {
    __extension__ using Wide = unsigned __int128;
    return static_cast<std::uint64_t>((static_cast<Wide>(bits()) * n) >> 64);
  }
  bool chance(double probability) noexcept { return uniform() < probability; }

  /// Mean 1.
  double exponential() noexcept { return -det_log(1.0 - uniform()); }

  /// Mean 0, standard deviation 1 (Marsaglia's polar method).
  double normal() noexcept {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    double u = 0;
    double v = 0;
    double s = 0;
    do {
      u = uniform(-1, 1);
      v = uniform(-1, 1);
      s = u * u + v * v;
    } while (s >= 1 || s == 0);
    const double factor = std::sqrt(-2.0 * det_log(s) / s);
    spare_ = v * factor;
    has_spare_ = true;
    return u * factor;
  }

  /// The next number of the splitmix64 sequence; also good for turning one seed into many.
  static std::uint64_t splitmix64(std::uint64_t& state) noexcept {
    state += 0x9e3779b97f4a7c15ull;
    std::uint64_t z = state;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
  }

 private:
  static std::uint64_t rotl(std::uint64_t x, int k) noexcept { return (x << k) | (x >> (64 - k)); }

  std::uint64_t state_[4];
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace telenano

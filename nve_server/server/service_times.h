#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace telenano::server {

/// How long commands were worked on, from the look at the clock when their datagram had been fetched, perhaps
/// with others, to the one before the answer is encoded. Buckets as a monitor wants them: 1, 2, 5 to the
/// decade.
class ServiceTimes {
 public:
  static constexpr std::array<std::int64_t, 15> kUpperNs = {
      500,     1'000,   2'000,     5'000,     10'000,    20'000,     50'000,     100'000,
      200'000, 500'000, 1'000'000, 2'000'000, 5'000'000, 10'000'000, 100'000'000};

  void add(std::int64_t service_ns) noexcept {
    std::size_t bucket = 0;
    while (bucket < kUpperNs.size() && service_ns > kUpperNs[bucket]) ++bucket;
    ++counts[bucket];
    sum_ns += service_ns;
  }

  void add(const ServiceTimes& more) noexcept {
    for (std::size_t i = 0; i < counts.size(); ++i) counts[i] += more.counts[i];
    sum_ns += more.sum_ns;
  }

  std::array<std::uint64_t, kUpperNs.size() + 1> counts{};  ///< the last: above all bounds
  std::int64_t sum_ns = 0;
};

}  // namespace telenano::server

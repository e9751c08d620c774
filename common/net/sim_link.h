#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "telenano/common/net/datagram.h"
#include "telenano/common/net/impairment.h"

namespace telenano::net {

/// One direction of a simulated link, and what it counts.
using SimPath = ImpairmentConfig;
using SimCounts = ImpairmentCounts;

/// Two ends of a link in virtual time: whole sessions run through it as fast as the machine can, with the
/// same Datagram seam as UDP. One thread. `capacity` datagrams (of at most 512 bytes, as the protocol's) may
/// be on the way in each direction; nothing is allocated after construction.
class SimLink {
 public:
  SimLink(const SimPath& a_to_b, const SimPath& b_to_a, std::uint64_t seed, std::size_t capacity = 4096);
  ~SimLink();
  SimLink(const SimLink&) = delete;
  SimLink& operator=(const SimLink&) = delete;

  void advance_to(std::int64_t now_ns) noexcept;  ///< never goes back
  std::int64_t now_ns() const noexcept;
  /// Earliest arrival of anything on the way; INT64_MAX if there is nothing.
  std::int64_t next_arrival_ns() const noexcept;

  Datagram& a() noexcept;
  Datagram& b() noexcept;
  Address address_a() const noexcept;
  Address address_b() const noexcept;
  void set_address_a(const Address& address) noexcept;  ///< a roams: what b sees from now on
  SimPath& path_a_to_b() noexcept;                      ///< may be changed while running
  SimPath& path_b_to_a() noexcept;
  const SimCounts& counts_a_to_b() const noexcept;
  const SimCounts& counts_b_to_a() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::net

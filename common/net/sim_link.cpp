#include "telenano/common/net/sim_link.h"

#include <algorithm>
#include <cstring>

#include "telenano/common/base/random.h"
#include "telenano/common/net/delay_line.h"

namespace telenano::net {
namespace {

constexpr std::size_t kSlotBytes = 512;  // as the protocol's longest datagram

/// One direction: what becomes of a datagram, and where it is until it arrives.
class Path {
 public:
  Path(const SimPath& path, std::uint64_t seed, std::size_t capacity)
      : impairment(path, seed), line_(capacity, kSlotBytes) {}

  void send(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept {
    const Fate fate = impairment.send(bytes.size(), now_ns, line_.room());
    for (std::size_t i = 0; i < fate.n; ++i) line_.put(bytes, fate.copies[i]);
  }

  bool receive(std::span<std::uint8_t> buffer, Received& received, std::int64_t now_ns) noexcept {
    if (line_.next_arrival_ns() > now_ns || line_.empty()) return false;
    const DelayLine::Item item = line_.front();
    received.age_ns = now_ns - item.arrival_ns;
    received.size = item.size;
    const std::size_t n = std::min(item.bytes.size(), buffer.size());
    if (n > 0) std::memcpy(buffer.data(), item.bytes.data(), n);
    line_.pop();
    ++impairment.counts.delivered;
    return true;
  }

  std::int64_t next_arrival_ns() const noexcept { return line_.next_arrival_ns(); }

  Impairment impairment;

 private:
  DelayLine line_;
};

Address simulated(std::uint8_t host, std::uint16_t port) {
  Address address;  // 192.0.2.0/24 is for documentation: never a real peer
  address.ip = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 192, 0, 2, host};
  address.port = port;
  return address;
}

/// One end: sends into one path, receives from the other. Whatever it is told, the only peer is the other
/// end.
class End final : public Datagram {
 public:
  End(Path& out, Path& in, const Address& peer, const std::int64_t& now_ns)
      : out_(out), in_(in), peer_(peer), now_ns_(now_ns) {}

  SendStatus send(std::span<const std::uint8_t> bytes, const Address&) noexcept override {
    out_.send(bytes, now_ns_);
    return SendStatus::kSent;
  }
  bool receive(std::span<std::uint8_t> buffer, Received& received) noexcept override {
    if (!in_.receive(buffer, received, now_ns_)) return false;
    received.from = peer_;
    return true;
  }

 private:
  Path& out_;
  Path& in_;
  const Address& peer_;
  const std::int64_t& now_ns_;
};

std::uint64_t sub_seed(std::uint64_t seed, std::uint64_t which) {
  std::uint64_t state = seed ^ (which * 0x9e3779b97f4a7c15ull);
  return Random::splitmix64(state);
}

}  // namespace

struct SimLink::Impl {
  Impl(const SimPath& a_to_b, const SimPath& b_to_a, std::uint64_t seed, std::size_t capacity)
      : ab(a_to_b, sub_seed(seed, 1), capacity),
        ba(b_to_a, sub_seed(seed, 2), capacity),
        a(ab, ba, address_b, now_ns),
        b(ba, ab, address_a, now_ns) {}

  std::int64_t now_ns = 0;
  Address address_a = simulated(1, 40000);
  Address address_b = simulated(2, 5100);
  Path ab;
  Path ba;
  End a;
  End b;
};

SimLink::SimLink(const SimPath& a_to_b, const SimPath& b_to_a, std::uint64_t seed, std::size_t capacity)
    : impl_(std::make_unique<Impl>(a_to_b, b_to_a, seed, capacity)) {}
SimLink::~SimLink() = default;

void SimLink::advance_to(std::int64_t now_ns) noexcept {
  impl_->now_ns = std::max(impl_->now_ns, now_ns);
}
std::int64_t SimLink::now_ns() const noexcept {
  return impl_->now_ns;
}
std::int64_t SimLink::next_arrival_ns() const noexcept {
  return std::min(impl_->ab.next_arrival_ns(), impl_->ba.next_arrival_ns());
}
Datagram& SimLink::a() noexcept {
  return impl_->a;
}
Datagram& SimLink::b() noexcept {
  return impl_->b;
}
Address SimLink::address_a() const noexcept {
  return impl_->address_a;
}
Address SimLink::address_b() const noexcept {
  return impl_->address_b;
}
void SimLink::set_address_a(const Address& address) noexcept {
  impl_->address_a = address;
}
SimPath& SimLink::path_a_to_b() noexcept {
  return impl_->ab.impairment.config;
}
SimPath& SimLink::path_b_to_a() noexcept {
  return impl_->ba.impairment.config;
}
const SimCounts& SimLink::counts_a_to_b() const noexcept {
  return impl_->ab.impairment.counts;
}
const SimCounts& SimLink::counts_b_to_a() const noexcept {
  return impl_->ba.impairment.counts;
}

}  // namespace telenano::net

#include "common/net/sim_link.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "common/base/random.h"

namespace telenano::net {
namespace {

constexpr std::size_t kSlotBytes = 512;

struct Slot {
  std::size_t size = 0;  ///< as sent; only the first 512 bytes are kept
  std::array<std::uint8_t, kSlotBytes> bytes;
};

/// One direction: datagrams in slots, and a heap of who arrives when. Equal times keep the order of sending.
class Path {
 public:
  Path(const SimPath& path, std::uint64_t seed, std::size_t capacity)
      : config(path), random_(seed), slots_(capacity) {
    free_.reserve(capacity);
    for (std::size_t i = capacity; i-- > 0;) free_.push_back(i);
    heap_.reserve(capacity);
  }

  void send(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept {
    ++counts.sent;
    if (lost()) {
      ++counts.lost;
      return;
    }
    put(bytes, now_ns);
    if (config.duplicate > 0 && random_.chance(config.duplicate)) {
      ++counts.duplicated;
      put(bytes, now_ns);
    }
  }

  bool receive(std::span<std::uint8_t> buffer, Received& received, std::int64_t now_ns) noexcept {
    if (heap_.empty() || heap_.front().arrival_ns > now_ns) return false;
    const std::size_t index = heap_.front().slot;
    received.age_ns = now_ns - heap_.front().arrival_ns;
    std::pop_heap(heap_.begin(), heap_.end(), later);
    heap_.pop_back();
    const Slot& slot = slots_[index];
    received.size = slot.size;
    std::memcpy(buffer.data(), slot.bytes.data(), std::min({slot.size, kSlotBytes, buffer.size()}));
    free_.push_back(index);
    ++counts.delivered;
    return true;
  }

  std::int64_t next_arrival_ns() const noexcept {
    return heap_.empty() ? INT64_MAX : heap_.front().arrival_ns;
  }

  SimPath config;
  SimCounts counts;

 private:
  struct Arrival {
    std::int64_t arrival_ns;
    std::uint64_t order;
    std::size_t slot;
  };
  static bool later(const Arrival& a, const Arrival& b) noexcept {
    return a.arrival_ns != b.arrival_ns ? a.arrival_ns > b.arrival_ns : a.order > b.order;
  }

  bool lost() noexcept {
    if (config.down) return true;
    if (config.loss <= 0) return false;
    if (config.burst_datagrams <= 1) return random_.chance(config.loss);
    // Gilbert–Elliott with loss 1 in the bad state: mean stay there = burst, share of time there = loss.
    const double leave = 1.0 / config.burst_datagrams;
    const double enter = config.loss >= 1 ? 1.0 : leave * config.loss / (1.0 - config.loss);
    bad_ = bad_ ? !(config.loss < 1 && random_.chance(leave)) : random_.chance(enter);
    return bad_;
  }

  std::int64_t jitter_ns() noexcept {
    if (config.jitter_ns <= 0) return 0;
    const auto scale = static_cast<double>(config.jitter_ns);
    switch (config.jitter) {
      case SimPath::Jitter::kUniform:
        return static_cast<std::int64_t>(scale * random_.uniform());
      case SimPath::Jitter::kHalfNormal:
        return static_cast<std::int64_t>(scale * std::fabs(random_.normal()));
      case SimPath::Jitter::kExponential:
        return static_cast<std::int64_t>(scale * random_.exponential());
    }
    return 0;
  }

  void put(std::span<const std::uint8_t> bytes, std::int64_t now_ns) noexcept {
    if (free_.empty()) {
      ++counts.lost;
      return;
    }
    std::int64_t arrival_ns = now_ns + config.delay_ns + jitter_ns();
    if (config.reorder > 0 && random_.chance(config.reorder)) {
      ++counts.reordered;
      arrival_ns += config.reorder_ns;
    } else if (config.in_order) {
      arrival_ns = last_in_order_ns_ = std::max(arrival_ns, last_in_order_ns_);
    }
    const std::size_t index = free_.back();
    free_.pop_back();
    Slot& slot = slots_[index];
    slot.size = bytes.size();
    std::memcpy(slot.bytes.data(), bytes.data(), std::min(bytes.size(), kSlotBytes));
    heap_.push_back({arrival_ns, order_++, index});
    std::push_heap(heap_.begin(), heap_.end(), later);
  }

  Random random_;
  std::vector<Slot> slots_;
  std::vector<std::size_t> free_;
  std::vector<Arrival> heap_;
  std::uint64_t order_ = 0;
  std::int64_t last_in_order_ns_ = INT64_MIN;
  bool bad_ = false;
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
  return impl_->ab.config;
}
SimPath& SimLink::path_b_to_a() noexcept {
  return impl_->ba.config;
}
const SimCounts& SimLink::counts_a_to_b() const noexcept {
  return impl_->ab.counts;
}
const SimCounts& SimLink::counts_b_to_a() const noexcept {
  return impl_->ba.counts;
}

}  // namespace telenano::net

#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/common/net/datagram.h"

namespace telenano::security {

/// A network in memory: ends with addresses, and what is on the way between them. Loses, repeats and holds
/// back datagrams by a seeded chance; lets a test listen, change and forge.
class DatagramNet {
 public:
  struct Packet {
    net::Address from, to;
    std::vector<std::uint8_t> bytes;
  };

  class End final : public net::Datagram {
   public:
    End(DatagramNet& network, const net::Address& address) : net_(network), address_(address) {}
    net::SendStatus send(std::span<const std::uint8_t> bytes, const net::Address& to) noexcept override {
      net_.carry({address_, to, {bytes.begin(), bytes.end()}});
      return net::SendStatus::kSent;
    }
    bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override {
      auto& waiting = net_.waiting_[key(address_)];
      if (waiting.empty()) return false;
      const Packet packet = waiting.front();
      waiting.pop_front();
      received = {};
      received.size = packet.bytes.size();
      received.from = packet.from;
      std::copy_n(packet.bytes.begin(), std::min(packet.bytes.size(), buffer.size()), buffer.begin());
      return true;
    }
    const net::Address& address() const { return address_; }
    void set_address(const net::Address& address) { address_ = address; }

   private:
    DatagramNet& net_;
    net::Address address_;
  };

  explicit DatagramNet(std::uint64_t seed = 1) : random_(seed) {}

  static net::Address address(std::uint8_t host, std::uint16_t port) {
    net::Address a;
    a.ip = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 10, 0, 0, host};
    a.port = port;
    return a;
  }

  void carry(Packet packet) {
    sent_.push_back(packet);
    if (cut || random_.uniform() < loss) return;
    if (random_.uniform() < duplicate) deliver(packet);
    if (random_.uniform() < hold_back) {
      held_.push_back(std::move(packet));
      return;
    }
    deliver(std::move(packet));
    while (!held_.empty()) {
      deliver(std::move(held_.front()));
      held_.pop_front();
    }
  }
  void deliver(Packet packet) { waiting_[key(packet.to)].push_back(std::move(packet)); }
  void drop_waiting(const net::Address& to) { waiting_[key(to)].clear(); }
  std::deque<Packet>& waiting(const net::Address& to) { return waiting_[key(to)]; }
  std::vector<Packet>& sent() { return sent_; }  ///< everything so far, also what was lost

  double loss = 0;
  double duplicate = 0;
  double hold_back = 0;  ///< past the next one
  bool cut = false;

 private:
  using Key = std::array<std::uint8_t, 18>;
  static Key key(const net::Address& a) {
    Key k{};
    std::copy(a.ip.begin(), a.ip.end(), k.begin());
    k[16] = static_cast<std::uint8_t>(a.port & 0xff);
    k[17] = static_cast<std::uint8_t>(a.port >> 8);
    return k;
  }
  Random random_;
  std::map<Key, std::deque<Packet>> waiting_;
  std::deque<Packet> held_;
  std::vector<Packet> sent_;
};

}  // namespace telenano::security

// What a tick takes from its socket: never more than a bounded number of datagrams, never more bytes than
// allowed.
#include <gtest/gtest.h>

#include <algorithm>

#include "telenano/master/device/sim_device.h"
#include "telenano/master/loop/station_loop.h"
#include "tests/unit/station/station_rig.h"

namespace telenano::loop {
namespace {

/// A network that never runs dry, up to a limit that ends the test instead of hanging it.
class Flood final : public net::Datagram {
 public:
  static constexpr int kLimit = 1'000'000;
  explicit Flood(std::size_t size) : size_(size) {}
  net::SendStatus send(std::span<const std::uint8_t>, const net::Address&) noexcept override {
    return net::SendStatus::kSent;
  }
  bool receive(std::span<std::uint8_t> buffer, net::Received& received) noexcept override {
    if (taken == kLimit) return false;
    ++taken;
    std::fill(buffer.begin(), buffer.end(), std::uint8_t{0});
    received = {size_, from};
    return true;
  }
  int taken = 0;
  net::Address from;

 private:
  std::size_t size_;
};

struct Bench {
  explicit Bench(std::size_t datagram_bytes) : flood(datagram_bytes) { client.start(0); }
  device::SimDevice device{{}, device::IntendedMotion::for_task(device::Task::kIndent, {})};
  Flood flood;
  link::ClientSession client{link::ClientConfig{}};
  station::Station station{station::StationConfig{}, station::StationRig::device(), {10, 0, 500}};
  StationLoop loop{device, flood, net::Address{}, client, station};
  recording::Sample sample;
};

TEST(StationDrain, AFloodDoesNotKeepATickFromEnding) {
  for (bool from_the_server : {true, false}) {
    Bench bench(100);
    if (!from_the_server) bench.flood.from.port = 1;
    bench.loop.tick(1'000'000, 1e-3, bench.sample);
    EXPECT_LE(bench.flood.taken, 1000);
    EXPECT_GE(bench.flood.taken, 64) << "a burst after an outage is taken at once";
  }
}

TEST(StationDrain, OversizeDatagramsAreSeenAsSuch) {
  Bench bench(link::kMaxDatagramBytes + 1);
  bench.loop.tick(1'000'000, 1e-3, bench.sample);
  EXPECT_GT(bench.client.drops()[link::DropCause::kOversize], 0u);
  EXPECT_EQ(bench.client.drops()[link::DropCause::kOversize], bench.client.drops().total());
}

}  // namespace
}  // namespace telenano::loop

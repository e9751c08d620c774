#include "telenano/nve_server/server/server_shutdown.h"

#include <algorithm>
#include <array>
#include <vector>

#include "telenano/common/link/messages.h"

namespace telenano::server {
namespace {

constexpr std::int64_t kPollNs = 1'000'000;  // as often as slaves retract while the server runs
constexpr std::int64_t kByeGapNs = 20'000'000;
constexpr int kByes = 3;

struct Farewell {
  net::Address to;
  std::array<std::uint8_t, link::kMaxDatagramBytes> bytes;
  std::size_t size = 0;
};

}  // namespace

void shut_down(Server& server, net::Datagram& socket, const rt::Clock& clock,
               const std::function<void(std::int64_t timeout_ns)>& wait, const ShutdownOptions& options) {
  std::vector<Farewell> farewells(1);
  const std::int64_t start_ns = clock.now_ns();
  while ((farewells.back().size = server.next_bye(start_ns, farewells.back().bytes, farewells.back().to)) !=
         0) {
    farewells.emplace_back();
  }
  farewells.pop_back();

  std::array<std::uint8_t, link::kMaxDatagramBytes + 1> in{};
  std::array<std::uint8_t, link::kMaxDatagramBytes> out{};
  net::Received received;
  int byes = 0;
  for (;;) {
    const std::int64_t now_ns = clock.now_ns();
    if (byes < kByes && now_ns - start_ns >= byes * kByeGapNs) {
      for (const Farewell& f : farewells) socket.send({f.bytes.data(), f.size}, f.to);
      ++byes;
    }
    server.poll(now_ns);
    const bool said = byes == kByes || farewells.empty();
    const bool at_once = options.at_once != nullptr && options.at_once->load(std::memory_order_relaxed);
    if ((said && server.at_rest()) || at_once || now_ns - start_ns > options.at_most_ns) {
      socket.flush();
      return;
    }
    for (int i = 0; i < 256 && socket.receive(in, received); ++i) {
      const std::size_t size = std::min(received.size, in.size());
      const std::size_t n = server.on_datagram({in.data(), size}, received.from, clock.now_ns(), out, &clock,
                                               received.standing);
      if (n > 0) socket.send({out.data(), n}, received.from);
    }
    socket.flush();
    wait(kPollNs);
  }
}

}  // namespace telenano::server

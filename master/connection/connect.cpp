#include "telenano/master/connection/connect.h"

#include <fmt/format.h>

#include <array>
#include <random>
#include <span>
#include <string>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/steady_clock.h"

namespace telenano::connection {

std::string refusal_text(const link::Refuse& refuse, double rate_hz, const std::string& server) {
  switch (refuse.reason) {
    case link::RefuseReason::kVersion:
      return fmt::format(
          "the server at {} speaks protocol version {} to {}, this station {}; update the older one", server,
          refuse.version_min, refuse.version_max, link::kProtocolVersion);
    case link::RefuseReason::kFull:
      return fmt::format(
          "the server at {} has no room for another session; try again later, or start it with a larger "
          "--max-sessions, or --sessions-per-peer if this key or address has many sessions",
          server);
    case link::RefuseReason::kRate:
      return fmt::format("the server at {} does not serve sessions of {} Hz; try a lower --rate", server,
                         rate_hz);
    case link::RefuseReason::kShuttingDown:
      return fmt::format("the server at {} is shutting down", server);
    case link::RefuseReason::kScene:
      break;  // answers no Hello
  }
  return fmt::format("the server at {} refuses for a reason that this version of the station does not know",
                     server);
}

std::uint64_t random_nonce_seed() {
  std::random_device device;
  return (static_cast<std::uint64_t>(device()) << 32) | device();
}

void connect(link::ClientSession& session, ServerLink& way, const net::Address& server, double rate_hz,
             const ServerAccess& access, const std::atomic<bool>& stop) {
  way.secure(access, stop);
  net::Datagram& socket = way.datagram();
  const std::string& name = access.server;
  const rt::SteadyClock clock;
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  const std::int64_t start_ns = clock.now_ns();
  session.start(start_ns);
  while (session.state() != link::ClientState::kEstablished) {
    const std::int64_t now_ns = clock.now_ns();
    net::Received received;
    while (socket.receive(buffer, received)) {
      if (received.from == server && received.size <= buffer.size()) {
        session.on_datagram(std::span(buffer).first(received.size), now_ns);
      }
    }
    if (session.state() == link::ClientState::kRefused)
      throw RunError(refusal_text(session.refuse(), rate_hz, name));
    if (stop) throw RunError("stopped before the server answered");
    if (static_cast<double>(now_ns - start_ns) * 1e-9 > access.connect_timeout_s) {
      const std::uint64_t wrong = session.drops()[link::DropCause::kWrongVersion];
      if (wrong > 0) {
        throw RunError(
            fmt::format("the server at {} answers in another protocol version than {}; update the older one",
                        name, link::kProtocolVersion));
      }
      if (session.state() == link::ClientState::kChallenged)
        throw RunError(fmt::format(
            "the server at {} answers, but the session was not open within {:g} s: opening takes two "
            "round trips; a longer --connect-timeout-s waits for them",
            name, access.connect_timeout_s));
      throw RunError(fmt::format("no answer from {} within {:g} s; {}", name, access.connect_timeout_s,
                                 way.advice(name)));
    }
    if (const std::size_t n = session.poll(now_ns, buffer))
      socket.send(std::span<const std::uint8_t>(buffer).first(n), server);
    way.wait_readable(1'000'000);
  }
  const std::uint32_t rate_max_hz = session.welcome().slave_rate_max_hz;
  if (rate_max_hz != 0 && rate_hz > rate_max_hz) {
    throw RunError(
        fmt::format("the slave at {} accepts at most {} commands per second; give --rate {} or less", name,
                    rate_max_hz, rate_max_hz));
  }
}

}  // namespace telenano::connection

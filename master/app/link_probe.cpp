#include "telenano/master/app/link_probe.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/steady_clock.h"

namespace telenano::app {
namespace {

constexpr std::int64_t kWaitMinNs = 50'000'000;  // for what is late after the last command
constexpr std::int64_t kWaitFactor = 4;          // of the slowest answer so far
constexpr std::int64_t kAliveNs = 5'000'000;     // between commands that count no more

double quantile_s(const std::vector<std::int64_t>& sorted_ns, double part) {
  const double rank = std::ceil(part * static_cast<double>(sorted_ns.size()));
  return 1e-9 * static_cast<double>(sorted_ns[static_cast<std::size_t>(std::max(rank, 1.0)) - 1]);
}

}  // namespace

LinkDelay measure_link(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                       double rate_hz, int count, double timeout_s, const std::atomic<bool>& stop) {
  const rt::SteadyClock clock;
  net::Datagram& socket = way.datagram();
  const std::int64_t period_ns = std::llround(1e9 / rate_hz);
  const std::int64_t timeout_ns = std::llround(1e9 * timeout_s);
  std::array<std::uint8_t, link::kMaxDatagramBytes> buffer;
  std::vector<std::int64_t> round_trips_ns;
  std::int64_t slowest_ns = 0;
  std::int64_t next_ns = clock.now_ns();
  std::int64_t last_sent_ns = next_ns;  // of those that count
  std::uint64_t last = 0;
  bool over = false;
  bool measures = false;
  int sent = 0;
  for (;;) {
    std::int64_t now_ns = clock.now_ns();
    net::Received received;
    while (socket.receive(buffer, received)) {
      if (!(received.from == server) || received.size > buffer.size()) continue;
      const std::int64_t came_ns = clock.now_ns() - received.age_ns;
      if (session.on_datagram(std::span(buffer).first(received.size), came_ns) != link::ClientEvent::kReply)
        continue;
      measures = session.reply().measurement_age_ns != 0;
      // Earlier answers than this one are late, and no answers any more.
      over = over || (sent == count && session.reply().command_sequence >= last);
      if (sent == count && session.reply().command_sequence > last) continue;
      const auto round_trip_ns = static_cast<std::int64_t>(static_cast<std::uint64_t>(came_ns) -
                                                           session.reply().command_send_time_ns);
      if (round_trip_ns < 0 || round_trip_ns > timeout_ns + period_ns * count) continue;  // no echo of ours
      round_trips_ns.push_back(round_trip_ns);
      slowest_ns = std::max(slowest_ns, round_trip_ns);
    }
    if (stop) throw RunError("stopped while the link was measured");
    if (!session.has_session() && session.bye_reason() == link::ByeReason::kIdle)
      throw RunError(fmt::format(
          "the server heard no command for {} ms and ended the session: the round trip is too long for "
          "it; start telenano-nve serve with a longer --timeout-ms",
          session.welcome().timeout_ms));
    if (!session.has_session()) throw RunError("the server ended the session while the link was measured");
    if (over) break;
    // More of them until the last answer is here: one may be lost, and a server takes silence for the end of the session.
    if (now_ns >= next_ns) {
      link::Command command;
      command.tip_pos_w_nm = session.welcome().start_pos_w_nm;
      command.flags = link::kFlagHandOver;  // who measures need not hold a shared tip
      now_ns = clock.now_ns();
      const std::size_t size = session.make_command(command, now_ns, buffer);
      socket.send(std::span<const std::uint8_t>(buffer).first(size), server);
      if (sent < count) {
        ++sent;
        last = command.sequence;
        last_sent_ns = now_ns;
      }
      next_ns = now_ns + (sent < count ? period_ns : std::max(period_ns, kAliveNs));
    }
    const std::int64_t patience_ns =
        round_trips_ns.empty() ? timeout_ns : std::max(kWaitMinNs, kWaitFactor * slowest_ns);
    if (sent == count && now_ns - last_sent_ns > patience_ns) break;
    way.wait_readable(std::max<std::int64_t>(next_ns - clock.now_ns(), 1));
  }
  if (round_trips_ns.empty())
    throw RunError(
        "the server opened a session but does not answer commands; does the link work in one direction only, "
        "or lose most packets?");
  std::sort(round_trips_ns.begin(), round_trips_ns.end());
  return {quantile_s(round_trips_ns, 0.5), quantile_s(round_trips_ns, 0.99), sent,
          static_cast<int>(round_trips_ns.size()), measures};
}

}  // namespace telenano::app

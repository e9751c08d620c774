#include "tests/studies/flood/flood_station.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <exception>
#include <functional>
#include <random>

#include "telenano/common/base/error.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/rt/periodic_timer.h"
#include "telenano/common/rt/realtime_thread.h"
#include "telenano/common/rt/steady_clock.h"

namespace telenano::studies {
namespace {

constexpr std::int64_t kLastAnswers_ns = 200'000'000;
constexpr std::size_t kDatagramBytes = link::kMaxDatagramBytes + 1;

/// When each question of the last ticks was sent, to time the answers.
class SendTimes {
 public:
  void put(std::uint64_t number, std::int64_t now_ns) noexcept { sent_ns_[number % kKept] = now_ns; }
  std::int64_t since(std::uint64_t number, std::int64_t now_ns) const noexcept {
    return now_ns - sent_ns_[number % kKept];
  }

 private:
  static constexpr std::size_t kKept = 16384;
  std::array<std::int64_t, kKept> sent_ns_{};
};

/// One question a tick: `ask` gives its bytes and number, `take` the number that an answer is to, 0 = none.
struct Talk {
  std::function<std::size_t(std::int64_t now_ns, std::span<std::uint8_t> out, std::uint64_t& number)> ask;
  std::function<std::uint64_t(std::span<const std::uint8_t> bytes, std::int64_t now_ns)> take;
};

void talk(net::Udp& socket, const net::Address& to, double rate_hz, double seconds, Flooder* flooder,
          const Talk& with, StationRun& run) {
  const rt::SteadyClock clock;
  SendTimes times;
  std::array<std::uint8_t, kDatagramBytes> buffer{};
  const auto listen = [&] {
    net::Received received;
    while (socket.receive(buffer, received)) {
      if (!(received.from == to) || received.size > buffer.size()) continue;
      const std::int64_t came_ns = clock.now_ns() - received.age_ns;
      const std::uint64_t number = with.take({buffer.data(), received.size}, came_ns);
      if (number == 0) continue;
      ++run.answered;
      run.round_trip.add(times.since(number, came_ns));
    }
  };
  rt::PeriodicTimer timer({static_cast<std::int64_t>(1e9 / rate_hz), 0});
  const std::int64_t start_ns = clock.now_ns();
  const auto ticks = static_cast<std::int64_t>(seconds * rate_hz);
  while (timer.wait().index < ticks) {
    listen();
    std::uint64_t number = 0;
    const std::int64_t now_ns = clock.now_ns();
    if (const std::size_t n = with.ask(now_ns, buffer, number)) {
      times.put(number, now_ns);
      socket.send({buffer.data(), n}, to);
      ++run.asked;
      if (flooder != nullptr) flooder->overhear({buffer.data(), n});
    }
  }
  run.ticks = timer.stats().ticks;
  run.missed_ticks = timer.stats().missed;
  run.seconds = 1e-9 * static_cast<double>(clock.now_ns() - start_ns);
  const std::int64_t end_ns = clock.now_ns() + kLastAnswers_ns;
  while (clock.now_ns() < end_ns) {
    socket.wait_readable(end_ns - clock.now_ns());
    listen();
  }
}

/// As the real station runs: real-time where that is allowed.
void in_realtime(const std::function<void()>& work) {
  std::exception_ptr error;
  {
    rt::RealtimeConfig config;
    config.lock_memory = false;
    rt::RealtimeThread thread(config, [&](const std::stop_token&) {
      try {
        work();
      } catch (...) {
        error = std::current_exception();
      }
    });
    thread.join();
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace

StationRun run_station(const net::Address& server, double rate_hz, double seconds, Flooder* flooder) {
  StationRun run;
  in_realtime([&] {
    net::Udp socket = net::Udp::open_for(server);
    const rt::SteadyClock clock;
    std::array<std::uint8_t, kDatagramBytes> buffer{};
    link::ClientConfig config;
    config.rate_hz = static_cast<std::uint32_t>(rate_hz);
    config.nonce_seed = std::random_device{}();
    link::ClientSession session(config);
    session.start(clock.now_ns());
    const std::int64_t give_up_ns = clock.now_ns() + 5'000'000'000;
    while (session.state() != link::ClientState::kEstablished) {
      const std::int64_t now_ns = clock.now_ns();
      if (now_ns > give_up_ns) throw RunError("no session with " + net::to_string(server) + " within 5 s");
      net::Received received;
      while (socket.receive(buffer, received))
        if (received.from == server) session.on_datagram({buffer.data(), received.size}, now_ns);
      if (const std::size_t n = session.poll(now_ns, buffer)) socket.send({buffer.data(), n}, server);
      socket.wait_readable(1'000'000);
    }
    const Talk with{[&](std::int64_t now_ns, std::span<std::uint8_t> out, std::uint64_t& number) {
                      // A session that was lost would be taken up again here, and counted.
                      if (const std::size_t n = session.poll(now_ns, out)) socket.send(out.first(n), server);
                      link::Command command;
                      command.flags = link::kFlagClutch | link::kFlagDeadman;
                      command.tip_pos_w_nm = session.welcome().start_pos_w_nm;
                      const std::size_t n = session.make_command(command, now_ns, out);
                      number = command.sequence;
                      return n;
                    },
                    [&](std::span<const std::uint8_t> bytes, std::int64_t now_ns) {
                      const bool reply = session.on_datagram(bytes, now_ns) == link::ClientEvent::kReply;
                      return reply ? session.reply().command_sequence : std::uint64_t{0};
                    }};
    talk(socket, server, rate_hz, seconds, flooder, with, run);
    run.sessions = session.sessions();
    for (int i = 0; i < 2; ++i)
      if (const std::size_t n = session.make_bye(link::ByeReason::kDone, buffer))
        socket.send({buffer.data(), n}, server);
  });
  return run;
}

StationRun run_pinger(const net::Address& echo, double rate_hz, double seconds, Flooder* flooder) {
  // As long as a command.
  constexpr std::size_t kBytes = 126;
  StationRun run;
  in_realtime([&] {
    net::Udp socket = net::Udp::open_for(echo);
    std::uint64_t asked = 0;
    const Talk with{[&](std::int64_t, std::span<std::uint8_t> out, std::uint64_t& number) {
                      number = ++asked;
                      std::memcpy(out.data(), &number, sizeof number);
                      return kBytes;
                    },
                    [&](std::span<const std::uint8_t> bytes, std::int64_t) {
                      std::uint64_t number = 0;
                      if (bytes.size() == kBytes) std::memcpy(&number, bytes.data(), sizeof number);
                      return number;
                    }};
    talk(socket, echo, rate_hz, seconds, flooder, with, run);
  });
  return run;
}

}  // namespace telenano::studies

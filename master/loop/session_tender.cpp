#include "telenano/master/loop/session_tender.h"

#include <algorithm>
#include <span>

namespace telenano::loop {
namespace {

constexpr std::int64_t kAwakeNs = 20'000'000;         // the shortest time-out of a scene is 50 ms
constexpr std::int64_t kFetchOverNs = 1'000'000'000;  // after so long without a request
constexpr double kTurns_hz = 1000;                    // more commands than turns there cannot be

link::RateControlConfig config_for(double rate_hz) noexcept {
  link::RateControlConfig config;
  config.full_hz = std::min(rate_hz, kTurns_hz);
  return config;
}

}  // namespace

SessionTender::SessionTender(link::ClientSession& session, net::Datagram& socket, const net::Address& server,
                             ScenePipe& pipe, const rt::Clock& clock, double rate_hz)
    : session_(session),
      socket_(socket),
      server_(server),
      pipe_(pipe),
      clock_(clock),
      rate_(config_for(rate_hz)) {}

void SessionTender::take(link::ClientEvent event, std::int64_t came_ns) noexcept {
  if (event == link::ClientEvent::kSceneChunk) pipe_.take(session_.incoming().scene_chunk);
  if (event == link::ClientEvent::kWelcome && session_.epoch_changed()) rate_.reset();
  if (event == link::ClientEvent::kReply) {
    const link::LinkStats& stats = session_.stats();
    const link::Reply& reply = session_.reply();
    rate_.on_reply(came_ns, stats.samples() != rtt_samples_ ? stats.rtt_last_ns() : -1,
                   {reply.command_sequence, reply.sequence, reply.replies_left_out});
    rtt_samples_ = stats.samples();
  }
  if (session_.overtaken_reply() != nullptr) rate_.on_late_reply();
  if (on_event) on_event(event);
}

void SessionTender::turn() noexcept {
  net::Received received;
  while (socket_.receive(buffer_, received)) {
    if (!(received.from == server_) || received.size > buffer_.size()) continue;
    const std::int64_t came_ns = clock_.now_ns() - received.age_ns;
    take(session_.on_datagram(std::span<const std::uint8_t>(buffer_).first(received.size), came_ns), came_ns);
  }
  const std::int64_t now_ns = clock_.now_ns();
  rate_.update(now_ns);
  const bool fetches = fetched_ns_ != INT64_MIN && now_ns - fetched_ns_ < kFetchOverNs;
  if (now_ns >= next_ns_ || (fetches && rate_.may_send())) {
    link::Command command;
    command.tip_pos_w_nm = session_.welcome().start_pos_w_nm;
    command.flags = link::kFlagHandOver;  // who waits need not hold a shared tip
    const std::size_t size = session_.make_command(command, now_ns, buffer_);
    if (size > 0) {
      socket_.send(std::span<const std::uint8_t>(buffer_).first(size), server_);
      rate_.sent(now_ns);
    }
    next_ns_ = now_ns + kAwakeNs;
  }
  pipe_.link_most_per_s.store(rate_.bulk_per_s(), std::memory_order_relaxed);
  if (pipe_.turn(session_, socket_, server_, buffer_) > 0) {
    rate_.bulk_sent(now_ns);
    fetched_ns_ = now_ns;
  }
}

}  // namespace telenano::loop

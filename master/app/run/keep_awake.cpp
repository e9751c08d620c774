#include "telenano/master/app/run/keep_awake.h"

#include <span>

#include "telenano/common/rt/signals_blocked.h"

namespace telenano::app {
namespace {

constexpr std::int64_t kAwakeNs = 20'000'000;  // the shortest time-out of a scene is 50 ms
constexpr std::int64_t kLookNs = 1'000'000;

}  // namespace

void SessionTender::turn() noexcept {
  net::Received received;
  while (socket_.receive(buffer_, received)) {
    if (!(received.from == server_) || received.size > buffer_.size()) continue;
    const auto event = session_.on_datagram(std::span<const std::uint8_t>(buffer_).first(received.size),
                                            clock_.now_ns() - received.age_ns);
    if (event == link::ClientEvent::kSceneChunk) pipe_.take(session_.incoming().scene_chunk);
    if (on_event) on_event(event);
  }
  if (const std::int64_t now_ns = clock_.now_ns(); now_ns >= next_ns_) {
    link::Command command;
    command.tip_pos_w_nm = session_.welcome().start_pos_w_nm;
    command.flags = link::kFlagHandOver;  // who waits need not hold a shared tip
    const std::size_t size = session_.make_command(command, now_ns, buffer_);
    if (size > 0) socket_.send(std::span<const std::uint8_t>(buffer_).first(size), server_);
    next_ns_ = now_ns + kAwakeNs;
  }
  pipe_.turn(session_, socket_, server_, buffer_);
}

KeepAwake::KeepAwake(link::ClientSession& session, connection::ServerLink& way, const net::Address& server,
                     loop::ScenePipe& pipe)
    : way_(way), tender_(session, way.datagram(), server, pipe) {
  const rt::SignalsBlocked blocked;  // signals are for the main thread
  thread_ = std::thread([this] { run(); });
}

KeepAwake::~KeepAwake() {
  stop_.store(true, std::memory_order_release);
  thread_.join();
}

void KeepAwake::run() noexcept {
  while (!stop_.load(std::memory_order_acquire)) {
    tender_.turn();
    way_.wait_readable(kLookNs);
  }
}

}  // namespace telenano::app

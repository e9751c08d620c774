#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "telenano/common/link/client_session.h"
#include "telenano/common/net/datagram.h"
#include "tests/studies/bench/motion.h"
#include "tests/studies/bench/raw_udp.h"

namespace telenano::studies {

/// Stations that keep a server busy: several sockets with some sessions each; a socket's sessions send one
/// command each, together, as soon as the last ones are answered, so that some hundred datagrams are always
/// on the way. Their clock runs by 1 ms a command.
class ClosedLoop {
 public:
  /// Opens the sessions. `floor`: the server only echoes, so the same bytes are sent again and again, and
  /// nothing is looked at. Throws RunError if a session does not open.
  ClosedLoop(const net::Address& server, std::size_t sockets, std::size_t sessions_each, bool model,
             bool floor);

  /// For so long; answers that came.
  std::uint64_t run(std::int64_t duration_ns);
  std::uint64_t lost() const noexcept { return lost_; }
  std::size_t command_bytes() const noexcept { return command_bytes_; }
  std::size_t reply_bytes() const noexcept { return reply_bytes_; }

 private:
  struct Station {
    std::unique_ptr<link::ClientSession> session;
    Motion motion;
    std::int64_t tick = 0;
    link::Command command;
  };
  struct Group {
    RawUdp socket;
    std::vector<Station> stations;
    std::size_t outstanding = 0;
    std::size_t answered = 0;
  };
  void open(Group& group, Station& station, std::uint64_t seed, bool model);
  void send(Group& group);
  void collect(Group& group);

  bool floor_;
  std::vector<std::unique_ptr<Group>> groups_;
  std::vector<std::array<std::uint8_t, 576>> bytes_;
  std::uint64_t answers_ = 0;
  std::uint64_t lost_ = 0;
  std::size_t command_bytes_ = 0;
  std::size_t reply_bytes_ = 0;
};

}  // namespace telenano::studies

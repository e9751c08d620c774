// How many pieces of a slave's state one session gets, however fast it asks.
#include <gtest/gtest.h>

#include "wall_session.h"

namespace telenano::server {
namespace {

// The bound is arithmetic: 64 pieces saved up at most, and 2500 a second (PROTOCOL.md, section 2).
TEST(SnapshotRate, OneSessionGetsNoMoreThanItsPieces) {
  LoggingSession session;
  Server& server = session.server;
  VirtualSession& s = session.s;
  ASSERT_TRUE(session.logs());
  link::SnapshotRequest request;
  request.session_id = s.client.welcome().session_id;
  request.snapshot = 1;
  link::Codec codec;
  const std::size_t size = codec.encode(request, s.buffer);
  const std::uint64_t before = server.drops()[link::DropCause::kRateLimited];
  std::size_t answered = 0;
  constexpr std::int64_t kAsked = 20'000;  // 10 000 a second for 2 s
  for (std::int64_t i = 0; i < kAsked; ++i) {
    answered +=
        server.on_datagram({s.buffer.data(), size}, s.link.address_a(), s.now_ns + i * 100'000, s.answer) > 0;
  }
  EXPECT_GE(answered, 5000u);
  EXPECT_LE(answered, 5000u + 64 + 1);
  EXPECT_EQ(server.drops()[link::DropCause::kRateLimited] - before, kAsked - answered);
}

}  // namespace
}  // namespace telenano::server

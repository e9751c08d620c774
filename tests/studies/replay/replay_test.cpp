#include "tests/studies/replay/replay.h"

#include <gtest/gtest.h>

#include "telenano/common/base/random.h"
#include "telenano/common/link/messages.h"

namespace telenano::studies {
namespace {

recording::DatagramRow reply(std::uint64_t sequence, std::uint64_t answers, std::uint64_t steps_before) {
  recording::DatagramRow row;
  row.type = static_cast<std::uint32_t>(link::MessageType::kReply);
  row.sequence = sequence;
  row.answers = answers;
  row.steps_before = steps_before;
  return row;
}

/// Commands 1 … n, each accepted or not by chance; each reply comes or not by chance.
struct Link {
  Link(std::uint64_t seed, double loss_up, double loss_down, std::uint64_t n) {
    Random random(seed);
    std::uint64_t replies = 0, history = 0;
    for (std::uint64_t c = 1; c <= n; ++c) {
      if (random.chance(loss_up)) {
        history <<= 1;
        continue;
      }
      accepted.insert(c);
      ++replies;
      if (!random.chance(loss_down)) {
        rows.push_back(reply(replies, c, history));
        last_known = c;
      }
      history = history << 1 | 1;
    }
  }
  std::set<std::uint64_t> accepted;
  std::vector<recording::DatagramRow> rows;
  std::uint64_t last_known = 0;
};

TEST(StepOrder, IsKnownWhateverIsLost) {
  for (const double up : {0.0, 0.2, 0.5}) {
    for (const double down : {0.0, 0.2, 0.5}) {
      const Link link(3, up, down, 20'000);
      const StepOrder order = step_order(link.rows);
      EXPECT_EQ(order.unknown_from, UINT64_MAX);
      // Of commands after the last reply nobody knows.
      EXPECT_EQ(order.commands, std::set(link.accepted.begin(), link.accepted.upper_bound(link.last_known)))
          << up << ' ' << down;
    }
  }
}

TEST(StepOrder, ALongOutageOneWayOrTheOtherIsKnownToo) {
  // 200 commands lost: replies 10 and 11.
  EXPECT_EQ(step_order({reply(1, 1, 0), reply(2, 202, 0)}).unknown_from, UINT64_MAX);
  EXPECT_EQ(step_order({reply(1, 1, 0), reply(2, 202, 0)}).commands, (std::set<std::uint64_t>{1, 202}));
  // 200 replies lost: all of these commands had come.
  const StepOrder all = step_order({reply(1, 1, 0), reply(202, 202, ~0ull)});
  EXPECT_EQ(all.unknown_from, UINT64_MAX);
  EXPECT_EQ(all.commands.size(), 202u);
  // Of 200 some came, and the 64 that are told of are not all of them.
  EXPECT_EQ(step_order({reply(1, 1, 0), reply(102, 202, ~0ull)}).unknown_from, 2u);
}

TEST(StepOrder, ADuplicateOrLateReplyChangesNothing) {
  const Link link(5, 0.3, 0.3, 1000);
  std::vector<recording::DatagramRow> rows = link.rows;
  rows.push_back(rows[10]);
  std::swap(rows[20], rows[23]);
  EXPECT_EQ(step_order(rows).commands, step_order(link.rows).commands);
}

}  // namespace
}  // namespace telenano::studies

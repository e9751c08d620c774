#include "tests/studies/replay/replay.h"

#include <gtest/gtest.h>

#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/common/link/client_session.h"
#include "telenano/common/link/messages.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/logged_step.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"
#include "tests/studies/replay/scripted_wire.h"

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
  Link(std::uint64_t seed, double loss_up, double loss_down, std::uint64_t n, double left_out = 0) {
    Random random(seed);
    std::uint64_t replies = 0, history = 0, without = 0;
    for (std::uint64_t c = 1; c <= n; ++c) {
      if (random.chance(loss_up)) {
        history <<= 1;
        continue;
      }
      accepted.insert(c);
      if (left_out > 0 && random.chance(left_out)) {
        ++without;
        history = history << 1 | 1;
        continue;
      }
      ++replies;
      if (!random.chance(loss_down)) {
        rows.push_back(reply(replies, c, history));
        rows.back().left_out = without;
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

TEST(StepOrder, IsKnownWithRepliesLeftOut) {
  for (const double up : {0.0, 0.2}) {
    for (const double down : {0.0, 0.2}) {
      const Link link(4, up, down, 20'000, 0.8);
      const StepOrder order = step_order(link.rows);
      EXPECT_EQ(order.unknown_from, UINT64_MAX) << up << ' ' << down;
      EXPECT_EQ(order.commands, std::set(link.accepted.begin(), link.accepted.upper_bound(link.last_known)));
    }
  }
  // 200 left out, and none lost: that is known by their count alone.
  std::vector<recording::DatagramRow> rows = {reply(1, 1, 0), reply(2, 202, ~0ull)};
  rows[1].left_out = 200;
  EXPECT_EQ(step_order(rows).unknown_from, UINT64_MAX);
  EXPECT_EQ(step_order(rows).commands.size(), 202u);
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

// Of the idle commands by which the link was measured, 29 is answered by a reply that was lost: had it come,
// that to 28 would have been stale.
TEST(RecordedSession, AReplyNewerThanTheFirstOneRecordedWasLost) {
  recording::DatagramRow welcome;
  welcome.type = static_cast<std::uint32_t>(link::MessageType::kWelcome);
  recording::DatagramRow stale = reply(19, 25, 0);
  stale.drop = static_cast<std::uint32_t>(link::DropCause::kStale);
  EXPECT_EQ(newest_answered_before({welcome, stale, reply(21, 28, 0), reply(23, 30, 0)}, true), 27u);
  EXPECT_EQ(newest_answered_before({welcome, stale}, true), UINT64_MAX);
  EXPECT_EQ(newest_answered_before({welcome, stale, reply(21, 28, 0)}, false), 0u);
}

/// A session that logs its steps, over a wire that knows what the replies had said. Step n is that of command
/// n: down onto the surface and along it, each with a target of its own, so that no two states are the same.
class LoggedWire {
 public:
  static constexpr std::uint64_t kSteps = 400;

  explicit LoggedWire(std::set<std::uint64_t> came)
      : scene_(
            scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/flat_silicon_oxide.toml")),
        server_(server_config(), served(scene_)),
        wire_(server_, clock_, Script{StepOrder{std::move(came), UINT64_MAX}, {}}),
        client_(client_config()) {
    std::array<std::uint8_t, link::kMaxDatagramBytes> bytes{};
    client_.start(now_ns_);
    for (int i = 0; i < 10 && client_.state() != link::ClientState::kEstablished; ++i) {
      clock_.set(now_ns_ += 1000);
      if (const std::size_t n = client_.poll(now_ns_, bytes))
        wire_.send(std::span(bytes).first(n), wire_.address());
      net::Received received;
      while (wire_.receive(bytes, received))
        client_.on_datagram(std::span(bytes).first(received.size), now_ns_);
    }
    EXPECT_TRUE(client_.logs_steps());
    wire_.open_to_all(false);
  }

  ScriptedWire& wire() { return wire_; }
  link::LoggedStep step(std::uint64_t number) const {
    const Vec3 start = client_.welcome().start_pos_w_nm;
    const auto n = static_cast<double>(number);
    const Vec3 target = start + Vec3(0.1 * n, 0, -(start.z() + 5) * n / kSteps);
    std::uint32_t flags = link::kFlagClutch | link::kFlagDeadman;
    if (number >= stop_from) flags |= link::kFlagStop;
    return link::logged_step(target, flags, 1e-3);
  }
  /// Commands 1 … kSteps, one a millisecond.
  void run() {
    for (std::uint64_t number = 1; number <= kSteps; ++number) {
      wire_.begin_tick(now_ns_ += 1'000'000, {});
      link::Command command;
      command.tip_pos_w_nm = client_.welcome().start_pos_w_nm;
      command.flags = step(number).flags;
      std::array<std::uint8_t, link::kMaxDatagramBytes> bytes{};
      const std::size_t n = client_.make_command(command, now_ns_, bytes);
      ASSERT_EQ(command.sequence, number);
      wire_.send(std::span(bytes).first(n), wire_.address());
      wire_.end_tick(number, step(number));
    }
  }
  link::Reply reply(std::uint64_t number) const {
    const auto* bytes = wire_.reply_to(number);
    link::Codec codec;
    link::Incoming incoming;
    if (bytes == nullptr || codec.decode(*bytes, incoming) != link::DropCause::kNone) return {};
    return incoming.reply;
  }
  /// The state after each step: of a slave that was told them one by one.
  std::vector<std::uint64_t> hashes() const {
    slave::NveSlave slave(scene_);
    slave::SlaveOutput output;
    std::vector<std::uint64_t> hashes{slave.state_hash()};
    Vec3 last = Vec3::Zero();
    for (std::uint64_t number = 1; number <= kSteps; ++number) {
      const link::LoggedStep made = step(number);
      const Vec3 to = link::target_w_nm(made);
      const bool was_up = (output.fault_bits & link::kFaultRetracted) != 0;
      slave.step(slave::input_of(to, (to - last) / link::dt_s(made), made.flags, true, was_up),
                 link::dt_s(made), output);
      last = to;
      hashes.push_back(slave.state_hash());
    }
    return hashes;
  }

  std::uint64_t stop_from = UINT64_MAX;  ///< this step and all after it say stop

 private:
  static server::ServerConfig server_config() {
    server::ServerConfig config;
    config.secret = link::SipKey{1, 2};
    config.table.capacity = 1;
    return config;
  }
  static server::ServedScene served(const std::shared_ptr<const scene::Scene>& scene) {
    server::ServedScene served;
    served.name = server::scene_name(scene->name);
    served.hash = scene->hash;
    served.make_slave = [scene] { return std::make_unique<slave::NveSlave>(scene); };
    return served;
  }
  static link::ClientConfig client_config() {
    link::ClientConfig config;
    config.step_ring = 4000;
    return config;
  }

  std::shared_ptr<const scene::Scene> scene_;
  std::int64_t now_ns_ = 1'000'000'000;
  RecordedClock clock_;
  server::Server server_;
  ScriptedWire wire_;
  link::ClientSession client_;
};

std::set<std::uint64_t> commands(const std::function<bool(std::uint64_t)>& came) {
  std::set<std::uint64_t> numbers;
  for (std::uint64_t number = 1; number <= LoggedWire::kSteps; ++number)
    if (came(number)) numbers.insert(number);
  return numbers;
}

// A server for which step 2 was missing had all others up to 150; the datagram that brought it on executed 64
// steps, as many as one may, and the server's own look at its log the rest before the next one came. Then
// replies were lost, and later commands, beyond which the log went on by leaps.
TEST(ScriptedWire, TheServerHasMadeByEachReplyWhatItHadMadeThen) {
  LoggedWire session(commands([](std::uint64_t c) { return (c < 20 || c > 30) && (c < 280 || c > 300); }));
  std::map<std::uint64_t, std::uint64_t> executed;
  for (std::uint64_t c = 1; c <= LoggedWire::kSteps; ++c) {
    if ((c >= 20 && c <= 30) || (c >= 200 && c <= 260) || (c >= 280 && c <= 300)) continue;
    executed[c] = c <= 150 ? 1 : c == 151 ? 65 : c <= 300 ? c : c < 310 ? 279 : c;
  }
  for (const auto& [command, number] : executed) session.wire().expect_executed(command, number);
  session.run();
  EXPECT_EQ(session.wire().other_steps_at(), 0u);
  const auto hashes = session.hashes();
  for (const auto& [command, number] : executed) {
    const link::Reply reply = session.reply(command);
    ASSERT_EQ(reply.steps.executed, number) << "by command " << command;
    ASSERT_EQ(reply.steps.state_hash, hashes[number]) << "by command " << command;
    ASSERT_EQ(reply.steps.breaks, 0u) << "by command " << command;
  }
  EXPECT_EQ(session.reply(LoggedWire::kSteps).contact_state, link::ContactState::kContact);
}

// An outage was made good by commands of which nothing is known but the last one's reply: by it the server had
// made 290 steps, more than one datagram holds.
TEST(ScriptedWire, LossesMadeGoodByMoreStepsThanADatagramHolds) {
  LoggedWire session(commands([](std::uint64_t c) { return c <= 10 || c >= 300; }));
  for (std::uint64_t c = 1; c <= LoggedWire::kSteps; ++c)
    if (c <= 10 || c >= 300) session.wire().expect_executed(c, c);
  session.run();
  EXPECT_EQ(session.wire().other_steps_at(), 0u);
  const auto hashes = session.hashes();
  for (const std::uint64_t c : {std::uint64_t{10}, std::uint64_t{300}, LoggedWire::kSteps}) {
    EXPECT_EQ(session.reply(c).steps.executed, c);
    EXPECT_EQ(session.reply(c).steps.state_hash, hashes[c]);
  }
}

// A stop leaves out the steps that are missing before it. Where none were, none are left out: the wire must
// not have brought more than had come. Here the tip is up, and from 350 on the newest step comes a datagram
// later.
TEST(ScriptedWire, AStopBreaksTheLogOnlyWhereItDid) {
  LoggedWire session(commands([](std::uint64_t) { return true; }));
  session.stop_from = 100;
  for (std::uint64_t c = 1; c <= LoggedWire::kSteps; ++c)
    session.wire().expect_executed(c, c < 50 ? c : c < 98 ? 49 : c < 350 ? c : c - 1);
  session.run();
  EXPECT_EQ(session.wire().other_steps_at(), 0u);
  EXPECT_EQ(session.reply(349).steps.state_hash, session.hashes()[349]);
  EXPECT_NE(session.reply(349).fault_bits & link::kFaultRetracted, 0u);
  EXPECT_EQ(session.reply(LoggedWire::kSteps).steps.breaks, 0u);
  EXPECT_EQ(session.reply(LoggedWire::kSteps).steps.executed, LoggedWire::kSteps - 1);
}

// What the server cannot have made by then is said.
TEST(ScriptedWire, AReplyThatSaysOtherStepsIsFound) {
  LoggedWire session(commands([](std::uint64_t) { return true; }));
  for (std::uint64_t c = 1; c <= LoggedWire::kSteps; ++c)
    session.wire().expect_executed(c, c < 50 ? c : c + 1);  // a step that is not made yet
  session.run();
  EXPECT_EQ(session.wire().other_steps_at(), 50u);
}

// Whose the energy is that comes out of a shared tip depends on it: of a tip that nobody else has moved it is this session's.
TEST(OtherHolders, OnlyAChangeWithoutThisSessionIsAnothers) {
  constexpr std::uint64_t kNew = 7, kThere = 8;
  OtherHolders nobody(kNew);
  nobody.look(true, kNew);
  nobody.look(false, 9);
  nobody.look(false, 10);
  nobody.look(true, 11);  // steps of its own that were on their way
  nobody.look(true, 11);
  EXPECT_FALSE(nobody.moved());
  nobody.look(true, 12);
  EXPECT_TRUE(nobody.moved());
  nobody.look(false, 12);
  EXPECT_TRUE(nobody.moved()) << "until it is taken up";
  nobody.taken_up();
  nobody.look(false, 13);
  EXPECT_FALSE(nobody.moved());
  nobody.begin_slave();
  nobody.look(true, kNew);
  EXPECT_FALSE(nobody.moved());
  OtherHolders before(kNew);
  before.look(true, kThere);
  EXPECT_TRUE(before.moved()) << "before this session came";
}

}  // namespace
}  // namespace telenano::studies

// Checkpoints as bytes, and the folder that holds them: what is damaged, old, somebody else's or of another scene
// is not taken up, and of several servers that want a session exactly one gets it. The oracles are slaves that
// never were bytes, and the file system.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cinttypes>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/nve_server/app/serve/checkpoint_keeper.h"
#include "telenano/nve_server/scene/scene.h"
#include "telenano/nve_server/slave/nve_slave.h"
#include "tests/source_dir.h"

namespace telenano {
namespace {

namespace fs = std::filesystem;
using server::CheckpointNote;

std::shared_ptr<const scene::Scene> sample() {
  static const auto scene =
      scene::load_scene(std::string(TELENANO_SOURCE_DIR) + "/deploy/scenes/lithography.toml");
  return scene;
}

/// A session whose tip has ploughed.
server::SessionState ploughed(std::uint64_t token, std::uint64_t owner, int steps = 300) {
  server::SessionState state;
  state.session.resume_token = token;
  state.session.owner = owner;
  state.session.epoch = 77;
  state.session.rate_hz = 1000;
  state.session.rank = 1;
  state.session.used = true;
  state.tip.slave = std::make_unique<slave::NveSlave>(sample());
  const Vec3 start = state.tip.slave->limits().start_pos_w_nm;
  for (int i = 1; i <= steps; ++i) {
    slave::SlaveInput input;
    input.follow = input.wanted = true;
    input.tip_target_pos_w_nm = start + Vec3(0.05 * i, 0, -0.12 * i);
    state.tip.slave->step(input, 1e-3, state.tip.output);
  }
  return state;
}

constexpr server::CheckpointOf kOf{0x1234, 0x5678};

std::vector<std::uint8_t> bytes_of(const server::SessionState& state) {
  std::vector<std::uint8_t> bytes(server::kCheckpointBytes + state.tip.slave->snapshot_bytes_max());
  bytes.resize(server::write_checkpoint(kOf, state.session, state.tip, state.record, bytes));
  return bytes;
}

std::unique_ptr<slave::Slave> fresh() {
  return std::make_unique<slave::NveSlave>(sample());
}

TEST(Checkpoint, GoesOnWithTheSameBits) {
  server::SessionState a = ploughed(5, 9);
  ASSERT_GT(a.tip.output.force_w_nn.norm(), 1);
  const auto bytes = bytes_of(a);
  ASSERT_GT(bytes.size(), 100u);
  const auto b = server::read_checkpoint(kOf, bytes, fresh());
  ASSERT_TRUE(b);
  EXPECT_EQ(b->session.epoch, 77u);
  EXPECT_EQ(b->session.resume_token, 5u);
  EXPECT_EQ(b->session.owner, 9u);
  EXPECT_EQ(b->session.state, link::SlotState::kSilent);
  EXPECT_EQ(b->tip.output.commanded_pos_w_nm, a.tip.output.commanded_pos_w_nm);
  EXPECT_EQ(b->tip.output.energy_in_aj, a.tip.output.energy_in_aj);
  EXPECT_EQ(b->tip.output.force_w_nn, a.tip.output.force_w_nn);
  for (int i = 0; i < 200; ++i) {
    slave::SlaveInput input;
    input.follow = input.wanted = true;
    input.tip_target_pos_w_nm = a.tip.output.commanded_pos_w_nm + Vec3(0.1, 0.02, 0.01);
    a.tip.slave->step(input, 1e-3, a.tip.output);
    b->tip.slave->step(input, 1e-3, b->tip.output);
    ASSERT_EQ(a.tip.slave->state_hash(), b->tip.slave->state_hash()) << i;
  }
}

TEST(Checkpoint, WhatIsCutChangedOrOfSomethingElseIsNone) {
  const auto bytes = bytes_of(ploughed(5, 9));
  for (std::size_t n = 0; n < bytes.size(); n += n < 400 ? 13 : 1 + bytes.size() / 20)
    EXPECT_FALSE(server::read_checkpoint(kOf, std::span(bytes).first(n), fresh())) << n;
  EXPECT_FALSE(server::read_checkpoint({0x1235, 0x5678}, bytes, fresh()));
  EXPECT_FALSE(server::read_checkpoint({0x1234, 0x5679}, bytes, fresh()));
  EXPECT_FALSE(server::read_checkpoint(kOf, bytes, nullptr));
  // Within the file every changed bit is found.
  std::array<std::uint8_t, 40> before{};
  std::array<std::uint8_t, 8> after{};
  server::seal({1000, 3}, bytes, before, after);
  std::vector<std::uint8_t> file(before.begin(), before.end());
  file.insert(file.end(), bytes.begin(), bytes.end());
  file.insert(file.end(), after.begin(), after.end());
  server::CheckpointEnvelope envelope;
  EXPECT_EQ(server::unseal(file, envelope).size(), bytes.size());
  EXPECT_EQ(envelope.number, 3u);
  Random random(7);
  for (int i = 0; i < 100; ++i) {
    auto other = file;
    other[random.below(other.size())] ^= static_cast<std::uint8_t>(1u << (random.below(8)));
    EXPECT_TRUE(server::unseal(other, envelope).empty());
  }
  for (std::size_t n = 0; n < file.size(); n += 1 + file.size() / 100)
    EXPECT_TRUE(server::unseal(std::span(file).first(n), envelope).empty());
}

/// One server's end: a keeper, and what its only worker would do.
struct Rig {
  explicit Rig(const std::string& folder, server::CheckpointOf of = kOf, std::int64_t resume_ms = 30'000)
      : keeper({folder, of, fresh, resume_ms, [this](const std::string& text) { said += text + "\n"; },
                [this](const std::string& text) {
                  if (told != nullptr) told->push_back(text);
                },
                &drain},
               mail),
        queue(keeper.add_queue()) {
    keeper.start();
  }
  void keep(const server::SessionState& state, std::uint64_t number,
            CheckpointNote::Kind kind = CheckpointNote::Kind::kState) {
    const auto bytes = bytes_of(state);
    std::span<std::uint8_t> out;
    while ((out = queue.next_buffer()).empty()) std::this_thread::yield();
    std::copy(bytes.begin(), bytes.end(), out.begin());
    CheckpointNote note;
    note.kind = kind;
    note.size = bytes.size();
    note.token = state.session.resume_token;
    note.owner = state.session.owner;
    note.number = number;
    ASSERT_TRUE(queue.post_state(note));
    while (!queue.idle()) std::this_thread::yield();
  }
  std::unique_ptr<server::SessionState> ask(std::uint64_t token, std::uint64_t owner) {
    server::HandoffMessage question;
    question.token = token;
    question.owner = owner;
    mail.post(1, question);
    server::HandoffMessage answer;
    for (;;) {
      if (!mail.fetch(0, answer)) {
        std::this_thread::yield();
        continue;
      }
      if (answer.kind == server::HandoffMessage::Kind::kTaken) {
        ++taken;
        continue;
      }
      return std::unique_ptr<server::SessionState>(answer.state);
    }
  }
  std::string said;
  std::vector<std::string>* told = nullptr;  // the keeper's thread writes it
  int taken = 0;
  std::atomic<bool> drain{false};
  server::WorkerMail mail{1, true};
  app::CheckpointKeeper keeper;
  server::CheckpointQueue& queue;
};

class CheckpointFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/telenano_checkpoint_XXXXXX";
    ASSERT_NE(::mkdtemp(name), nullptr);
    folder = name;
  }
  void TearDown() override { fs::remove_all(folder); }
  std::vector<fs::path> files(const std::string& ending) const {
    std::vector<fs::path> all;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
      if (entry.is_regular_file() && entry.path().string().ends_with(ending)) all.push_back(entry.path());
    return all;
  }
  /// The only session's file, whoever has it.
  fs::path session() const {
    for (const auto& entry : fs::recursive_directory_iterator(folder))
      if (entry.path().filename().string().size() == 33) return entry.path();
    return {};
  }
  /// A server that is killed with kill -9 once it has kept `state`.
  void keep_and_die(const server::SessionState& state, std::uint64_t number) {
    const pid_t child = ::fork();
    if (child == 0) {
      Rig* const rig = new Rig(folder);
      rig->keep(state, number);
      ::raise(SIGKILL);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status));
  }
  std::string folder;
};

/// A keeper runs seldom on a busy machine. What its worker says meanwhile is held: of small states many, of large
/// ones as few as there is memory for. Nothing is lost or mixed up in it.
TEST(CheckpointQueue, ManySmallStatesWaitForTheirKeeper) {
  constexpr std::size_t kMiB = std::size_t{1} << 20;
  for (const std::size_t bytes : {std::size_t{1}, std::size_t{4096}, kMiB, 16 * kMiB, 64 * kMiB}) {
    const std::size_t buffers = server::CheckpointQueue::buffers_of(bytes);
    EXPECT_GE(buffers, 4u) << bytes;
    EXPECT_LE(buffers * bytes, std::max(4 * kMiB, 4 * bytes)) << bytes;
  }
  server::Bell bell;
  server::CheckpointQueue queue(4096, bell);
  constexpr std::uint64_t kBurst = 200;
  for (std::uint64_t i = 0; i < kBurst; ++i) {
    const auto out = queue.next_buffer();
    ASSERT_FALSE(out.empty()) << "after " << i << " states that nobody fetched";
    std::fill(out.begin(), out.end(), static_cast<std::uint8_t>(i));
    CheckpointNote note;
    note.size = 100 + i;
    note.token = i;
    ASSERT_TRUE(queue.post_state(note));
  }
  EXPECT_FALSE(queue.idle());
  CheckpointNote note;
  for (std::uint64_t i = 0; i < kBurst; ++i) {
    ASSERT_TRUE(queue.fetch(note));
    EXPECT_EQ(note.token, i);
    const auto bytes = queue.buffer(note.buffer).first(note.size);
    EXPECT_EQ(std::count(bytes.begin(), bytes.end(), static_cast<std::uint8_t>(i)),
              static_cast<std::ptrdiff_t>(100 + i));
    queue.give_back(note.buffer);
  }
  EXPECT_FALSE(queue.fetch(note));
  EXPECT_TRUE(queue.idle());
}

TEST_F(CheckpointFolder, OfAServerThatWasKilledIsTakenUpOnce) {
  const auto state = ploughed(5, 9);
  keep_and_die(state, 3);
  Rig a(folder), b(folder);
  const auto got = a.ask(5, 9);
  ASSERT_TRUE(got);
  EXPECT_EQ(got->tip.slave->state_hash(), state.tip.slave->state_hash());
  EXPECT_EQ(got->record.checkpoints, 3u);
  EXPECT_TRUE(got->record.restored);
  EXPECT_FALSE(b.ask(5, 9)) << "its holder lives";
  EXPECT_FALSE(a.ask(5, 9)) << "its own worker has it already";
}

TEST_F(CheckpointFolder, OfSeveralServersThatWantItExactlyOneGetsIt) {
  for (std::uint64_t token = 100; token < 110; ++token) {
    const auto state = ploughed(token, 9, 20);
    token % 2 == 0 ? keep_and_die(state, 3) : [&] {
      Rig first(folder);
      first.keep(state, 3, CheckpointNote::Kind::kHandOut);
    }();
    std::vector<std::unique_ptr<Rig>> rigs;
    for (int i = 0; i < 4; ++i) rigs.push_back(std::make_unique<Rig>(folder));
    std::atomic<int> got{0};
    std::atomic<bool> go{false};
    {
      std::vector<std::jthread> threads;
      for (auto& rig : rigs)
        threads.emplace_back([&, r = rig.get()] {
          while (!go) std::this_thread::yield();
          if (r->ask(token, 9)) ++got;
        });
      go = true;
    }
    EXPECT_EQ(got, 1) << token;
  }
}

TEST_F(CheckpointFolder, SomebodyElsesOfAnotherSceneOrTooOldIsNot) {
  const auto state = ploughed(5, 9, 20);
  keep_and_die(state, 3);
  {
    Rig rig(folder);
    EXPECT_FALSE(rig.ask(5, 8)) << "another key's";
    EXPECT_FALSE(rig.ask(6, 9)) << "another token";
    EXPECT_TRUE(rig.said.empty()) << rig.said;
  }
  {
    Rig rig(folder, {0x1234, 1});
    EXPECT_FALSE(rig.ask(5, 9));
    EXPECT_NE(rig.said.find("physics version"), std::string::npos) << rig.said;
  }
  {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    Rig rig(folder, kOf, 20);
    EXPECT_FALSE(rig.ask(5, 9)) << "older than a silent session may become";
  }
  Rig rig(folder);
  EXPECT_TRUE(rig.ask(5, 9)) << "nothing of that has cost its station the session";
}

TEST_F(CheckpointFolder, WhatIsNotWholeIsSaidAndLeft) {
  keep_and_die(ploughed(5, 9, 20), 3);
  const fs::path path = session();
  const auto size = fs::file_size(path);
  for (const auto left : {std::uintmax_t{0}, std::uintmax_t{1}, std::uintmax_t{47}, size / 2, size - 1}) {
    fs::resize_file(path, left);
    Rig rig(folder);
    EXPECT_FALSE(rig.ask(5, 9)) << left;
    EXPECT_NE(rig.said.find("is not a complete checkpoint"), std::string::npos) << rig.said;
    EXPECT_EQ(std::count(rig.said.begin(), rig.said.end(), '\n'), 1);
    EXPECT_TRUE(fs::exists(path));
  }
  fs::remove(path);
  fs::create_symlink("/dev/zero", path);
  Rig rig(folder);
  EXPECT_FALSE(rig.ask(5, 9)) << "no plain file";
}

TEST_F(CheckpointFolder, AnOldCopyIsWorthNothing) {
  keep_and_die(ploughed(5, 9, 20), 3);
  const fs::path first = session();
  const fs::path copy = fs::path(folder) / "copy";
  fs::copy_file(first, copy);
  const std::string nobody = first.string().substr(0, first.string().size() - 16) + std::string(16, '0');
  {
    Rig rig(folder);
    ASSERT_TRUE(rig.ask(5, 9));
    fs::copy_file(copy, nobody);
    Rig other(folder);
    EXPECT_FALSE(other.ask(5, 9)) << "put back while another server has the session";
    rig.keep(ploughed(5, 9, 40), 4, CheckpointNote::Kind::kState);
  }
  // That one is gone too: of the two the newer counts, and the copy goes.
  Rig rig(folder);
  const auto got = rig.ask(5, 9);
  ASSERT_TRUE(got);
  EXPECT_EQ(got->record.checkpoints, 4u);
  EXPECT_EQ(got->tip.slave->state_hash(), ploughed(5, 9, 40).tip.slave->state_hash());
  EXPECT_FALSE(fs::exists(nobody));
  // Over is over.
  CheckpointNote over;
  over.kind = CheckpointNote::Kind::kEnded;
  over.token = 5;
  over.owner = 9;
  over.number = 9;
  rig.queue.post(over);
  EXPECT_FALSE(rig.ask(5, 9));
  fs::copy_file(copy, nobody);
  EXPECT_FALSE(rig.ask(5, 9)) << "its station said Bye";
  Rig other(folder);
  EXPECT_FALSE(other.ask(5, 9));
}

TEST_F(CheckpointFolder, WhoIsBelievedDeadLetsTheSessionGo) {
  const auto state = ploughed(5, 9, 20);
  Rig slow(folder);
  slow.keep(state, 1);
  // As after a file system that lost the lock.
  for (const fs::path& lock : files(".lock")) fs::remove(lock);
  Rig other(folder);
  ASSERT_TRUE(other.ask(5, 9));
  slow.keep(state, 2);
  EXPECT_FALSE(slow.ask(6, 9));
  EXPECT_EQ(slow.taken, 1) << "its worker is told";
  slow.keep(state, 3);
  slow.keep(state, 4, CheckpointNote::Kind::kHandOut);
  Rig third(folder);
  EXPECT_FALSE(third.ask(5, 9)) << "what the old holder still says makes no second one";
}

TEST_F(CheckpointFolder, HandedOutOrGivenBackItIsTheNextOnesAtOnce) {
  Rig a(folder), b(folder);
  a.keep(ploughed(5, 9, 20), 1, CheckpointNote::Kind::kHandOut);
  ASSERT_TRUE(b.ask(5, 9));
  CheckpointNote back;
  back.kind = CheckpointNote::Kind::kGiveBack;
  back.token = 5;
  back.owner = 9;
  back.number = 2;
  b.queue.post(back);
  EXPECT_FALSE(b.ask(1, 1));  // behind the note
  EXPECT_TRUE(a.ask(5, 9));
}

TEST_F(CheckpointFolder, WhoDrainsTakesNoneUpAndStillGivesItsOwnAway) {
  keep_and_die(ploughed(5, 9, 20), 3);
  Rig ends(folder), stays(folder);
  ends.keep(ploughed(6, 9, 20), 1);
  ends.drain = true;
  EXPECT_FALSE(ends.ask(5, 9));
  ends.keep(ploughed(6, 9, 20), 2, CheckpointNote::Kind::kHandOut);
  EXPECT_TRUE(stays.ask(5, 9)) << "asking has cost its station nothing";
  EXPECT_TRUE(stays.ask(6, 9));
}

/// The surfaces' own nodes, not the hash that is taken of them: marks, heaps and the height that lies beside the
/// coefficients at each node. Both then go on alike.
TEST(Checkpoint, CarriesEveryNodeOfTheSurface) {
  server::SessionState a = ploughed(5, 9, 900);
  const auto b = server::read_checkpoint(kOf, bytes_of(a), fresh());
  ASSERT_TRUE(b);
  const auto surface = [](const slave::Slave& slave) -> const physics::SplineSurface& {
    return *dynamic_cast<const slave::NveSlave&>(slave).marked_surface();
  };
  const auto unequal = [&] {
    const auto& one = surface(*a.tip.slave);
    const auto& other = surface(*b->tip.slave);
    int count = 0;
    for (int row = 0; row < one.rows(); ++row)
      for (int column = 0; column < one.columns(); ++column)
        count += one.node(column, row) == other.node(column, row) ? 0 : 1;
    return count;
  };
  const physics::SplineSurface& scan = dynamic_cast<const physics::SplineSurface&>(*sample()->surface);
  EXPECT_NE(scan.heights().z_nm, surface(*a.tip.slave).heights().z_nm) << "there are marks";
  EXPECT_EQ(unequal(), 0);
  const Vec3 from = a.tip.output.commanded_pos_w_nm;
  for (int i = 1; i <= 400; ++i) {
    slave::SlaveInput input;
    input.follow = input.wanted = true;
    input.tip_target_pos_w_nm = from + Vec3(0.05 * i, 0.03 * i, -0.01 * i);
    a.tip.slave->step(input, 1e-3, a.tip.output);
    b->tip.slave->step(input, 1e-3, b->tip.output);
  }
  EXPECT_EQ(unequal(), 0) << "where they have pressed since, too";
}

// After a kill all sessions of a server come at once: one line tells of the first, few of the rest, and they add up.
TEST_F(CheckpointFolder, ManyAreTakenUpWithFewLines) {
  constexpr std::uint64_t kMany = 40;
  {
    Rig first(folder);
    for (std::uint64_t token = 1; token <= kMany; ++token)
      first.keep(ploughed(token, 9, 1), 3, CheckpointNote::Kind::kHandOut);
  }
  std::vector<std::string> told;
  double took_s = 0;
  {
    Rig rig(folder);
    rig.told = &told;
    const auto begin = std::chrono::steady_clock::now();
    for (std::uint64_t token = 1; token <= kMany; ++token) ASSERT_TRUE(rig.ask(token, 9)) << token;
    took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  }
  ASSERT_FALSE(told.empty());
  EXPECT_TRUE(told.front().starts_with("took up a session of another server, ")) << told.front();
  EXPECT_LE(static_cast<double>(told.size()), 3 + took_s);
  std::uint64_t sum = 0;
  for (const std::string& line : told) {
    std::uint64_t count = 1;
    std::sscanf(line.c_str(), "took up %" SCNu64 " sessions of another server, at most", &count);
    sum += count;
  }
  EXPECT_EQ(sum, kMany) << "the last line too";
}

// Who asks for a session does not wait until all states of others are written; but what let a session go before is
// done first, so that whoever has heard of it gets it.
TEST_F(CheckpointFolder, AQuestionWaitsForNoStatesOfOthersAndForWhatLetItGo) {
  keep_and_die(ploughed(5, 9, 20), 3);
  const auto other = ploughed(6, 9, 1);
  server::WorkerMail mail(1, true);
  const auto written = [&] {
    std::ptrdiff_t n = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
      n += entry.is_regular_file() && entry.path().filename().string().size() == 33 ? 1 : 0;
    return n;
  };
  std::ptrdiff_t written_then = -1;  // when the keeper makes a slave for what it takes up
  const auto make_slave = [&] {
    if (written_then < 0) written_then = written();
    return fresh();
  };
  app::CheckpointKeeper keeper(
      {folder, kOf, make_slave, 30'000, [](const std::string&) {}, [](const std::string&) {}}, mail);
  written_then = -1;  // it has looked at one to begin with
  server::CheckpointQueue& queue = keeper.add_queue();
  const auto bytes = bytes_of(other);
  const auto post = [&](std::uint64_t token, std::uint64_t number, CheckpointNote::Kind kind) {
    const auto out = queue.next_buffer();
    if (out.empty()) return false;
    std::copy(bytes.begin(), bytes.end(), out.begin());
    CheckpointNote note;
    note.kind = kind;
    note.size = bytes.size();
    note.token = token;
    note.owner = 9;
    note.number = number;
    return queue.post_state(note);
  };
  const auto ask = [&](std::uint64_t token) {
    server::HandoffMessage question;
    question.token = token;
    question.owner = 9;
    return mail.post(1, question);
  };
  const auto answer = [&] {
    server::HandoffMessage message;
    while (!mail.fetch(0, message)) std::this_thread::yield();
    return std::unique_ptr<server::SessionState>(message.state);
  };
  // All before the keeper runs: many states, then the question.
  int states = 0;
  while (post(100 + static_cast<std::uint64_t>(states), 1, CheckpointNote::Kind::kState)) ++states;
  ASSERT_GT(states, 2);
  ASSERT_TRUE(ask(5));
  EXPECT_FALSE(queue.lets_go());
  keeper.start();
  ASSERT_TRUE(answer());
  EXPECT_EQ(written_then, 2) << "behind the first of " << states << " states, beside the session itself";
  while (!queue.idle()) std::this_thread::yield();
  EXPECT_EQ(written(), states + 1);
  // Let go among other states, and asked for by who knows of it: there.
  const auto own = ploughed(7, 9, 1);
  const auto own_bytes = bytes_of(own);
  for (std::uint64_t round = 1; round <= 20; ++round) {
    ASSERT_TRUE(post(100, 1 + round, CheckpointNote::Kind::kState));
    auto out = queue.next_buffer();
    while (out.empty()) {
      std::this_thread::yield();
      out = queue.next_buffer();
    }
    std::copy(own_bytes.begin(), own_bytes.end(), out.begin());
    CheckpointNote note;
    note.kind = CheckpointNote::Kind::kHandOut;
    note.size = own_bytes.size();
    note.token = 7;
    note.owner = 9;
    note.number = 10 * round;
    ASSERT_TRUE(queue.post_state(note));
    ASSERT_TRUE(ask(7));
    ASSERT_TRUE(answer()) << round;
    while (!queue.idle()) std::this_thread::yield();
  }
  EXPECT_FALSE(queue.lets_go());
}

TEST_F(CheckpointFolder, MustBeThisUsersAlone) {
  ::chmod(folder.c_str(), 0755);
  EXPECT_THROW(app::CheckpointKeeper::require_folder(folder), UserError);
  ::chmod(folder.c_str(), 0700);
  EXPECT_NO_THROW(app::CheckpointKeeper::require_folder(folder));
  EXPECT_THROW(app::CheckpointKeeper::require_folder(folder + "/none"), UserError);
}

}  // namespace
}  // namespace telenano

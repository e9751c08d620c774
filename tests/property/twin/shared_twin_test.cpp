// A shared tip with a twin: the holder predicts, the others see the server's truth, and when the tip goes from
// one to another neither hand nor tip makes a step. The oracle is the server's slave, recorded at its own port,
// and the force that the server says for the step of the same number.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tests/property/twin/felt_run.h"

namespace telenano::support {
namespace {

using control::Method;
using net::Rights;
using station::Mode;
using station::TwinState;

/// The one slave, and how far its commanded place goes in a step.
struct Watched {
  double furthest_nm = 0;
  double energy_in_aj = 0;
  Vec3 commanded_w_nm = Vec3::Zero();
  bool retracts = false;
  std::shared_ptr<const surface::HeightView> heights;  ///< of the server's own sample
};

class WatchedSlave final : public slave::Slave {
 public:
  WatchedSlave(std::shared_ptr<const scene::Scene> scene, std::shared_ptr<Watched> watched)
      : slave_(std::move(scene)), watched_(std::move(watched)) {
    watched_->heights = slave_.heights();
  }
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    const Vec3 before = output.commanded_pos_w_nm;
    slave_.step(input, dt_s, output);
    watched_->furthest_nm = std::max(watched_->furthest_nm, (output.commanded_pos_w_nm - before).norm());
    watched_->commanded_w_nm = output.commanded_pos_w_nm;
    watched_->energy_in_aj = output.energy_in_aj;
    watched_->retracts = input.retract;
  }
  const slave::SlaveLimits& limits() const noexcept override { return slave_.limits(); }
  std::uint64_t state_hash() const noexcept override { return slave_.state_hash(); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return slave_.save(out); }
  std::size_t snapshot_bytes_max() const noexcept override { return slave_.snapshot_bytes_max(); }

 private:
  slave::NveSlave slave_;
  std::shared_ptr<Watched> watched_;
};

/// One operator: what is felt, and how that compares with what the server says of the same step.
struct Operator {
  VirtualSessionConfig config;
  std::unique_ptr<VirtualSession> session;
  double steepest_n = 0;  ///< of the hand's force, from tick to tick
  double most_n = 0;
  Vec3 last_n = Vec3::Zero();
  std::map<std::uint64_t, Vec3> felt_nn;  ///< by step, where it is felt in full
  double wrong = 0, right = 0;
  std::size_t compared = 0;

  /// From here on: steepest_n without what the sample itself did before (a snap-in is a step).
  void watch_steps() { steepest_n = 0; }
  void step() {
    session->step();
    const station::StationTrace& t = session->loop().trace();
    steepest_n = std::max(steepest_n, (t.commanded_force_h_n - last_n).norm());
    last_n = t.commanded_force_h_n;
    most_n = std::max(most_n, last_n.norm());
    const double to_n = session->station().config().scaling.hand_force_n(Vec3::UnitX()).x();
    if (t.mode == Mode::kEngaged && t.method == Method::kTwin && t.ramp >= 1 && t.twin != TwinState::kApart)
      felt_nn[session->client().next_step() - 1] = t.rendered_force_h_n / to_n;
    if (!session->client().has_reply()) return;
    const link::Reply& reply = session->client().reply();
    if (reply.tip.hold == 0) felt_nn.clear();
    const auto felt = felt_nn.find(reply.steps.executed);
    if (felt == felt_nn.end()) return;
    wrong += (felt->second - reply.force_w_nn).squaredNorm();
    right += reply.force_w_nn.squaredNorm();
    ++compared;
    felt_nn.erase(felt_nn.begin(), std::next(felt));
  }
  double nrmse() const { return right > 0 ? std::sqrt(wrong / right) : 1; }
  const station::TwinRun& twin() { return *session->station().twin(); }
  bool holds() { return session->station().holds_tip() && session->client().has_reply(); }
  bool agrees() { return twin().state() == TwinState::kBehind || twin().state() == TwinState::kConfirmed; }
};

struct Both {
  Both(const std::string& scene_name, const Link& link,
       const std::function<void(VirtualSessionConfig&)>& change = {})
      : scene(deployed(scene_name)), way(link) {
    a.config = of(1001, Rights::kOperate);
    if (change) change(a.config);
    a.config.script = {{0, {0, 0, z0()}}, {0.8, {0, 0, deep()}}, {20, {30, 3, deep()}}};
    a.session = std::make_unique<VirtualSession>(a.config);
  }
  VirtualSessionConfig of(std::uint16_t port, Rights rights) const {
    VirtualSessionConfig config = session_config(scene, way, std::make_shared<ExecutedLog>());
    config.make_slave = [scene = scene, watched = watched] {
      return std::make_unique<WatchedSlave>(scene, watched);
    };
    config.share = server::Share::kOneTip;
    config.port = port;
    config.seed = port;
    config.standing.rights = rights;
    return config;
  }
  double z0() const { return scene->start_apex_w_nm.z() - scene->start_touch_w_nm; }
  double deep() const { return scene->particle ? 4 : scene->marks ? -8 : -5; }
  /// Another operator, who comes later; its hand moves from where it takes the tip up.
  void join(Operator& who, std::uint16_t port, Rights rights,
            const std::function<void(VirtualSessionConfig&)>& change = {}) {
    who.config = of(port, rights);
    who.config.server = a.session->shared_server();
    who.config.start_ns = a.session->now_ns();
    who.config.script = {{0, {0, 0, deep()}}, {1, {5, 0, deep() - 1.5}}, {20, {40, 4, deep() - 1.5}}};
    if (change) change(who.config);
    who.session = std::make_unique<VirtualSession>(who.config);
    // Its handshake took some ticks; one server has one time.
    while (a.session->now_ns() < who.session->now_ns()) a.step();
    all.push_back(&who);
  }
  void steps(int n) {
    for (int i = 0; i < n; ++i)
      for (Operator* who : all) who->step();
  }
  std::shared_ptr<const scene::Scene> scene;
  Link way;
  std::shared_ptr<Watched> watched = std::make_shared<Watched>();
  Operator a, b, c;
  std::vector<Operator*> all{&a};
};

// In a tick: 20 N/s where a state is taken up, and what the hands' own motions do on up to 1000 N/m, 30 mm/s.
constexpr double kSteepest_n = 0.02 + 0.03;

class SharedTwin : public ::testing::TestWithParam<std::string> {};

TEST_P(SharedTwin, TakenOverAndHandedBackWhilePressedIsTheTruthWithoutAStep) {
  for (const Link& link : {Link{40, 0, 0, 0}, Link{200, 0.02, 5, 0.02}}) {
    SCOPED_TRACE(GetParam() + " at " + std::to_string(link.rtt_ms));
    Both both(GetParam(), link);
    Operator &a = both.a, &b = both.b;
    both.steps(2500);
    ASSERT_TRUE(a.holds());
    ASSERT_TRUE(a.agrees()) << station::twin_state_name(a.twin().state());
    ASSERT_EQ(a.session->station().mode(), Mode::kEngaged);
    EXPECT_GT(a.most_n, both.scene->particle ? 0.002 : 0.05);
    both.join(b, 1002, Rights::kAdminister);
    both.steps(600);
    EXPECT_EQ(b.twin().state(), TwinState::kWaits);
    EXPECT_EQ(b.twin().snapshots(), 0u) << "who observes needs no state";
    EXPECT_EQ(b.most_n, 0) << "nor feels anything";
    const Vec3 seen_nn = b.session->client().reply().force_w_nn;
    EXPECT_GT(seen_nn.norm(), 0.05);
    EXPECT_LT((seen_nn - a.session->client().reply().force_w_nn).norm(), 0.05 * seen_nn.norm())
        << "but sees the server's truth, of a tick or two before";

    // b takes it while a presses, and a's twin is ahead by the way.
    both.watched->furthest_nm = 0;
    a.watch_steps();
    b.session->loop().set_tip_wish(link::kFlagTakeOver);
    int engaged_after = 0;
    while (b.session->station().mode() != Mode::kEngaged && engaged_after < 3000) {
      both.steps(1);
      ++engaged_after;
    }
    EXPECT_LE(both.watched->furthest_nm, 0.2) << "hands of 50 nm/s make 0.05 nm in a tick";
    EXPECT_TRUE(b.holds());
    EXPECT_FALSE(a.holds());
    // It says so within 10 ms, hears that it holds the tip, asks for the state and has it: two round trips, a
    // third where the state has more pieces than the first guess, and of marks 2000 pieces a second; what is
    // lost is asked again.
    const double pieces =
        static_cast<double>(b.session->client().snapshot().data().size()) / link::kSnapshotPieceBytes;
    EXPECT_LE(engaged_after, 3 * link.rtt_ms + 15 + 0.55 * pieces + (link.loss > 0 ? 3 * link.rtt_ms : 0));
    both.steps(3000);
    EXPECT_EQ(a.last_n.norm(), 0) << "faded";
    EXPECT_EQ(a.twin().state(), TwinState::kWaits);
    EXPECT_TRUE(b.agrees()) << station::twin_state_name(b.twin().state());
    EXPECT_EQ(b.session->station().method(), Method::kTwin);
    EXPECT_GE(b.twin().snapshots(), 1u);
    EXPECT_GT(b.most_n, both.scene->particle ? 0.01 : 0.02);
    EXPECT_GT(b.compared, 200u);

    // And back.
    b.session->loop().set_tip_wish(link::kFlagHandOver);
    a.session->loop().set_tip_wish(link::kFlagTakeOver);
    both.steps(3000);
    EXPECT_TRUE(a.holds());
    EXPECT_FALSE(b.holds());
    EXPECT_TRUE(a.agrees()) << station::twin_state_name(a.twin().state());
    EXPECT_EQ(a.session->station().mode(), Mode::kEngaged);
    EXPECT_EQ(b.last_n.norm(), 0);
    EXPECT_EQ(b.twin().state(), TwinState::kWaits);
    EXPECT_LE(both.watched->furthest_nm, 0.2);
    for (Operator* who : both.all) {
      EXPECT_LE(who->steepest_n, kSteepest_n);
      EXPECT_LT(who->nrmse(), 1e-12) << "felt is what the server says of that step";
      EXPECT_FALSE(who->twin().given_up());
      EXPECT_EQ(who->twin().reason(), std::uint32_t{link::kBreakHolder}) << "and no other parting";
    }
    std::printf(
        "%s at %3.0f ms: b engaged %d ms after it asked, %zu bytes; compared %zu and %zu steps; steepest "
        "%.4f N, %.4f N\n",
        GetParam().c_str(), link.rtt_ms, engaged_after, b.session->client().snapshot().data().size(),
        a.compared, b.compared, a.steepest_n, b.steepest_n);
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, SharedTwin,
                         ::testing::Values("flat_silicon_oxide", "flat_pdms", "flakes", "humid_flakes",
                                           "particle", "lithography"),
                         [](const auto& scene) { return scene.param; });

// The holder presses and may no longer: nothing that is on its way moves the tip, its force fades, and it
// comes back with the state of then when the right does.
TEST(SharedTwinHostile, ARightTakenAwayWhilePressing) {
  Both both("flakes", Link{100, 0, 0, 0});
  Operator& a = both.a;
  both.steps(2500);
  ASSERT_TRUE(a.agrees());
  a.session->set_standing({true, Rights::kObserve});
  a.watch_steps();
  both.watched->furthest_nm = 0;
  both.steps(1);
  const Vec3 there = both.watched->commanded_w_nm;
  both.steps(300);
  EXPECT_FALSE(a.holds());
  EXPECT_LE((both.watched->commanded_w_nm - there).norm(), 0.1);
  EXPECT_EQ(a.last_n.norm(), 0);
  EXPECT_EQ(a.twin().state(), TwinState::kWaits);
  // Back before anybody withdraws the tip.
  a.session->set_standing({true, Rights::kOperate});
  a.session->loop().set_tip_wish(link::kFlagTakeOver);
  both.steps(1500);
  EXPECT_TRUE(a.holds());
  EXPECT_TRUE(a.agrees()) << station::twin_state_name(a.twin().state());
  EXPECT_EQ(a.session->station().mode(), Mode::kEngaged);
  EXPECT_LE(both.watched->furthest_nm, 0.2);
  EXPECT_LE(a.steepest_n, kSteepest_n);
  EXPECT_LT(a.nrmse(), 1e-12);
}

// A tip that its silent holder has left is withdrawn; two ask for it at once: one gets it, each from the
// server's own state, and who gets it next does too.
TEST(SharedTwinHostile, TwoTakeItAtOnceAfterItsHolderFellSilent) {
  Both both("flakes", Link{60, 0.02, 3, 0.05});
  Operator &a = both.a, &b = both.b, &c = both.c;
  both.steps(2000);
  both.join(b, 1002, Rights::kOperate);
  both.join(c, 1003, Rights::kOperate);
  while (b.session->now_ns() < c.session->now_ns()) b.step();
  both.steps(200);
  a.session->link().path_a_to_b().down = a.session->link().path_b_to_a().down = true;
  a.watch_steps();
  b.session->loop().set_tip_wish(link::kFlagTakeOver);
  c.session->loop().set_tip_wish(link::kFlagTakeOver);
  for (int i = 0; i < 4000; ++i) {
    both.steps(1);
    ASSERT_FALSE(b.holds() && c.holds() &&
                 b.session->client().reply().tip.hold == c.session->client().reply().tip.hold);
  }
  ASSERT_NE(b.holds(), c.holds());
  Operator& first = b.holds() ? b : c;
  Operator& second = b.holds() ? c : b;
  EXPECT_TRUE(first.agrees()) << station::twin_state_name(first.twin().state());
  EXPECT_EQ(second.twin().state(), TwinState::kWaits);
  EXPECT_EQ(second.most_n, 0);
  first.session->loop().set_tip_wish(link::kFlagHandOver);
  second.session->loop().set_tip_wish(0);
  both.steps(150);
  second.session->loop().set_tip_wish(link::kFlagTakeOver);
  both.steps(2500);
  EXPECT_TRUE(second.holds());
  EXPECT_TRUE(second.agrees()) << station::twin_state_name(second.twin().state());
  // The silent one comes back, observes, and has no twin of anything.
  a.session->link().path_a_to_b().down = a.session->link().path_b_to_a().down = false;
  both.steps(2500);
  EXPECT_FALSE(a.holds());
  EXPECT_EQ(a.twin().state(), TwinState::kWaits);
  EXPECT_EQ(a.last_n.norm(), 0);
  for (Operator* who : both.all) {
    EXPECT_LE(who->steepest_n, kSteepest_n);
    EXPECT_LT(who->compared > 0 ? who->nrmse() : 0, 1e-12);
    EXPECT_FALSE(who->twin().given_up());
  }
}

/// What a server tells one of its stations.
struct Liar {
  enum class Lie { kHash, kSnapshot, kOldSnapshot } lie = Lie::kHash;
  bool on = false;
  link::Codec codec;
  link::Incoming in;
  std::vector<link::SnapshotPiece> first;  ///< of the first state that it was told
  std::size_t operator()(std::span<std::uint8_t> bytes, std::size_t n) {
    if (codec.decode(bytes.first(n), in) != link::DropCause::kNone) return n;
    if (in.type == link::MessageType::kReply && on && lie == Lie::kHash && in.reply.steps.executed > 0) {
      in.reply.steps.state_hash ^= 1;
      return codec.encode(in.reply, bytes);
    }
    if (in.type != link::MessageType::kSnapshotPiece) return n;
    link::SnapshotPiece piece = in.snapshot_piece;
    if (!on) {
      first.push_back(piece);
      return n;
    }
    if (lie == Lie::kSnapshot) piece.data[piece.size / 2] ^= 0x10;
    if (lie == Lie::kOldSnapshot) {
      for (const link::SnapshotPiece& old : first) {
        if (old.piece != piece.piece) continue;
        const std::uint32_t id = piece.snapshot;
        piece = old;
        piece.snapshot = id;
      }
    }
    return codec.encode(piece, bytes);
  }
};

// Lies to one holder of two: the wrong hash, a state that is not what it says, the state of another's holding.
// Who is lied to is without a twin soon, never with a wrong one; the other is not concerned.
TEST(SharedTwinHostile, AServerThatLiesToOneHolderOnly) {
  for (const Liar::Lie lie : {Liar::Lie::kHash, Liar::Lie::kSnapshot, Liar::Lie::kOldSnapshot}) {
    SCOPED_TRACE(static_cast<int>(lie));
    const auto liar = std::make_shared<Liar>();
    liar->lie = lie;
    Both both("flat_silicon_oxide", Link{40, 0, 0, 0});
    Operator &a = both.a, &b = both.b;
    both.steps(1500);
    both.join(b, 1002, Rights::kAdminister, [&](VirtualSessionConfig& config) {
      config.lie = [liar](std::span<std::uint8_t> bytes, std::size_t n) { return (*liar)(bytes, n); };
    });
    const auto give = [&](Operator& to, Operator& from) {
      from.session->loop().set_tip_wish(0);
      to.session->loop().set_tip_wish(link::kFlagTakeOver);
      both.steps(1200);
    };
    give(b, a);
    ASSERT_TRUE(b.agrees());
    b.session->loop().set_tip_wish(link::kFlagHandOver);
    a.session->loop().set_tip_wish(link::kFlagTakeOver);
    both.steps(1200);
    ASSERT_TRUE(a.agrees());
    a.session->set_standing({true, Rights::kAdminister});
    liar->on = true;
    a.watch_steps();
    b.watch_steps();
    give(b, a);
    both.steps(4000);
    EXPECT_TRUE(b.holds());
    EXPECT_EQ(b.twin().state(), TwinState::kGivenUp);
    EXPECT_EQ(b.session->station().method(), Method::kModel);
    EXPECT_EQ(b.session->station().mode(), Mode::kEngaged) << "by another method";
    give(a, b);
    EXPECT_TRUE(a.holds());
    EXPECT_TRUE(a.agrees()) << station::twin_state_name(a.twin().state());
    for (Operator* who : both.all) {
      // The model, which follows the twin while it presses, brings its own stiffness in as fast as it is paid for.
      EXPECT_LE(who->steepest_n, lie == Liar::Lie::kHash ? 0.1 : kSteepest_n);
      const station::StationTrace& t = who->session->loop().trace();
      EXPECT_LT(t.energy_out_j - t.energy_in_j, who->session->station().config().allowance_j + 1e-3);
    }
    EXPECT_LT(a.nrmse(), 1e-12);
  }
}

// Resumed while it holds: what the old session's log still holds belongs to an earlier anchor.
TEST(SharedTwinSession, ResumedWhileHoldingItGoesOnFromTheTip) {
  const auto deaf = std::make_shared<bool>(false);
  Both both("flakes", Link{60, 0, 0, 0}, [&](VirtualSessionConfig& config) {
    config.lie = [deaf](std::span<std::uint8_t> bytes, std::size_t n) {
      return *deaf && bytes[5] == static_cast<std::uint8_t>(link::MessageType::kReply) ? 0 : n;
    };
  });
  Operator& a = both.a;
  both.steps(2000);
  ASSERT_TRUE(a.agrees());
  both.watched->furthest_nm = 0;
  a.watch_steps();
  const std::uint64_t sessions = a.session->client().sessions();
  *deaf = true;  // commands go on, but no reply comes: it says Hello again
  both.steps(350);
  *deaf = false;
  both.steps(1500);
  EXPECT_GT(a.session->client().sessions(), sessions);
  EXPECT_TRUE(a.holds());
  EXPECT_TRUE(a.agrees()) << station::twin_state_name(a.twin().state());
  EXPECT_EQ(a.session->station().mode(), Mode::kEngaged);
  EXPECT_LE(both.watched->furthest_nm, 0.2);
  EXPECT_LE(a.steepest_n, kSteepest_n);
  EXPECT_LT(a.nrmse(), 1e-12);
}

// A stop and its end: the slave withdraws and comes back, which is another holding.
TEST(SharedTwinSession, AStopAndItsEndAreWithoutAStepOfForce) {
  Both both("flakes", Link{60, 0, 0, 0});
  Operator& a = both.a;
  both.steps(2000);
  a.session->loop().set_buttons(device::kButtonStop);
  both.steps(600);
  EXPECT_TRUE(both.watched->retracts);
  EXPECT_EQ(a.last_n.norm(), 0);
  a.session->loop().set_buttons(0);
  const double up_nm = both.watched->commanded_w_nm.z();
  both.watched->furthest_nm = 0;
  a.session->station().clear_stop();
  both.steps(1500);
  EXPECT_TRUE(a.holds());
  EXPECT_TRUE(a.agrees()) << station::twin_state_name(a.twin().state());
  EXPECT_EQ(a.session->station().mode(), Mode::kEngaged);
  EXPECT_LE(both.watched->furthest_nm, 0.2) << "it goes on from where it stands";
  EXPECT_NEAR(both.watched->commanded_w_nm.z(), up_nm, 20);
  EXPECT_LE(a.steepest_n, 1.0) << "a stop takes the force away at once";
}

/// Where two views of one sample differ most, nm, and how deep `own` is below the scene's ground.
double furthest_nm(const surface::HeightView& own, const surface::HeightView& seen) {
  const surface::HeightGrid a = own.heights(), b = seen.heights();
  EXPECT_EQ(a.z_nm.size(), b.z_nm.size());
  double most = 0;
  for (std::size_t i = 0; i < std::min(a.z_nm.size(), b.z_nm.size()); ++i)
    most = std::max(most, std::abs(a.z_nm[i] - b.z_nm[i]));
  return most;
}

double lowest_nm(const surface::HeightView& view) {
  const surface::HeightGrid grid = view.heights();
  return *std::min_element(grid.z_nm.begin(), grid.z_nm.end());
}

// Somebody looks on while another ploughs: what a window draws and a recording keeps has the groove while it
// grows, half a second and a transfer late; a second one who comes later sees at once what was there before.
// Looking moves nothing, is no snapshot of a holding, and ends where nothing changes any more. The oracle is
// the server's own sample.
TEST(SharedTwinLooks, TheMarksOfAnotherAreSeenWhileTheyAreMade) {
  Both both("lithography", Link{40, 0.02, 3, 0.02});
  Operator &a = both.a, &b = both.b, &c = both.c;
  const auto looks = [](VirtualSessionConfig& config) { config.twin_look_s = 0.5; };
  both.steps(300);
  both.join(b, 1002, Rights::kObserve, looks);
  const surface::HeightView& own = *both.watched->heights;
  const double flat_nm = lowest_nm(own);
  int looked_at = 0;
  for (int second = 0; second < 5; ++second) {
    both.steps(1000);
    const double groove_nm = flat_nm - lowest_nm(own);
    if (second < 2) continue;
    ASSERT_GT(groove_nm, 1) << second;
    const surface::HeightView* const seen = b.twin().heights();
    ASSERT_NE(seen, nullptr) << second;
    ++looked_at;
    // Half a second and the transfer late, at 30 nm in 19 s: the deepest place has been seen by then.
    EXPECT_GT(flat_nm - lowest_nm(*seen), 0.7 * groove_nm) << second;
  }
  EXPECT_GE(looked_at, 3);
  both.join(c, 1003, Rights::kObserve, looks);
  int until_seen = 0;
  for (; c.twin().heights() == nullptr && until_seen < 3000; ++until_seen) both.steps(1);
  std::printf("who comes later has the marks after %d ms, %zu bytes\n", until_seen,
              c.session->client().snapshot().data().size());
  EXPECT_LT(until_seen, 1000);
  ASSERT_NE(c.twin().heights(), nullptr);
  EXPECT_GT(flat_nm - lowest_nm(*c.twin().heights()), 1);
  // Nothing moves any more: both have the whole of it, and ask for nothing.
  a.session->loop().set_buttons(device::kButtonStop);
  both.steps(4000);
  for (Operator* who : {&b, &c}) {
    EXPECT_LT(furthest_nm(own, *who->twin().heights()), 1e-4);
    EXPECT_FALSE(who->twin().wants_snapshot());
    EXPECT_EQ(who->twin().snapshots(), 0u);
    EXPECT_EQ(who->twin().partings(), 0u);
    EXPECT_EQ(who->twin().state(), TwinState::kWaits);
    EXPECT_EQ(who->most_n, 0);
  }
  EXPECT_EQ(a.twin().partings(), 0u);
}

// A machine that stood still for a second and a half while it looked has not found a slow link: it looks again in half a
// second, not in twelve.
TEST(SharedTwinLooks, AStandstillDoesNotPutOffTheNextLook) {
  Both both("lithography", Link{40, 0, 0, 0});
  both.steps(300);
  const std::int64_t begun_ns = both.a.session->now_ns();
  both.join(both.b, 1002, Rights::kObserve, [&](VirtualSessionConfig& config) {
    config.twin_look_s = 0.5;
    const auto codec = std::make_shared<link::Codec>();
    const auto in = std::make_shared<link::Incoming>();
    config.lie = [&both, begun_ns, codec, in](std::span<std::uint8_t> bytes, std::size_t n) {
      const bool piece = codec->decode(bytes.first(n), *in) == link::DropCause::kNone &&
                         in->type == link::MessageType::kSnapshotPiece;
      return piece && both.a.session->now_ns() - begun_ns < 1'500'000'000 ? std::size_t{0} : n;
    };
  });
  const surface::HeightView& own = *both.watched->heights;
  const double flat_nm = lowest_nm(own);
  both.steps(2000);
  const surface::HeightView* const seen = both.b.twin().heights();
  ASSERT_NE(seen, nullptr);
  const double first_nm = flat_nm - lowest_nm(*seen);
  both.steps(2000);
  const double groove_nm = flat_nm - lowest_nm(own);
  ASSERT_GT(groove_nm, 1.3 * first_nm);
  EXPECT_GT(flat_nm - lowest_nm(*seen), 0.7 * groove_nm);
}

// Who looks on and then takes the tip has it as soon as one who did not look on, whatever was on its way.
TEST(SharedTwinLooks, TakingTheTipDoesNotWaitForALook) {
  for (int wait = 0; wait < 600; wait += 97) {
    Both both("lithography", Link{100, 0, 0, 0});
    Operator &a = both.a, &b = both.b;
    both.steps(2500);
    both.join(b, 1002, Rights::kAdminister, [](VirtualSessionConfig& config) { config.twin_look_s = 0.1; });
    both.steps(600 + wait);
    b.session->loop().set_tip_wish(link::kFlagTakeOver);
    int engaged_after = 0;
    while (b.session->station().mode() != Mode::kEngaged && engaged_after < 3000) {
      both.steps(1);
      ++engaged_after;
    }
    const double pieces =
        static_cast<double>(b.session->client().snapshot().data().size()) / link::kSnapshotPieceBytes;
    // As without (SharedTwin), and the tenth of a second after which a server freezes its state again.
    EXPECT_LE(engaged_after, 3 * 100 + 15 + 0.55 * pieces + 150) << wait;
    both.steps(1500);
    EXPECT_TRUE(b.agrees()) << station::twin_state_name(b.twin().state());
    EXPECT_LT(b.nrmse(), 1e-12);
    EXPECT_FALSE(a.holds());
  }
}

// A station of before there was a log at a shared tip asks for no bit 9: it gets the shared tip as ever.
TEST(SharedTwinSession, AnOlderStationGetsNoLog) {
  for (const std::uint64_t without : {std::uint64_t{link::kFeatureSharedLog}, std::uint64_t{0}}) {
    link::ServerHandshakeConfig config;
    config.required_bits = link::kFeatureSharing;
    link::ServerHandshake handshake(config);
    link::SessionTableConfig table_config;
    table_config.capacity = 2;
    link::SessionTable table(table_config, {1, 2});
    link::Hello hello;
    hello.nonce = 5;
    hello.feature_bits = link::kKnownFeatures & ~without;
    link::HelloContext proven;
    proven.address_proven = true;
    const auto verdict = handshake.on_hello(hello, {}, 1, table, proven);
    ASSERT_EQ(verdict.kind, link::HelloVerdict::Kind::kOpen);
    const std::uint64_t granted = table[verdict.slot].feature_bits;
    EXPECT_EQ((granted & link::kFeatureStepLog) != 0, without == 0);
    EXPECT_EQ((granted & link::kFeatureSharedLog) != 0, without == 0);
    EXPECT_NE(granted & link::kFeatureSharing, 0u);
  }
}

}  // namespace
}  // namespace telenano::support

// Twins that are wrong on purpose. One whose state is another one than the server's must be found out by the
// hashes: it parts, and is given up. One whose state is right and whose force is not must be found out by
// what is felt against the executed log; so must an account that does not know the sample's well. The right one
// is found right by the same measures.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "telenano/common/control/methods.h"
#include "telenano/common/link/codec.h"
#include "telenano/common/link/step_log.h"
#include "telenano/master/twin/scene_twin.h"
#include "telenano/nve_server/slave/logged_step.h"
#include "tests/property/twin/felt_run.h"
#include "tests/support/changed_news_method.h"

namespace telenano::support {
namespace {

constexpr double kAsked = 0.02;  // NRMSE that the twin promises

enum class Wrong {
  kNothing,
  // Of the state:
  kTimeStep,    ///< each step lasts a microsecond
  kStepLost,    ///< every 300th is not made, and nobody is told
  kGroundLow,   ///< the ground 3 nm too low
  kNotTakenUp,  ///< a snapshot's state (marks, particle, all) is not taken up
  kAnyHold,     ///< of a shared tip: each step moves it, whatever holding it belongs to
  // Of the force:
  kZero,
  kHalf,
  kLate,        ///< by 100 ticks
  kNoAdhesion,  ///< never pulls down
  kNoFriction,  ///< nothing along the ground
  kTilted,      ///< turned by 10° about y
  kSoft,        ///< 0.3 of it in repulsion
  kReversed     ///< x the wrong way round
};

class WrongTwin final : public control::LocalSlave {
 public:
  WrongTwin(std::shared_ptr<const scene::Scene> scene, Wrong wrong) : twin_(std::move(scene)), wrong_(wrong) {
    past_.fill(Vec3::Zero());
  }

  void step(const control::LocalStep& given, control::LocalAnswer& answer) noexcept override {
    control::LocalStep step = given;
    ++count_;
    if (wrong_ == Wrong::kTimeStep) step.dt_s = 1e-6;
    if (wrong_ == Wrong::kGroundLow) step.target_w_nm.z() += 3;
    if (wrong_ == Wrong::kAnyHold) step.operates = true;
    if (wrong_ == Wrong::kStepLost && count_ % 300 == 0) {
      answer = right_;
    } else {
      twin_.step(step, right_);
      answer = right_;
    }
    Vec3& f = answer.force_w_nn;
    switch (wrong_) {
      case Wrong::kZero:
        f.setZero();
        break;
      case Wrong::kHalf:
        f *= 0.5;
        break;
      case Wrong::kLate:
        std::swap(f, past_[count_ % past_.size()]);
        break;
      case Wrong::kNoAdhesion:
        f.z() = std::max(f.z(), 0.0);
        break;
      case Wrong::kNoFriction:
        f.x() = f.y() = 0;
        break;
      case Wrong::kTilted:
        f = Vec3(0.984807753 * f.x() + 0.173648178 * f.z(), f.y(), 0.984807753 * f.z() - 0.173648178 * f.x());
        break;
      case Wrong::kSoft:
        if (f.z() > 0) f *= 0.3;
        break;
      case Wrong::kReversed:
        f.x() = -f.x();
        break;
      default:
        break;
    }
  }
  std::uint64_t state_hash() const noexcept override { return twin_.state_hash(); }
  void reset() noexcept override { twin_.reset(); }
  bool load(std::span<const std::uint8_t> bytes, control::LocalAnswer& answer) noexcept override {
    if (wrong_ != Wrong::kNotTakenUp) return twin_.load(bytes, answer);
    twin_.reset();
    return true;
  }
  std::size_t snapshot_bytes_max() const noexcept override { return twin_.snapshot_bytes_max(); }
  double well_aj() const noexcept override { return twin_.well_aj(); }
  std::uint64_t scene_hash() const noexcept override { return twin_.scene_hash(); }

 private:
  twin::SceneTwin twin_;
  Wrong wrong_;
  std::uint64_t count_ = 0;
  control::LocalAnswer right_;
  std::array<Vec3, 100> past_;
};

Outcome with(const std::string& scene, Wrong wrong, const Link& link = {40, 0, 0, 0}) {
  return run(scene, link, 1.5, [&](VirtualSessionConfig& config) {
    config.make_twin = [&, served = config.scene] { return std::make_unique<WrongTwin>(served, wrong); };
  });
}

TEST(TwinMutants, TheRightOneIsFoundRight) {
  for (const char* const scene : {"flakes", "lithography", "particle", "flat_pdms"}) {
    const Outcome out = with(scene, Wrong::kNothing);
    EXPECT_LT(out.nrmse, 1e-12) << scene;
    EXPECT_EQ(out.partings, 0u) << scene;
  }
}

// What a step leaves for later ones has to be wrong for it to be seen: marks, friction.
TEST(TwinMutants, AnotherStateIsFoundByItsHash) {
  for (const Wrong wrong : {Wrong::kTimeStep, Wrong::kStepLost, Wrong::kGroundLow}) {
    for (const char* const scene : {"lithography", "particle"}) {
      const Outcome out = with(scene, wrong);
      EXPECT_GT(out.partings, 0u) << scene << ' ' << static_cast<int>(wrong);
    }
  }
}

TEST(TwinMutants, AnotherForceIsFoundByWhatIsFelt) {
  for (const Wrong wrong : {Wrong::kZero, Wrong::kHalf, Wrong::kLate, Wrong::kNoAdhesion, Wrong::kNoFriction,
                            Wrong::kTilted, Wrong::kSoft, Wrong::kReversed}) {
    const Outcome out = with("lithography", wrong);
    EXPECT_GT(out.nrmse, kAsked) << static_cast<int>(wrong);
    EXPECT_EQ(out.partings, 0u) << static_cast<int>(wrong) << ": no hash would have found it";
  }
}

/// What the server says of its log or its state, made wrong on its way.
class Changed {
 public:
  using Change = std::function<void(link::Incoming&)>;
  explicit Changed(Change change) : change_(std::move(change)) {}
  std::size_t operator()(std::span<std::uint8_t> out, std::size_t size) {
    if (codec_.decode(out.first(size), in_) != link::DropCause::kNone) return size;
    change_(in_);
    std::size_t changed = 0;
    if (in_.type == link::MessageType::kReply) changed = codec_.encode(in_.reply, out);
    if (in_.type == link::MessageType::kSnapshotPiece) changed = codec_.encode(in_.snapshot_piece, out);
    return changed > 0 ? changed : size;
  }

 private:
  Change change_;
  link::Codec codec_;
  link::Incoming in_;
};

/// One parting, in the middle of the touch, by a hash that is wrong for one reply.
Outcome parted(const std::string& scene, Wrong wrong, std::uint64_t snapshot_late) {
  bool done = false;
  return run(scene, {40, 0, 0, 0}, 1.5, [&](VirtualSessionConfig& config) {
    config.make_twin = [wrong, served = config.scene] { return std::make_unique<WrongTwin>(served, wrong); };
    config.lie = [changed = std::make_shared<Changed>([&done, snapshot_late](link::Incoming& in) {
                    if (in.type == link::MessageType::kReply && !done && in.reply.steps.executed > 2500) {
                      in.reply.steps.state_hash ^= 1;
                      done = true;
                    }
                    if (in.type == link::MessageType::kSnapshotPiece) in.snapshot_piece.step += snapshot_late;
                  })](std::span<std::uint8_t> out, std::size_t size) { return (*changed)(out, size); };
  });
}

TEST(TwinMutants, ASnapshotThatIsNotTakenUpOrComesAStepLateIsFound) {
  for (const char* const scene : {"lithography", "particle"}) {
    const Outcome right = parted(scene, Wrong::kNothing, 0);
    EXPECT_EQ(right.partings, 1u) << scene;
    EXPECT_NE(right.end, station::TwinState::kGivenUp) << scene;
    EXPECT_GT(parted(scene, Wrong::kNotTakenUp, 0).partings, 1u) << scene;
    EXPECT_GT(parted(scene, Wrong::kNothing, 1).partings, 1u) << scene;
  }
}

/// A shared tip is given back to its holder as another holding while steps of the last one are on their way: at
/// the server they move nothing. The station has them in its ring, and makes them after the server's state.
/// Returns the partings.
std::uint64_t partings_after_a_renewed_holding(Wrong wrong) {
  const auto scene = deployed("flakes");
  slave::NveSlave server(scene);
  slave::SlaveOutput output;
  output.commanded_pos_w_nm = output.tip_pos_w_nm = scene->start_apex_w_nm;
  Vec3 last = scene->start_apex_w_nm;
  const auto execute = [&](const link::LoggedStep& step, std::uint32_t holding) {
    const Vec3 to = link::target_w_nm(step);
    const bool was_up = (output.fault_bits & link::kFaultRetracted) != 0;
    server.step(slave::input_of(to, (to - last) / link::dt_s(step), step.flags, step.hold == holding, was_up),
                link::dt_s(step), output);
    last = to;
  };
  station::TwinRun twin({}, std::make_unique<WrongTwin>(scene, wrong),
                        std::make_unique<WrongTwin>(scene, wrong));
  link::StepReport report;
  report.state_hash = server.state_hash();
  std::int64_t now_ns = 0;
  std::vector<std::uint8_t> state(server.snapshot_bytes_max());
  const auto give_state = [&](std::uint64_t number) {
    const std::size_t size = server.save(state);
    twin.take_up(std::span(state).first(size), number, server.state_hash(), report.breaks, now_ns);
  };
  const double deep_nm = scene->start_apex_w_nm.z() - scene->start_touch_w_nm + 4;
  std::vector<link::LoggedStep> log(1);
  const auto make = [&](std::uint32_t holding) {
    const auto n = static_cast<double>(log.size());
    const Vec3 target = scene->start_apex_w_nm + Vec3(0.02 * n, 0, -deep_nm * std::min(1.0, n / 600));
    log.push_back(link::logged_step(target, link::kFlagClutch | link::kFlagDeadman, 1e-3));
    log.back().hold = holding;
    twin.step(log.size() - 1, log.back(), now_ns += 1'000'000);
  };
  const auto reply = [&](std::uint64_t executed) {
    report.executed = report.newest = executed;
    report.state_hash = server.state_hash();
    twin.on_reply(report, now_ns);
  };
  twin.begin(report, true, 0.5, now_ns, true);
  twin.hold(1);
  give_state(0);
  for (int i = 0; i < 700; ++i) make(1);
  for (std::uint64_t n = 1; n <= 600; ++n) execute(log[n], 1);
  reply(600);
  EXPECT_EQ(twin.state(), station::TwinState::kBehind);
  EXPECT_EQ(output.contact_state, link::ContactState::kContact);
  // Renewed; 100 steps of the first holding have not come yet.
  report.breaks = 1;
  report.break_reason = link::kBreakHolder;
  twin.hold(2);
  for (int i = 0; i < 20; ++i) make(2);
  give_state(600);
  for (int i = 0; i < 20; ++i) make(2);
  for (std::uint64_t n = 601; n < log.size(); ++n) execute(log[n], 2);
  reply(log.size() - 1);
  return twin.partings();
}

TEST(TwinMutants, OneThatMovesByStepsOfAnotherHoldingIsFound) {
  EXPECT_EQ(partings_after_a_renewed_holding(Wrong::kNothing), 0u);
  EXPECT_GT(partings_after_a_renewed_holding(Wrong::kAnyHold), 0u);
}

/// The method `twin` with an account that does not know the sample's well, or has its sign wrong.
class WrongAccount final : public ChangedNewsMethod {
 public:
  explicit WrongAccount(double times) : ChangedNewsMethod(control::Method::kTwin), times_(times) {}

 private:
  void change(double& given_j, double& /*well_j*/) const noexcept override { given_j *= times_; }
  double times_;
};

/// Ticks in which the clamp took force away, of those in which something was felt.
double clamped_share(double times) {
  const auto scene = deployed("flat_pdms");
  VirtualSessionConfig config = session_config(scene, {40, 0, 0, 0}, std::make_shared<ExecutedLog>());
  config.make_method = [times] { return std::make_unique<WrongAccount>(times); };
  // A scale at which the well is worth more than E₀, as one is planned for soft samples.
  config.station.scaling.force *= 8;
  config.station.allow_unsafe_scaling = true;
  VirtualSession session(config);
  double clamped = 0, felt = 0;
  session.run(9000, [&](const recording::Sample& row) {
    felt += std::fabs(row.hand_force_rendered_h_n[2]) > 0.01;
    clamped += (row.limit_flags & recording::kLimitClamp) != 0;
  });
  return clamped / felt;
}

TEST(TwinMutants, AnAccountThatDoesNotKnowTheWellCutsTheAdhesion) {
  const double right = clamped_share(1), none = clamped_share(0), wrong_sign = clamped_share(-1);
  std::printf("clamped share: right %.3g, no credit %.3g, wrong sign %.3g\n", right, none, wrong_sign);
  EXPECT_LT(right, 0.01);
  EXPECT_GT(none, 0.05);
  EXPECT_GT(wrong_sign, 0.05);
}

}  // namespace
}  // namespace telenano::support

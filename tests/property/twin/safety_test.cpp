// What a hand can take with a twin: whatever it does, whatever scales the operator chooses meanwhile,
// whatever server, restarts and scene say. Whole sessions in virtual time. The oracle is the hand's own account,
// of true positions and of the forces that really acted; promised is E₀ and the sample's well, once.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "telenano/common/base/random.h"
#include "telenano/common/control/methods.h"
#include "telenano/common/link/codec.h"
#include "telenano/master/twin/scene_twin.h"
#include "tests/property/twin/deployed_scene.h"
#include "tests/support/changed_news_method.h"
#include "tests/support/driven_hand.h"
#include "tests/support/sliders.h"
#include "tests/support/virtual_session.h"

namespace telenano::support {
namespace {

using control::Method;
using control::Scaling;
using station::TwinState;

constexpr double kAllowanceJ = 0.010;
// Rounding: 1e5 terms of some millijoules, in long double there and in double here.
constexpr double kRoundingJ = 1e-12;

constexpr Sliders kSliders[] = {Sliders::kPressLow, Sliders::kEachTick, Sliders::kSpite, Sliders::kWalk};

/// What a server says that is not so.
enum class Lie { kNone, kSums, kHash, kExecuted, kGap, kBreaks, kSnapshot, kForce, kWell, kWellParted, kAll };
constexpr Lie kLies[] = {Lie::kSums,     Lie::kHash,  Lie::kExecuted, Lie::kGap,        Lie::kBreaks,
                         Lie::kSnapshot, Lie::kForce, Lie::kWell,     Lie::kWellParted, Lie::kAll};
const char* name_of(Lie lie) {
  constexpr const char* kNames[] = {"none",     "sums",  "hash", "executed",     "gap", "breaks",
                                    "snapshot", "force", "well", "well, parted", "all"};
  return kNames[static_cast<int>(lie)];
}

/// Changes what the server sends; what cannot be read is left alone.
class Liar {
 public:
  Liar(Lie lie, std::uint64_t seed) : lie_(lie), random_(seed) {}

  std::size_t operator()(std::span<std::uint8_t> out, std::size_t size) {
    if (codec_.decode(out.first(size), in_) != link::DropCause::kNone) return size;
    std::size_t changed = 0;
    if (in_.type == link::MessageType::kReply) {
      link::Reply& r = in_.reply;
      // A state can be apart only where the hash says so: the other lies need partings to be heard at all.
      const bool parts =
          lie_ == Lie::kHash || lie_ == Lie::kSnapshot || lie_ == Lie::kWellParted || lie_ == Lie::kAll;
      // A well as deep as can be is of use only to who gives that much, and once no twin knows better.
      if (says(Lie::kSums) || lie_ == Lie::kWellParted) {
        given_aj_ += 1e6;
        r.energy_in_aj += random_.uniform(0, 1e3);
        r.energy_out_aj += given_aj_;
      }
      if (parts && random_.chance(lie_ == Lie::kHash || lie_ == Lie::kWellParted ? 0.02 : 0.002))
        r.steps.state_hash ^= 1;
      if (says(Lie::kExecuted) && random_.chance(0.02)) {
        r.steps.executed = random_.below(r.steps.newest + 1);
        r.steps.newest = std::max(r.steps.newest, r.steps.executed);
      }
      if (says(Lie::kGap)) r.steps.newest += 1 + random_.below(1000);
      if (says(Lie::kBreaks) && random_.chance(0.01)) {
        ++breaks_;
        r.steps.break_reason = static_cast<std::uint32_t>(random_.below(9));
      }
      r.steps.breaks += breaks_;
      if (says(Lie::kForce) && random_.chance(0.05))
        r.force_w_nn = Vec3(0, 0, random_.chance(0.5) ? 1e300 : -1e6);
      changed = codec_.encode(r, out);
    } else if (in_.type == link::MessageType::kSnapshotPiece) {
      link::SnapshotPiece& p = in_.snapshot_piece;
      p.breaks += breaks_;
      if (says(Lie::kSnapshot) && random_.chance(0.5)) {
        for (int i = 0; i < 4 && p.size > 0; ++i)
          p.data[random_.below(p.size)] = static_cast<std::uint8_t>(random_.below(256));
        if (random_.chance(0.2)) p.step += random_.below(3) - 1;
      }
      changed = codec_.encode(p, out);
    } else if (in_.type == link::MessageType::kWelcome && (says(Lie::kWell) || says(Lie::kWellParted))) {
      in_.welcome.well_aj = 1e9;
      changed = codec_.encode(in_.welcome, out);
    }
    return changed > 0 ? changed : size;
  }

 private:
  bool says(Lie lie) const { return lie_ == lie || lie_ == Lie::kAll; }

  Lie lie_;
  Random random_;
  link::Codec codec_;
  link::Incoming in_;
  double given_aj_ = 0;
  std::uint32_t breaks_ = 0;
};

struct Attack {
  std::string scene = "flat_pdms";
  double rtt_ms = 0;
  double loss = 0;
  Sliders sliders = Sliders::kNever;
  Lie lie = Lie::kNone;
  double by = 1;          ///< α_F·by, α_v/by at the start
  bool restarts = false;  ///< the server, each time that it has touched for a moment
  int cycles = 6;
  std::uint64_t seed = 1;
  double compand = 1;            ///< control::CompandingConfig::gain
  bool compand_changes = false;  ///< it goes on and off, several times in each press
  std::function<std::unique_ptr<control::StationMethod>()> make_method{};
  std::function<std::unique_ptr<control::LocalSlave>()> make_twin{};
};

std::string text_of(const Attack& a) {
  return a.scene + ", " + std::to_string(a.rtt_ms) + " ms, loss " + std::to_string(a.loss) + ", sliders " +
         name_of(a.sliders) + ", lies " + name_of(a.lie) + (a.restarts ? ", restarts" : "");
}

struct Taken {
  double most_j = 0;  ///< by the hand's own account
  double well_j = 0;  ///< of the scene itself, at the dearest scale that was used; at most what is believed
  double most_n = 0;  ///< force on the hand
  std::int64_t by_twin = 0;  ///< engaged ticks that the twin rendered
  std::int64_t touching = 0;
  std::uint64_t partings = 0, snapshots = 0;
  int changes = 0, restarts = 0;
  TwinState end = TwinState::kNone;
};

Scaling scaled(double by) {
  return {1e-6 / by, 2e7 * by};
}

/// Presses and withdrawals, slow enough that the device's own damping takes little of what is won.
Taken attack(const Attack& a) {
  const auto scene = deployed(a.scene);
  const double surface_nm =
      scene->start_apex_w_nm.z() - (scene->start_apex_w_nm.z() - scene->start_touch_w_nm);
  const double above_nm = 12, deep_nm = a.scene == "lithography" ? 8 : 4;
  double target_nm = scene->start_apex_w_nm.z() - surface_nm, by = a.by;
  bool down = true;
  std::int64_t turned = 0;
  int cycles = 0;
  const auto wait = static_cast<std::int64_t>(150 + 2 * a.rtt_ms);
  const auto hand = std::make_shared<DrivenHand>(AccountedHandConfig{}, [&](const auto& view) {
    const double goal_nm = down ? -deep_nm : above_nm;
    const double left_nm = goal_nm - target_nm;
    if (std::fabs(left_nm) > 0.3) turned = view.tick;
    if (view.tick - turned > wait) {
      down = !down;
      cycles += down;
      turned = view.tick;
    }
    const double m_per_nm = 1e-3 * by;
    const double speed_m = (down ? 6e-6 : 5e-5) * by;
    return view.pos_m + std::clamp(0.3 * left_nm * m_per_nm, -speed_m, speed_m);
  });
  VirtualSessionConfig config;
  config.scene = scene;
  config.hand = hand;
  config.station.method = Method::kTwin;
  config.station.allowance_j = kAllowanceJ;
  config.station.scaling = scaled(a.by);
  config.station.allow_unsafe_scaling = true;
  config.station.companding.gain = a.compand;
  config.twin = true;
  config.make_method = a.make_method;
  config.make_twin = a.make_twin;
  config.seed = a.seed;
  for (net::SimPath* const path : {&config.to_server, &config.to_station}) {
    path->delay_ns = static_cast<std::int64_t>(0.5e6 * a.rtt_ms);
    path->loss = a.loss;
  }
  if (a.lie != Lie::kNone)
    config.lie = [liar = std::make_shared<Liar>(a.lie, a.seed + 7)](
                     std::span<std::uint8_t> out, std::size_t size) { return (*liar)(out, size); };
  VirtualSession session(config);
  const double well_aj = twin::SceneTwin(scene).well_aj();
  const double well_most_j = session.station().config().well_max_j;
  Random random(a.seed + 5);
  Taken taken;
  const auto price = [&] {
    const double all_aj = well_aj + config.station.companding.most_aj();
    taken.well_j = std::max(taken.well_j, std::min(scaled(by).hand_energy_j(all_aj), well_most_j));
  };
  price();
  double last_pos_m = 0;
  std::int64_t touched = 0, since_restart = 0;
  for (std::int64_t k = 0; cycles < a.cycles && k < 60'000; ++k) {
    const double wanted = next_scale(
        a.sliders, by,
        {k, down, false, session.loop().trace().applied_force_h_n.z(), hand->pos_m() - last_pos_m}, random);
    last_pos_m = hand->pos_m();
    if (wanted != by && session.station().change_scaling(scaled(wanted))) {
      by = wanted;
      ++taken.changes;
      price();
    }
    if (a.compand_changes && k % 37 == 0) {
      control::CompandingConfig companding = config.station.companding;
      if (k % 74 == 0) companding.gain = 1;
      EXPECT_TRUE(session.station().change_companding(companding));
    }
    const recording::Sample& row = session.step();
    target_nm = row.tip_target_w_nm[2] - surface_nm;
    const bool touches = row.contact_state == static_cast<std::uint32_t>(link::ContactState::kContact);
    touched = touches ? touched + 1 : 0;
    ++since_restart;
    if (a.restarts && touched > 100 && since_restart > 1500) {
      session.restart_server();
      ++taken.restarts;
      since_restart = touched = 0;
    }
    taken.touching += touches;
    taken.most_n = std::max(taken.most_n, std::fabs(row.hand_force_applied_h_n[2]));
    const station::StationTrace& t = session.loop().trace();
    const station::TwinRun& twin = *session.station().twin();
    taken.by_twin += t.method == Method::kTwin && twin.on() && t.mode == station::Mode::kEngaged;
    EXPECT_TRUE(std::isfinite(row.hand_force_applied_h_n[2]));
  }
  EXPECT_FALSE(hand->too_fast());
  taken.most_j = hand->account().most_extracted_j();
  taken.partings = session.station().twin()->partings();
  taken.snapshots = session.station().twin()->snapshots();
  taken.end = session.station().twin()->state();
  return taken;
}

constexpr const char* kScenes[] = {"flat_silicon_oxide", "flat_pdms", "flakes",
                                   "humid_flakes",       "particle",  "lithography"};

TEST(TwinSafety, ChangesOfScaleGrantNothing) {
  double most_of_it = 0;
  for (const char* const scene : kScenes) {
    for (const Sliders sliders : kSliders) {
      for (const double rtt_ms : {0.0, 100.0}) {
        Attack a;
        a.scene = scene;
        a.sliders = sliders;
        a.rtt_ms = rtt_ms;
        a.loss = rtt_ms > 0 ? 0.02 : 0;
        const Taken taken = attack(a);
        EXPECT_LE(taken.most_j, kAllowanceJ + taken.well_j + kRoundingJ) << text_of(a);
        EXPECT_GE(taken.changes, 5) << text_of(a);
        EXPECT_GT(taken.by_twin, 1000) << text_of(a) << ": by another method";
        EXPECT_GT(taken.touching, 100) << text_of(a) << ": nothing was pressed";
        most_of_it = std::max(most_of_it, taken.most_j / (kAllowanceJ + taken.well_j));
      }
    }
  }
  std::printf("at most %.3g of what is promised\n", most_of_it);
}

// Companding makes the sample's well deeper by (g - 1) U0, and that is all that a hand can have of it.
TEST(TwinSafety, CompandingGrantsItsWellOnce) {
  double most_of_it = 0;
  for (const char* const scene : kScenes) {
    for (const bool changes : {false, true}) {
      for (const Sliders sliders : {Sliders::kNever, Sliders::kWalk}) {
        Attack a;
        a.scene = scene;
        a.sliders = sliders;
        a.compand = station::kCompandingGainMax;
        a.compand_changes = changes;
        a.restarts = changes;
        a.rtt_ms = changes ? 60 : 0;
        const Taken taken = attack(a);
        EXPECT_LE(taken.most_j, kAllowanceJ + taken.well_j + kRoundingJ) << text_of(a);
        EXPECT_GT(taken.by_twin, 1000) << text_of(a) << ": by another method";
        EXPECT_GT(taken.touching, 100) << text_of(a) << ": nothing was pressed";
        most_of_it = std::max(most_of_it, taken.most_j / (kAllowanceJ + taken.well_j));
      }
    }
  }
  std::printf("at most %.3g of what is promised\n", most_of_it);
}

TEST(TwinSafety, AServerThatLiesGainsNothing) {
  for (const char* const scene : {"flat_pdms", "flakes", "particle"}) {
    for (const Lie lie : kLies) {
      for (std::uint64_t seed = 1; seed <= 2; ++seed) {
        Attack a;
        a.scene = scene;
        a.lie = lie;
        a.rtt_ms = seed == 1 ? 0 : 60;
        a.seed = seed;
        const Taken taken = attack(a);
        EXPECT_LE(taken.most_j, kAllowanceJ + taken.well_j + kRoundingJ) << text_of(a);
        EXPECT_LE(taken.most_n, 12.0) << text_of(a);
        EXPECT_GT(taken.by_twin, 100) << text_of(a) << ": by another method";
        const bool parts = lie == Lie::kHash || lie == Lie::kSnapshot || lie == Lie::kWellParted;
        EXPECT_TRUE(!parts || taken.partings > 0) << text_of(a);
      }
    }
  }
}

TEST(TwinSafety, RestartsGrantTheWellOnce) {
  for (const char* const scene : {"flat_pdms", "flat_silicon_oxide", "flakes"}) {
    for (const double by : {1.0, 3.0}) {
      Attack a;
      a.scene = scene;
      a.by = by;
      a.restarts = true;
      a.cycles = 12;
      const Taken taken = attack(a);
      EXPECT_LE(taken.most_j, kAllowanceJ + taken.well_j + kRoundingJ) << text_of(a);
      EXPECT_GE(taken.restarts, 4) << text_of(a);
      EXPECT_GT(taken.by_twin, 1000) << text_of(a);
    }
  }
}

/// A scene that claims a well as deep as it likes, and gives that out.
class BottomlessTwin final : public control::LocalSlave {
 public:
  explicit BottomlessTwin(std::shared_ptr<const scene::Scene> scene) : twin_(std::move(scene)) {}
  void step(const control::LocalStep& step, control::LocalAnswer& answer) noexcept override {
    twin_.step(step, answer);
    // It pulls the way the hand goes, as hard as it can, and says that it pays for it.
    given_aj_ += 1e3;
    answer.energy_out_aj += given_aj_;
    answer.force_w_nn.z() = step.vel_w_nm_s.z() > 0 ? 100 : -100;
  }
  std::uint64_t state_hash() const noexcept override { return twin_.state_hash(); }
  void reset() noexcept override { twin_.reset(); }
  bool load(std::span<const std::uint8_t> bytes, control::LocalAnswer& answer) noexcept override {
    return twin_.load(bytes, answer);
  }
  std::size_t snapshot_bytes_max() const noexcept override { return twin_.snapshot_bytes_max(); }
  double well_aj() const noexcept override { return 1e12; }
  std::uint64_t scene_hash() const noexcept override { return twin_.scene_hash(); }

 private:
  twin::SceneTwin twin_;
  double given_aj_ = 0;
};

TEST(TwinSafety, AHostileScenesWellIsCapped) {
  Attack a;
  a.lie = Lie::kWell;
  a.make_twin = [scene = deployed(a.scene)] { return std::make_unique<BottomlessTwin>(scene); };
  const Taken taken = attack(a);
  // What a station believes at most, whatever a scene says.
  const double believed_j = station::StationConfig{}.well_max_j;
  EXPECT_LE(taken.most_j, kAllowanceJ + believed_j + kRoundingJ);
  EXPECT_GT(taken.most_j, kAllowanceJ + 0.5 * believed_j) << "the attack takes what there is to take";
  EXPECT_GT(taken.by_twin, 1000);
}

/// The method `twin` with its account's credit made wrong.
class WrongCredit final : public ChangedNewsMethod {
 public:
  enum class How { kRight, kAgainAtEachSession };
  explicit WrongCredit(How how) : ChangedNewsMethod(Method::kTwin), how_(how) {}
  void begin_session(bool new_epoch) noexcept override {
    ChangedNewsMethod::begin_session(new_epoch);
    if (new_epoch) ++sessions_;
  }

 private:
  void change(double& given_j, double& well_j) const noexcept override {
    const double times = how_ == How::kAgainAtEachSession ? sessions_ : 1;
    given_j *= times;
    well_j *= times;
  }
  How how_;
  double sessions_ = 0;
};

/// A sample that gives its whole well to whoever comes, and once more when it begins anew: it pulls along
/// with the hand until it has given it.
class GenerousTwin final : public control::LocalSlave {
 public:
  static constexpr double kWellAj = 200;
  explicit GenerousTwin(std::shared_ptr<const scene::Scene> scene) : twin_(std::move(scene)) {}
  void step(const control::LocalStep& step, control::LocalAnswer& answer) noexcept override {
    twin_.step(step, answer);
    const double moved_nm = step.target_w_nm.z() - last_nm_;
    last_nm_ = step.target_w_nm.z();
    constexpr double kPullNn = 100;
    answer.force_w_nn.setZero();
    if (given_aj_ < kWellAj && std::fabs(moved_nm) < 1) {
      answer.force_w_nn.z() = moved_nm > 0 ? kPullNn : -kPullNn;
      given_aj_ += kPullNn * std::fabs(moved_nm);
    }
    answer.energy_in_aj = 0;
    answer.energy_out_aj = std::min(given_aj_, kWellAj);
  }
  std::uint64_t state_hash() const noexcept override { return twin_.state_hash(); }
  void reset() noexcept override {
    twin_.reset();
    given_aj_ = 0;
  }
  bool load(std::span<const std::uint8_t> bytes, control::LocalAnswer& answer) noexcept override {
    return twin_.load(bytes, answer);
  }
  std::size_t snapshot_bytes_max() const noexcept override { return twin_.snapshot_bytes_max(); }
  double well_aj() const noexcept override { return kWellAj; }
  std::uint64_t scene_hash() const noexcept override { return twin_.scene_hash(); }

 private:
  twin::SceneTwin twin_;
  double given_aj_ = 0;
  double last_nm_ = 0;
};

// The promise is one that can be broken: what would grant the well again with each restart is found by the
// same attack that the right method withstands.
TEST(TwinSafety, AWellThatIsGrantedAgainIsFound) {
  Attack a;
  a.restarts = true;
  a.cycles = 30;
  a.make_twin = [scene = deployed(a.scene)] { return std::make_unique<GenerousTwin>(scene); };
  const double promised_j = kAllowanceJ + scaled(1).hand_energy_j(GenerousTwin::kWellAj);
  const auto taken_j = [&](WrongCredit::How how) {
    a.make_method = [how] { return std::make_unique<WrongCredit>(how); };
    const Taken taken = attack(a);
    EXPECT_GE(taken.restarts, 4);
    EXPECT_GT(taken.by_twin, 1000);
    std::printf("%.4g mJ of %.4g promised, %d restarts\n", 1e3 * taken.most_j, 1e3 * promised_j,
                taken.restarts);
    return taken.most_j;
  };
  EXPECT_LE(taken_j(WrongCredit::How::kRight), promised_j + kRoundingJ);
  EXPECT_GT(taken_j(WrongCredit::How::kAgainAtEachSession), promised_j);
}

}  // namespace
}  // namespace telenano::support

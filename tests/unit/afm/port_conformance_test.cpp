// Every adapter under the AFM's logic must pass one suite. Here: the one for Nanonis with the simulated
// controller, and a scripted one that differs in all that may differ, with mutants that must be found.
#include "tests/unit/afm/port_conformance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <optional>
#include <sstream>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/afm/afm_adapters.h"
#include "telenano/nve_server/afm/afm_logic.h"
#include "telenano/nve_server/afm_sim/default_scene.h"
#include "telenano/nve_server/afm_sim/sim_controller.h"
#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::afm {
namespace {

std::string lines(const std::vector<std::string>& faults) {
  std::string all;
  for (const std::string& fault : faults) all += fault + "\n";
  return all;
}

/// The simulated controller behind its frames.
class SimDevice final : public PortDevice {
 public:
  explicit SimDevice(const afm_sim::SimConfig& rig) : sim_(rig, afm_sim::default_scene()) {}
  void advance_to(std::int64_t now_ns) override { sim_.advance_to(now_ns); }
  void request(Role role, const std::vector<std::uint8_t>& bytes, std::int64_t now_ns) override {
    nanonis::FrameReader reader;
    reader.feed(bytes);
    nanonis::Header header;
    std::span<const std::uint8_t> body;
    nanonis::Call call;
    ASSERT_EQ(reader.next(header, body), nanonis::FrameReader::Status::kFrame);
    const nanonis::Command* const command = nanonis::find_command(header.name);
    ASSERT_TRUE(command != nullptr && nanonis::decode_call(*command, body, call)) << header.name;
    pending_[static_cast<std::size_t>(role)] = sim_.begin(call, static_cast<int>(role), now_ns);
  }
  std::vector<std::uint8_t> answer(Role role, std::int64_t now_ns) override {
    auto& pending = pending_[static_cast<std::size_t>(role)];
    if (!pending || !sim_.finish(*pending, now_ns)) return {};
    const auto bytes = nanonis::encode_answer(nanonis::command(pending->call.id), pending->answer);
    pending.reset();
    return bytes;
  }
  double height_nm() const override { return sim_.height_nm(); }
  Vec3 across_nm() const override { return across_ = sim_.tip().base_w_nm() - sim_.tip().drift_nm(); }
  double force_nn() const override { return sim_.tip().normal_force_nn(); }

 private:
  afm_sim::SimController sim_;
  std::array<std::optional<afm_sim::SimController::Pending>, kRoles> pending_;
  mutable Vec3 across_;
};

enum class Mutant : std::uint8_t { kNone, kSwappedSign, kStaleReading, kNoWithdrawal, kNoLift };

constexpr double kRangeUm = 2, kTopUm = 0.9;
constexpr double kCountsPerNm = 20;  // its deflection: a count of the converter is 0.05 nm
constexpr double kCountsPerVolt = 3276.8;

/// Another controller: one line of text for a request, one for an answer; micrometres, larger towards the
/// sample; raw counts; a reading every 20 ms, with no stream; no Z limits, no protection of its own.
class ScriptedDevice final : public PortDevice {
 public:
  void advance_to(std::int64_t now_ns) override {
    for (; now_ns_ < now_ns; now_ns_ += 100'000) {
      if (feedback_) {
        const double error_nn = 15 - force_nn();
        height_nm_ -= std::clamp(0.004 * error_nn, -0.08, 0.08);
      }
      across_nm_ += (target_nm_ - across_nm_) * 0.01;
    }
  }
  void request(Role role, const std::vector<std::uint8_t>& bytes, std::int64_t now_ns) override {
    std::istringstream line(std::string(bytes.begin(), bytes.end()));
    std::string what;
    double a = 0, b = 0;
    line >> what >> a >> b;
    char text[96] = "ok\n";
    Line& l = lines_[static_cast<std::size_t>(role)];
    l.ready_ns = now_ns + 1'000'000;
    if (what == "range") {
      std::snprintf(text, sizeof text, "range 10 10 %g\n", kRangeUm);
    } else if (what == "z?") {
      std::snprintf(text, sizeof text, "z %.9f\n", -1e-3 * height_nm_);
    } else if (what == "z") {
      if (!feedback_) height_nm_ = -1e3 * a;
    } else if (what == "xy?") {
      std::snprintf(text, sizeof text, "xy %.9f %.9f\n", 1e-3 * across_nm_.x(), 1e-3 * across_nm_.y());
    } else if (what == "xy") {
      target_nm_ = Vec3(1e3 * a, 1e3 * b, 0);
    } else if (what == "loop?") {
      std::snprintf(text, sizeof text, "loop %d\n", feedback_ ? 1 : 0);
    } else if (what == "loop") {
      if (feedback_ && a == 0 && line.str().find("stay") == std::string::npos) height_nm_ += 25;
      feedback_ = a != 0;
    } else if (what == "setpoint?") {
      std::snprintf(text, sizeof text, "setpoint %g\n", kCountsPerNm * (15.0 / 40 + 1));
    } else if (what == "up") {
      feedback_ = false;
      height_nm_ = 1e3 * kTopUm;
    } else if (what == "read") {
      l.ready_ns = now_ns + 20'000'000;
      const double noise_nm = 0.05 * noise_.normal();
      std::snprintf(text, sizeof text, "read %.0f %.0f\n",
                    kCountsPerNm * (force_nn() / 40 + 1 + noise_nm) /* at the request */,
                    3 * noise_.normal());
    } else if (what != "stop") {
      std::snprintf(text, sizeof text, "what?\n");
    }
    l.text = text;
  }
  std::vector<std::uint8_t> answer(Role role, std::int64_t now_ns) override {
    Line& l = lines_[static_cast<std::size_t>(role)];
    if (l.text.empty() || now_ns < l.ready_ns) return {};
    const std::vector<std::uint8_t> bytes(l.text.begin(), l.text.end());
    l.text.clear();
    return bytes;
  }
  double height_nm() const override { return height_nm_; }
  Vec3 across_nm() const override { return across_nm_; }
  /// Ground of 400 N/m behind a lever of 40 N/m, where the middle of the range is.
  double force_nn() const override { return std::max(0.0, -height_nm_) / (1.0 / 40 + 1.0 / 400); }

 private:
  struct Line {
    std::string text;
    std::int64_t ready_ns = 0;
  };
  std::array<Line, kRoles> lines_;
  std::int64_t now_ns_ = 0;
  double height_nm_ = 1e3 * kTopUm;
  Vec3 across_nm_ = Vec3::Zero(), target_nm_ = Vec3::Zero();
  bool feedback_ = false;
  Random noise_{7};
};

class ScriptedAdapter final : public AfmPort {
 public:
  explicit ScriptedAdapter(Mutant mutant = Mutant::kNone) : mutant_(mutant) {
    steps_ = {"range", "loop?", "z?", "xy?", "setpoint?"};
    steps_.insert(steps_.end(), 20, "read");
  }
  std::unique_ptr<AfmPort> clone() const override { return std::make_unique<ScriptedAdapter>(*this); }
  AfmCapabilities capabilities() const noexcept override { return {}; }
  std::size_t setup_steps() const noexcept override { return steps_.size(); }
  Role setup_role(std::size_t step) const noexcept override {
    return steps_[step] == "read" ? Role::kReads : Role::kMotion;
  }
  std::size_t give_back_steps() const noexcept override { return 0; }
  Role give_back_role(std::size_t) const noexcept override { return Role::kData; }
  bool averages(const AfmCommand& command) const noexcept override {
    return command.op == AfmOp::kRead || command.op == AfmOp::kSetup;
  }
  double signal_of(double deflection_nm) const noexcept override { return kCountsPerNm * deflection_nm; }

  std::vector<std::uint8_t> encode(Role role, const AfmCommand& command) override {
    Line& l = lines_[static_cast<std::size_t>(role)];
    l.command = command;
    const std::string line = request(command) + "\n";
    return {line.begin(), line.end()};
  }
  void feed(Role role, std::span<const std::uint8_t> bytes) override {
    lines_[static_cast<std::size_t>(role)].text.append(bytes.begin(), bytes.end());
  }
  Next next(Role role, AfmReading& reading) override {
    Line& l = lines_[static_cast<std::size_t>(role)];
    const std::size_t end = l.text.find('\n');
    if (end == std::string::npos) return l.text.size() > 90 ? Next::kBroken : Next::kNeedMore;
    std::istringstream line(l.text.substr(0, end));
    l.text.erase(0, end + 1);
    std::string what;
    double a = 0, b = 0, c = 0;
    line >> what >> a >> b >> c;
    reading = {};
    if (what == "range") {
      reading.kind = ReadingKind::kRange;
      reading.numbers = {1e3 * std::min(a, b), 1e3 * c};
    } else if (what == "z") {
      reading.kind = ReadingKind::kHeight;
      reading.numbers = {sign() * 1e3 * a};
    } else if (what == "xy") {
      reading.kind = ReadingKind::kPlace;
      reading.numbers = {1e3 * a, 1e3 * b};
    } else if (what == "loop" && l.command.op == AfmOp::kAskFeedback) {
      reading.kind = ReadingKind::kFeedback;
      reading.numbers = {a};
    } else if (what == "loop") {
      reading.kind = ReadingKind::kStatus;
      reading.numbers = {a};
      reading.status = a == 0 ? AfmStatus::kOff : AfmStatus::kOther;
    } else if (what == "setpoint") {
      reading.kind = ReadingKind::kSetpoint;
      reading.numbers = {a, a / kCountsPerNm};
    } else if (what == "read") {
      reading.kind = ReadingKind::kSignals;
      reading.numbers = {a / kCountsPerVolt, b / kCountsPerVolt, a / kCountsPerNm, b};
      if (mutant_ == Mutant::kStaleReading) {
        std::swap(reading.numbers, last_);
        if (reading.numbers[2] == 0) reading.numbers = last_;
      }
    } else if (what != "ok") {
      return Next::kBroken;
    }
    return Next::kReading;
  }
  void reset(Role role) override { lines_[static_cast<std::size_t>(role)] = {}; }

 private:
  struct Line {
    std::string text;
    AfmCommand command;
  };
  double sign() const noexcept { return mutant_ == Mutant::kSwappedSign ? 1 : -1; }
  std::string request(const AfmCommand& command) const {
    char text[64];
    switch (command.op) {
      case AfmOp::kSetup:
        return steps_[command.step()];
      case AfmOp::kRead:
        return "read";
      case AfmOp::kMoveZ:
        std::snprintf(text, sizeof text, "z %.9f", sign() * 1e-3 * command.numbers[0]);
        return text;
      case AfmOp::kMoveXy:
        std::snprintf(text, sizeof text, "xy %.9f %.9f", 1e-3 * command.numbers[0],
                      1e-3 * command.numbers[1]);
        return text;
      case AfmOp::kFeedback:
        return command.numbers[0] != 0 ? "loop 1" : mutant_ == Mutant::kNoLift ? "loop 0 stay" : "loop 0";
      case AfmOp::kAskFeedback:
      case AfmOp::kAskStatus:
        return "loop?";
      case AfmOp::kAskHeight:
        return "z?";
      case AfmOp::kAskSetpoint:
        return "setpoint?";
      case AfmOp::kWithdraw:
        return mutant_ == Mutant::kNoWithdrawal ? "stop" : "up";
      default:
        return "stop";
    }
  }

  Mutant mutant_;
  std::vector<std::string> steps_;
  std::array<Line, kRoles> lines_;
  std::array<double, 4> last_{};
};

AfmConfig scripted_config() {
  AfmConfig config;
  config.force_rate_hz = 50;
  config.sensitivity_nm_v = kCountsPerVolt / kCountsPerNm;
  return config;
}

std::vector<std::string> scripted_faults(Mutant mutant) {
  ScriptedAdapter adapter(mutant);
  ScriptedDevice device;
  return conformance_faults(adapter, device, scripted_config());
}

TEST(PortConformance, NanonisWithTheSimulatedController) {
  for (const int z_sign : {1, -1}) {
    AfmConfig config;
    afm_sim::SimConfig rig;
    config.z_sign = rig.z_sign = z_sign;
    rig.drift_x_nm_s = rig.drift_y_nm_s = rig.drift_z_nm_s = 0;
    SimDevice device(rig);
    const auto port = make_adapter("nanonis", config);
    const auto faults = conformance_faults(*port, device, config);
    EXPECT_TRUE(faults.empty()) << "z_sign " << z_sign << "\n" << lines(faults);
  }
}

TEST(PortConformance, AScriptedControllerOfAnotherUnitSignAndRate) {
  const auto faults = scripted_faults(Mutant::kNone);
  EXPECT_TRUE(faults.empty()) << lines(faults);
}

TEST(PortConformance, FindsASwappedSignAStaleReadingAndAWithdrawalOrLiftThatIsNone) {
  const auto has = [](Mutant mutant, const std::string& what) {
    const std::string all = lines(scripted_faults(mutant));
    EXPECT_NE(all.find(what), std::string::npos) << "mutant " << static_cast<int>(mutant) << ":\n" << all;
  };
  has(Mutant::kSwappedSign, "a move down by 5 nm");
  has(Mutant::kStaleReading, "the bending after a step down");
  has(Mutant::kNoWithdrawal, "withdrawn");
  has(Mutant::kNoLift, "the feedback is off, and the lift");
}

/// The whole logic on the scripted controller: nothing above the port knows which one it is.
TEST(PortConformance, TheLogicApproachesTouchesAndWithdrawsOnTheScriptedController) {
  AfmLogic logic(scripted_config(), std::make_unique<ScriptedAdapter>());
  ScriptedDevice device;
  PortTarget wish;
  double peak_nn = 0;
  std::int64_t now_ns = 0;
  const auto run_to = [&](Phase phase, double most_s) {
    for (const std::int64_t end = now_ns + static_cast<std::int64_t>(1e9 * most_s); now_ns < end;) {
      now_ns += 500'000;
      device.advance_to(now_ns);
      peak_nn = std::max(peak_nn, device.force_nn());
      for (std::size_t i = 0; i < kRoles; ++i) {
        const Role role = static_cast<Role>(i);
        if (now_ns == 500'000) logic.connected(role, now_ns);
        const auto bytes = device.answer(role, now_ns);
        if (bytes.empty()) continue;
        logic.port().feed(role, bytes);
        AfmReading reading;
        if (logic.port().next(role, reading) == AfmPort::Next::kReading)
          logic.answered(role, reading, now_ns);
      }
      logic.tick(now_ns, wish);
      for (std::size_t i = 0; i < kRoles; ++i) {
        AfmCommand command;
        const Role role = static_cast<Role>(i);
        if (logic.next(role, now_ns, command))
          device.request(role, logic.port().encode(role, command), now_ns);
      }
      if (logic.state().phase == phase) return now_ns;
    }
    return std::int64_t{-1};
  };
  const std::int64_t there_ns = run_to(Phase::kFollowing, 40.0);
  ASSERT_GE(there_ns, 0) << logic.refusal() << logic.news();
  EXPECT_LT(peak_nn, scripted_config().force_max_nn);
  EXPECT_GT(peak_nn, scripted_config().touch_force_nn) << "it has touched";
  logic.withdraw(Cause::kExit, there_ns);
  EXPECT_GE(run_to(Phase::kWithdrawn, 2.0), 0) << logic.news();
  EXPECT_EQ(device.height_nm(), 1e3 * kTopUm);
}

TEST(PortConformance, AnUnknownNameIsRefused) {
  EXPECT_THROW(make_adapter("no-such-controller", AfmConfig{}), std::exception);
}

}  // namespace
}  // namespace telenano::afm

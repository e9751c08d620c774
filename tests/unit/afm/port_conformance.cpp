#include "tests/unit/afm/port_conformance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

namespace telenano::afm {
namespace {

constexpr std::int64_t kTurnNs = 500'000;
// Of a height: what the piezo's creep and lag leave of a step of 5 nm, the wire's floats, and the rounding of
// a converter: all below 0.02 nm here. A wrong unit, sign or a stale value is off by nm.
constexpr double kHeightNm = 0.2;
// Of a force, as the lever's bending: its noise at 5 ms of averaging is some 0.01 nm, slow thermal bending
// 0.1 nm. A stale reading is off by the steps of the base, of 2 nm each.
constexpr double kBendingNm = 0.5;

class Suite {
 public:
  Suite(AfmPort& port, PortDevice& device, const AfmConfig& config)
      : port_(port), device_(device), config_(config) {}

  std::vector<std::string> run() {
    if (!start()) return faults_;
    copies_speak_alike();
    lift_and_lower();
    if (find_surface()) press_and_read();
    across();
    floor();
    withdraw();
    give_back();
    garbage_is_no_answer();
    return faults_;
  }

 private:
  void fault(const std::string& what) { faults_.push_back(what); }
  void want(bool good, const std::string& what, double is = NAN, double expected = NAN) {
    if (good) return;
    char numbers[80] = "";
    if (!std::isnan(is)) std::snprintf(numbers, sizeof numbers, ": %.6g instead of %.6g", is, expected);
    fault(what + numbers);
  }
  void wait(double s) {
    for (const std::int64_t end = now_ns_ + static_cast<std::int64_t>(1e9 * s); now_ns_ < end;) {
      now_ns_ += kTurnNs;
      device_.advance_to(now_ns_);
    }
  }
  std::optional<AfmReading> ask(Role role, const AfmCommand& command) {
    device_.request(role, port_.encode(role, command), now_ns_);
    for (const std::int64_t end = now_ns_ + 5'000'000'000; now_ns_ < end;) {
      wait(1e-9 * kTurnNs);
      const auto bytes = device_.answer(role, now_ns_);
      if (bytes.empty()) continue;
      port_.feed(role, bytes);
      AfmReading reading;
      const AfmPort::Next next = port_.next(role, reading);
      if (next == AfmPort::Next::kNeedMore) continue;
      if (next == AfmPort::Next::kReading) return reading;
      break;
    }
    fault("operation " + std::to_string(static_cast<int>(command.op)) + " has no answer");
    port_.reset(role);
    return std::nullopt;
  }
  /// The first number of an answer of that kind, or NaN and a fault.
  double number(Role role, const AfmCommand& command, ReadingKind kind, std::size_t index = 0) {
    const auto reading = ask(role, command);
    if (!reading) return NAN;
    if (!reading->refused.empty()) fault(reading->refused + " is refused: " + reading->why);
    if (reading->kind != kind) {
      fault("operation " + std::to_string(static_cast<int>(command.op)) + " is answered by another kind");
      return NAN;
    }
    return reading->numbers[index];
  }
  double height() { return number(Role::kMotion, {AfmOp::kAskHeight}, ReadingKind::kHeight); }
  double bending() { return number(Role::kReads, {AfmOp::kRead}, ReadingKind::kSignals, 2); }
  void move_z(double height_nm) {
    number(Role::kMotion, {AfmOp::kMoveZ, {height_nm}}, ReadingKind::kDone);
    wait(0.005);
  }

  bool start() {
    std::array<int, 9> told{};
    const double before_nm = device_.height_nm();
    for (std::size_t i = 0; i < port_.setup_steps(); ++i) {
      const auto reading = ask(port_.setup_role(i), {AfmOp::kSetup, {static_cast<double>(i)}});
      if (!reading) return false;
      if (!reading->unfit.empty() || !reading->refused.empty()) {
        fault("the start: " + reading->unfit + reading->refused);
        return false;
      }
      ++told[static_cast<std::size_t>(reading->kind)];
      const double number = reading->numbers[0];
      if (reading->kind == ReadingKind::kHeight) top_nm_ = number;
      if (reading->kind == ReadingKind::kSignals) free_nm_ = reading->numbers[2];
      if (reading->kind == ReadingKind::kStatus && reading->status != AfmStatus::kOff)
        fault("the start: the feedback is said not to be off");
    }
    want(std::fabs(device_.height_nm() - before_nm) < kHeightNm, "the start moves the tip");
    want(std::fabs(top_nm_ - before_nm) < kHeightNm, "the start: the height", top_nm_, before_nm);
    for (const ReadingKind kind : {ReadingKind::kRange, ReadingKind::kStatus, ReadingKind::kHeight,
                                   ReadingKind::kPlace, ReadingKind::kSetpoint})
      want(told[static_cast<std::size_t>(kind)] > 0,
           "the start does not tell kind " + std::to_string(static_cast<int>(kind)));
    want(told[static_cast<std::size_t>(ReadingKind::kSignals)] >= 20, "the start: fewer than 20 readings");
    if (port_.capabilities().watches_force)
      want(told[static_cast<std::size_t>(ReadingKind::kWatched)] > 0, "the start: what is watched");
    return true;
  }
  void copies_speak_alike() {
    const auto copy = port_.clone();
    want(copy->encode(Role::kMotion, {AfmOp::kMoveZ, {12.5}}) ==
             port_.clone()->encode(Role::kMotion, {AfmOp::kMoveZ, {12.5}}),
         "a copy speaks otherwise");
  }
  void lift_and_lower() {
    const double from_nm = device_.height_nm();
    move_z(from_nm - 5);
    want(std::fabs(device_.height_nm() - (from_nm - 5)) < kHeightNm, "a move down by 5 nm",
         device_.height_nm(), from_nm - 5);
    const double told_nm = height();
    want(std::fabs(told_nm - device_.height_nm()) < kHeightNm, "the height after a move", told_nm,
         device_.height_nm());
    move_z(from_nm);
  }
  bool find_surface() {
    number(Role::kMotion, {AfmOp::kFeedback, {1}}, ReadingKind::kDone);
    int calm = 0;
    for (int i = 0; i < 500 && calm < 4; ++i) {
      const double before_nm = device_.height_nm();
      wait(0.02);
      calm = std::fabs(device_.height_nm() - before_nm) < 0.5 && device_.force_nn() > 0 ? calm + 1 : 0;
    }
    want(calm >= 4, "the feedback does not bring the tip to the surface");
    const double bent_nm = bending() - free_nm_;
    want(std::fabs(bent_nm - device_.force_nn() / config_.spring_constant_n_m) < kBendingNm,
         "the bending at the surface", bent_nm, device_.force_nn() / config_.spring_constant_n_m);
    surface_nm_ = device_.height_nm();
    number(Role::kMotion, {AfmOp::kFeedback, {0}}, ReadingKind::kDone);
    for (int i = 0; i < 200; ++i) {
      if (number(Role::kMotion, {AfmOp::kAskFeedback}, ReadingKind::kFeedback) == 0) {
        // What the approach asks too: a tip that stays where it pressed is no zero of the force.
        want(device_.height_nm() - surface_nm_ >= 0.5 * config_.lift_nm, "the feedback is off, and the lift",
             device_.height_nm() - surface_nm_, config_.lift_nm);
        return calm >= 4;
      }
      wait(0.005);
    }
    fault("the feedback does not go off");
    return false;
  }
  void press_and_read() {
    // Down to where it pressed, then in steps of 2 nm: each reading is of now.
    for (double z_nm = std::max(device_.height_nm(), surface_nm_ + 4); z_nm > surface_nm_ - 5; z_nm -= 2) {
      move_z(z_nm);
      wait(config_.period_s());
      const double bent_nm = bending() - free_nm_;
      const double true_nm = device_.force_nn() / config_.spring_constant_n_m;
      want(std::fabs(bent_nm - true_nm) < kBendingNm, "the bending after a step down", bent_nm, true_nm);
    }
    want(device_.force_nn() > 0, "a move down does not press");
    const auto status = ask(Role::kData, {AfmOp::kAskStatus});
    want(status && status->kind == ReadingKind::kStatus && status->status == AfmStatus::kOff,
         "the status while the tip is moved");
    if (port_.capabilities().watches_force) number(Role::kData, {AfmOp::kAskWatched}, ReadingKind::kWatched);
    pressed_ = true;
  }
  void across() {
    move_z(device_.height_nm() + 40);
    const Vec3 from = device_.across_nm();
    number(Role::kMotion, {AfmOp::kMoveXy, {from.x() + 3, from.y() - 4}}, ReadingKind::kDone);
    wait(0.2);
    want((device_.across_nm() - from - Vec3(3, -4, 0)).head<2>().norm() < kHeightNm, "a move across");
    number(Role::kMotion, {AfmOp::kStop}, ReadingKind::kDone);
  }
  void floor() {
    if (!port_.capabilities().z_limits) return;
    const double at_nm = device_.height_nm();
    number(Role::kData, {AfmOp::kFloor, {at_nm - 5}}, ReadingKind::kDone);
    ask(Role::kMotion, {AfmOp::kMoveZ, {at_nm - 15}});  // refused, or held at the floor
    wait(0.005);
    want(device_.height_nm() > at_nm - 5 - kHeightNm, "a move goes below the floor", device_.height_nm(),
         at_nm - 5);
    number(Role::kData, {AfmOp::kFloor, {at_nm - 400}}, ReadingKind::kDone);
    move_z(at_nm - 15);
    want(device_.height_nm() < at_nm - 10, "a floor that was lowered still holds");
  }
  void withdraw() {
    if (pressed_) move_z(surface_nm_);
    number(Role::kEmergency, {AfmOp::kWithdraw}, ReadingKind::kDone);
    wait(1);
    // A withdrawal may end at nine tenths of the range.
    want(device_.height_nm() > 0.9 * top_nm_ - 1, "withdrawn", device_.height_nm(), top_nm_);
    want(std::fabs(device_.force_nn()) < 1, "withdrawn, and it still touches", device_.force_nn(), 0);
    const double told_nm = height();
    want(std::fabs(told_nm - device_.height_nm()) < kHeightNm, "the height when withdrawn", told_nm,
         device_.height_nm());
    const auto status = ask(Role::kData, {AfmOp::kAskStatus});
    want(status && status->status == AfmStatus::kOff, "the status when withdrawn");
  }
  void give_back() {
    const double before_nm = device_.height_nm();
    for (std::size_t i = 0; i < port_.give_back_steps(); ++i)
      ask(port_.give_back_role(i), {AfmOp::kGiveBack, {static_cast<double>(i)}});
    want(std::fabs(device_.height_nm() - before_nm) < kHeightNm, "giving back moves the tip");
  }
  void garbage_is_no_answer() {
    port_.reset(Role::kReads);
    port_.encode(Role::kReads, {AfmOp::kRead});
    port_.feed(Role::kReads, std::vector<std::uint8_t>(200, 0xa5));
    AfmReading reading;
    want(port_.next(Role::kReads, reading) == AfmPort::Next::kBroken, "garbage is taken for an answer");
    port_.reset(Role::kReads);
    want(!std::isnan(bending()), "no answer after a reset");
  }

  AfmPort& port_;
  PortDevice& device_;
  const AfmConfig& config_;
  std::int64_t now_ns_ = 0;
  double top_nm_ = 0, free_nm_ = 0, surface_nm_ = 0;
  bool pressed_ = false;
  std::vector<std::string> faults_;
};

}  // namespace

std::vector<std::string> conformance_faults(AfmPort& port, PortDevice& device, const AfmConfig& config) {
  return Suite(port, device, config).run();
}

}  // namespace telenano::afm

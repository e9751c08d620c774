#include "tests/studies/stress/mutants.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/common/control/methods.h"
#include "tests/studies/stress/wrong_twin.h"

namespace telenano::studies::stress {
namespace {

using control::Method;
using control::MethodConfig;
using control::PortInterval;
using control::RenderPoint;
using control::SlaveNews;
using control::SlaveOrder;
using control::StationMethod;

/// Everything as the right one does it; each mutant changes one thing.
class Around : public StationMethod {
 public:
  explicit Around(Method method) : methods_(method, MethodConfig{}) {}
  void take_over(double account_j, const MethodConfig& config, const Vec3& pos) noexcept override {
    config_ = config;
    pos_ = pos;
    right().take_over(account_j, config, pos);
  }
  void begin_session(bool new_epoch) noexcept override { right().begin_session(new_epoch); }
  void account_for(const PortInterval& interval) noexcept override { right().account_for(interval); }
  void on_reply(const SlaveNews& news) noexcept override { right().on_reply(news); }
  Vec3 force_h_n(const RenderPoint& at) noexcept override { return right().force_h_n(at); }
  Vec3 damper_force_h_n() const noexcept override { return right().damper_force_h_n(); }
  double damper_n_s_m() const noexcept override { return right().damper_n_s_m(); }
  double force_bound_n() const noexcept override { return right().force_bound_n(); }
  double account_j() const noexcept override { return right().account_j(); }
  void fill_command(SlaveOrder& order) const noexcept override { right().fill_command(order); }

 protected:
  StationMethod& right() noexcept { return methods_.now(); }
  const StationMethod& right() const noexcept { return methods_.now(); }
  const MethodConfig& config() const noexcept { return config_; }
  const Vec3& pos_h_m() const noexcept { return pos_; }
  void at(const PortInterval& interval) noexcept { pos_ = interval.hand_pos_h_m; }

 private:
  control::Methods methods_;
  MethodConfig config_;
  Vec3 pos_ = Vec3::Zero();
};

class WrongIndex final : public Around {
 public:
  using Around::Around;
  void account_for(const PortInterval& interval) noexcept override {
    // With the force that was committed at its end, the last interval's motion.
    PortInterval wrong = interval;
    wrong.put_in_j = -interval.applied_force_h_n.dot(last_m_);
    last_m_ = interval.displacement_h_m;
    right().account_for(wrong);
  }

 private:
  Vec3 last_m_ = Vec3::Zero();
};

class CreditedDamping final : public Around {
 public:
  using Around::Around;
  void account_for(const PortInterval& interval) noexcept override {
    PortInterval wrong = interval;
    wrong.put_in_j +=
        config().passivity.damping_certain_n_s_m * interval.displacement_h_m.squaredNorm() / interval.dt_s;
    right().account_for(wrong);
  }
};

class MissingEpoch final : public Around {
 public:
  using Around::Around;
  void account_for(const PortInterval& interval) noexcept override {
    at(interval);
    right().account_for(interval);
  }
  void begin_session(bool new_epoch) noexcept override {
    right().begin_session(new_epoch);
    if (new_epoch) right().take_over(0, config(), pos_h_m());
  }
};

class HeldWave final : public Around {
 public:
  using Around::Around;
  void on_reply(const SlaveNews& news) noexcept override {
    last_ = news;
    heard_ = true;
    right().on_reply(news);
  }
  Vec3 force_h_n(const RenderPoint& at) noexcept override {
    if (!heard_) right().on_reply(last_);
    heard_ = false;
    return right().force_h_n(at);
  }

 private:
  SlaveNews last_;
  bool heard_ = false;
};

class UncappedDamper : public Around {
 public:
  using Around::Around;
  void account_for(const PortInterval& interval) noexcept override {
    right().account_for(interval);
    damper_n_s_m_ = 0;
    damper_h_n_.setZero();
    const double moved_m2 = interval.displacement_h_m.squaredNorm();
    if (!(right().account_j() < 0) || !(moved_m2 > 1e-18)) return;
    damper_n_s_m_ = -right().account_j() * interval.dt_s / moved_m2;
    damper_h_n_ = -damper_n_s_m_ / interval.dt_s * interval.displacement_h_m;
  }
  Vec3 damper_force_h_n() const noexcept override { return damper_h_n_; }
  double damper_n_s_m() const noexcept override { return damper_n_s_m_; }

 private:
  double damper_n_s_m_ = 0;
  Vec3 damper_h_n_ = Vec3::Zero();
};

class NoClamp final : public Around {
 public:
  using Around::Around;
  double force_bound_n() const noexcept override { return std::numeric_limits<double>::infinity(); }
};

class DamperAfterClamp final : public UncappedDamper {
 public:
  using UncappedDamper::UncappedDamper;
  Vec3 force_h_n(const RenderPoint& at) noexcept override {
    const Vec3 force = right().force_h_n(at);
    const double norm = force.norm(), bound = right().force_bound_n();
    return norm > bound ? Vec3(force * (bound / norm)) : force;
  }
  double damper_n_s_m() const noexcept override { return 0; }
  double force_bound_n() const noexcept override { return std::numeric_limits<double>::infinity(); }
};

class HalfVelocity final : public Around {
 public:
  using Around::Around;
  void take_over(double account_j, const MethodConfig& config, const Vec3& pos) noexcept override {
    MethodConfig wrong = config;
    wrong.passivity.velocity_max_m_s *= 0.5;
    Around::take_over(account_j, wrong, pos);
  }
};

class FreeTank final : public Around {
 public:
  using Around::Around;
  void account_for(const PortInterval& interval) noexcept override {
    right().account_for(interval);
    sent_j_ += std::max(0.0, interval.put_in_j);
  }
  void fill_command(SlaveOrder& order) const noexcept override {
    right().fill_command(order);
    order.energy_sent_j += sent_j_;
  }

 private:
  double sent_j_ = 0;
};

/// A change of scale or method, with another balance than is owed.
class WrongChange final : public Around {
 public:
  WrongChange(Method method, double granted_j, bool forgives)
      : Around(method), granted_j_(granted_j), forgives_(forgives) {}
  void take_over(double account_j, const MethodConfig& config, const Vec3& pos) noexcept override {
    if (begun_) account_j = granted_j_ + (forgives_ ? std::max(0.0, account_j) : account_j);
    begun_ = true;
    Around::take_over(account_j, config, pos);
  }

 private:
  double granted_j_;
  bool forgives_;
  bool begun_ = false;
};

class HalfForce final : public Around {
 public:
  using Around::Around;
  Vec3 force_h_n(const RenderPoint& at) noexcept override { return 0.5 * right().force_h_n(at); }
};

/// A device that does not do what it is told; it reports what it really applies, as every device must. Or one that is right, and
/// not what a wrong station makes of it.
class MutantDevice final : public support::VirtualHand {
 public:
  MutantDevice(std::shared_ptr<support::VirtualHand> right, Mutant mutant)
      : right_(std::move(right)), mutant_(mutant) {}
  const device::DeviceInfo& info() const noexcept override { return right_->info(); }
  void read(device::DeviceReading& reading) noexcept override {
    right_->read(reading);
    if (mutant_ == Mutant::kStationHoldsClutch) reading.buttons &= ~std::uint32_t{device::kButtonClutch};
    if (mutant_ == Mutant::kStationHoldsStop) reading.buttons &= ~std::uint32_t{device::kButtonStop};
    if (mutant_ == Mutant::kStationFar) reading.hand_pos_h_m *= 1.1;
    if (mutant_ == Mutant::kStationSwapped) std::swap(reading.hand_pos_h_m.x(), reading.hand_pos_h_m.y());
  }
  Vec3 write_force(const Vec3& force_h_n) noexcept override {
    Vec3 wrong_h_n = force_h_n;
    const double norm_n = force_h_n.norm();
    if (mutant_ == Mutant::kDoubleForce) wrong_h_n *= 2;
    if (mutant_ == Mutant::kStickyForce && norm_n < 0.02 && last_h_n_.norm() > 0.05) wrong_h_n = last_h_n_;
    if (mutant_ == Mutant::kLeapOnResume && norm_n > 0 && last_h_n_.norm() == 0) wrong_h_n *= 100;
    last_h_n_ = wrong_h_n;
    return right_->write_force(wrong_h_n);
  }
  void advance(std::int64_t dt_ns) noexcept override { right_->advance(dt_ns); }
  void start_motion() noexcept override { right_->start_motion(); }

 private:
  std::shared_ptr<support::VirtualHand> right_;
  Mutant mutant_;
  Vec3 last_h_n_ = Vec3::Zero();
};

}  // namespace

MutantInfo mutant_info(Mutant mutant) noexcept {
  if (mutant == Mutant::kStationNoTrip) return {mutant, Method::kNone};
  if (mutant >= Mutant::kStationHoldsClutch) return {mutant, Method::kModel};
  if (mutant == Mutant::kHeldWave) return {mutant, Method::kWave};
  if (mutant == Mutant::kFreeTank) return {mutant, Method::kTank};
  if (mutant == Mutant::kCreditedDamping || mutant == Mutant::kNoClamp || mutant == Mutant::kHalfVelocity ||
      mutant == Mutant::kUncappedDamper || mutant == Mutant::kMissingEpoch ||
      mutant == Mutant::kDamperAfterClamp || mutant == Mutant::kWrongIndex)
    return {mutant, Method::kKsClamp};
  if (mutant == Mutant::kForgivingChange || mutant == Mutant::kGenerousChange)
    return {mutant, Method::kKsClamp};
  if (mutant == Mutant::kKsHalf) return {mutant, Method::kKs};
  if (mutant == Mutant::kClampHalf) return {mutant, Method::kKsClamp};
  if (mutant == Mutant::kTdpaHalf) return {mutant, Method::kTdpa};
  if (mutant == Mutant::kWaveHalf) return {mutant, Method::kWave};
  if (mutant == Mutant::kRecordEnergy || mutant == Mutant::kRecordForce) return {mutant, Method::kModel};
  if (WrongTwin::concerns(mutant)) return {mutant, Method::kTwin};
  // What the gate leaves out is seen best by what shows each reply as it is.
  if (mutant >= Mutant::kGateCreeping) return {mutant, Method::kNone};
  // What is recorded does not depend on the method, but only some make a difference between wanted and acted.
  if (mutant >= Mutant::kRecordLate) return {mutant, Method::kKsClamp};
  // What the slave says is seen best by what shows it as it is.
  if (mutant >= Mutant::kSlaveNoForce) return {mutant, Method::kNone};
  return {mutant, Method::kModel};
}

std::unique_ptr<StationMethod> make_mutant_method(const RunSpec& spec) {
  switch (spec.mutant) {
    case Mutant::kWrongIndex:
      return std::make_unique<WrongIndex>(spec.method);
    case Mutant::kCreditedDamping:
      return std::make_unique<CreditedDamping>(spec.method);
    case Mutant::kMissingEpoch:
      return std::make_unique<MissingEpoch>(spec.method);
    case Mutant::kHeldWave:
      return std::make_unique<HeldWave>(spec.method);
    case Mutant::kUncappedDamper:
      return std::make_unique<UncappedDamper>(spec.method);
    case Mutant::kNoClamp:
      return std::make_unique<NoClamp>(spec.method);
    case Mutant::kDamperAfterClamp:
      return std::make_unique<DamperAfterClamp>(spec.method);
    case Mutant::kHalfVelocity:
      return std::make_unique<HalfVelocity>(spec.method);
    case Mutant::kFreeTank:
      return std::make_unique<FreeTank>(spec.method);
    case Mutant::kForgivingChange:
      return std::make_unique<WrongChange>(spec.method, 0.0, true);
    case Mutant::kGenerousChange:
      return std::make_unique<WrongChange>(spec.method, 0.010, false);
    case Mutant::kKsHalf:
    case Mutant::kClampHalf:
    case Mutant::kTdpaHalf:
    case Mutant::kWaveHalf:
      return std::make_unique<HalfForce>(spec.method);
    default:
      return nullptr;
  }
}

std::shared_ptr<support::VirtualHand> with_mutant(std::shared_ptr<support::VirtualHand> device,
                                                  Mutant mutant) {
  switch (mutant) {
    case Mutant::kStickyForce:
    case Mutant::kLeapOnResume:
    case Mutant::kDoubleForce:
    case Mutant::kStationHoldsClutch:
    case Mutant::kStationHoldsStop:
    case Mutant::kStationFar:
    case Mutant::kStationSwapped:
      return std::make_shared<MutantDevice>(std::move(device), mutant);
    default:
      return device;
  }
}

}  // namespace telenano::studies::stress

#include "tests/studies/fidelity/renderer_mutants.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "telenano/common/control/model_method.h"
#include "telenano/common/control/model_renderer.h"

namespace telenano::studies::fidelity {
namespace {

using control::MethodConfig;
using control::PortInterval;
using control::RenderPoint;
using control::SlaveNews;
using control::StationMethod;

constexpr double kTiltRad = 10 * kPi / 180;
constexpr double kSoftPart = 0.3;
constexpr double kLowNm = 3;
constexpr std::size_t kLateTicks = 100;  // at 1 kHz: 100 ms

class LocalSample final : public StationMethod {
 public:
  LocalSample(const control::Scaling& scaling, std::unique_ptr<slave::Slave> sample)
      : scaling_(scaling), sample_(std::move(sample)) {}
  void take_over(double, const MethodConfig& config, const Vec3&) noexcept override {
    scaling_ = config.scaling;
  }
  void begin_session(bool) noexcept override {}
  void account_for(const PortInterval&) noexcept override {}
  void on_reply(const SlaveNews&) noexcept override {}
  Vec3 force_h_n(const RenderPoint& at) noexcept override {
    slave::SlaveInput input;
    input.tip_target_pos_w_nm = at.target_w_nm;
    sample_->step(input, at.dt_s, output_);
    return scaling_.hand_force_n(output_.force_w_nn);
  }
  double account_j() const noexcept override { return 0; }

 private:
  control::Scaling scaling_;
  std::unique_ptr<slave::Slave> sample_;
  slave::SlaveOutput output_;
};

/// Knows the sample until it touches it, and from then on only what it was like there and then.
class FirstPlane final : public StationMethod {
 public:
  FirstPlane(const control::Scaling& scaling, std::unique_ptr<slave::Slave> sample)
      : scaling_(scaling), sample_(std::move(sample)) {}
  void take_over(double, const MethodConfig& config, const Vec3&) noexcept override {
    scaling_ = config.scaling;
  }
  void begin_session(bool) noexcept override {}
  void account_for(const PortInterval&) noexcept override {}
  void on_reply(const SlaveNews&) noexcept override {}
  Vec3 force_h_n(const RenderPoint& at) noexcept override {
    if (output_.contact_state != link::ContactState::kContact) {
      slave::SlaveInput input;
      input.tip_target_pos_w_nm = at.target_w_nm;
      input.wants_model = true;
      sample_->step(input, at.dt_s, output_);
      const link::LocalModel& m = output_.model;
      control::ContactPlane model;
      model.version = m.version;
      model.point_w_nm = m.point_w_nm;
      model.normal_w = m.normal_w;
      model.stiffness_n_m = m.stiffness_n_m;
      model.adhesion_nn = m.adhesion_nn;
      model.shear_stiffness_n_m = m.shear_stiffness_n_m;
      model.friction_nn = m.friction_nn;
      plane_.on_reply(model, output_.contact_state == link::ContactState::kContact, at.command);
    }
    return scaling_.hand_force_n(plane_.force_w_nn(at.target_w_nm, at.command, 1e30, 1e30));
  }
  double account_j() const noexcept override { return 0; }

 private:
  control::Scaling scaling_;
  std::unique_ptr<slave::Slave> sample_;
  slave::SlaveOutput output_;
  control::ModelRenderer plane_{1e30};
};

/// Another method's, wrong in one way.
class Wrong final : public StationMethod {
 public:
  Wrong(WrongRenderer wrong, std::unique_ptr<StationMethod> right, double ground_w_nm)
      : wrong_(wrong), right_(std::move(right)), ground_w_nm_(ground_w_nm) {}
  void take_over(double account_j, const MethodConfig& config, const Vec3& pos) noexcept override {
    right_->take_over(account_j, config, pos);
  }
  void begin_session(bool new_epoch) noexcept override { right_->begin_session(new_epoch); }
  void account_for(const PortInterval& interval) noexcept override { right_->account_for(interval); }
  void on_reply(const SlaveNews& news) noexcept override {
    SlaveNews told = news;
    if (wrong_ == WrongRenderer::kFirstModel) {
      if (first_.version == 0 && news.touching) first_ = news.model;
      if (first_.version != 0) told.model = first_;
    }
    right_->on_reply(told);
  }
  Vec3 force_h_n(const RenderPoint& at) noexcept override {
    RenderPoint place = at;
    double& z_nm = place.target_w_nm.z();
    if (wrong_ == WrongRenderer::kSoft)
      z_nm = ground_w_nm_ + (z_nm < ground_w_nm_ ? kSoftPart : 1) * (z_nm - ground_w_nm_);
    if (wrong_ == WrongRenderer::kLow) z_nm += kLowNm;
    const Vec3 force = right_->force_h_n(place);
    switch (wrong_) {
      case WrongRenderer::kZero:
        return Vec3::Zero();
      case WrongRenderer::kHalf:
        return 0.5 * force;
      case WrongRenderer::kLate: {
        const Vec3 old = std::exchange(past_[next_], force);
        next_ = (next_ + 1) % past_.size();
        return old;
      }
      case WrongRenderer::kNoAdhesion:
        return {force.x(), force.y(), std::max(0.0, force.z())};
      case WrongRenderer::kNoFriction:
        return {0, 0, force.z()};
      case WrongRenderer::kTilted: {
        const double c = std::cos(kTiltRad), s = std::sin(kTiltRad);
        return {c * force.x() + s * force.z(), force.y(), c * force.z() - s * force.x()};
      }
      case WrongRenderer::kReversed:
        return {-force.x(), force.y(), force.z()};
      default:
        return force;
    }
  }
  Vec3 damper_force_h_n() const noexcept override { return right_->damper_force_h_n(); }
  double damper_n_s_m() const noexcept override { return right_->damper_n_s_m(); }
  double force_bound_n() const noexcept override { return right_->force_bound_n(); }
  double account_j() const noexcept override { return right_->account_j(); }
  void fill_command(control::SlaveOrder& order) const noexcept override { right_->fill_command(order); }

 private:
  WrongRenderer wrong_;
  std::unique_ptr<StationMethod> right_;
  double ground_w_nm_;
  control::ContactPlane first_;
  std::array<Vec3, kLateTicks> past_ = [] {
    std::array<Vec3, kLateTicks> none;
    none.fill(Vec3::Zero());
    return none;
  }();
  std::size_t next_ = 0;
};

}  // namespace

std::string_view wrong_renderer_name(WrongRenderer wrong) noexcept {
  static constexpr std::string_view kNames[] = {"none",        "zero",        "half",    "late",
                                                "no-adhesion", "no-friction", "tilted",  "soft",
                                                "low",         "first-model", "reversed"};
  return kNames[static_cast<std::size_t>(wrong)];
}

std::unique_ptr<StationMethod> local_sample(WrongRenderer wrong, const control::Scaling& scaling,
                                            std::unique_ptr<slave::Slave> sample) {
  if (wrong == WrongRenderer::kFirstModel) return std::make_unique<FirstPlane>(scaling, std::move(sample));
  const double ground_w_nm = sample->limits().surface_z_w_nm;
  auto right = std::make_unique<LocalSample>(scaling, std::move(sample));
  if (wrong == WrongRenderer::kNone) return right;
  return std::make_unique<Wrong>(wrong, std::move(right), ground_w_nm);
}

std::unique_ptr<StationMethod> wrong_model(WrongRenderer wrong, double ground_w_nm) {
  return std::make_unique<Wrong>(wrong, std::make_unique<control::ModelMethod>(MethodConfig{}), ground_w_nm);
}

}  // namespace telenano::studies::fidelity

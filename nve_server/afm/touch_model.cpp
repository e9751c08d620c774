#include "telenano/nve_server/afm/touch_model.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "telenano/common/base/det_math.h"

namespace telenano::afm {
namespace {

constexpr double kPriorReadings = 5;
constexpr double kWellKnown = 4;  // times the prior: becomes the prior
constexpr double kLeastPart = 0.02;

}  // namespace

TouchModel::TouchModel(double lever_n_m, double noise_nn, double contact_nn, double slope_max) noexcept
    : lever_n_m_(lever_n_m),
      noise_nn_(noise_nn),
      contact_nn_(contact_nn),
      slope_max_(slope_max),
      stiffness_n_m_(kFirstPart * lever_n_m),
      known_n_m_(stiffness_n_m_) {}

void TouchModel::forget_place() noexcept {
  count_ = 0;
  touching_ = false;
  slope_.setZero();
  known_slope_.setZero();
}

void TouchModel::fit() noexcept {
  const std::size_t n = std::min(count_, kKept);
  const Entry& newest = entries_[(count_ - 1) % kKept];
  using Vec4 = Eigen::Vector4d;
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Vec4 right = Vec4::Zero();
  // Prior of K, B, C; none of F₀.
  const double weigh_k = kPriorReadings * kSpread_nm * kSpread_nm;
  const double weigh_b = kPriorReadings * kSlopeSpread_nm * kSlopeSpread_nm;
  normal(1, 1) = weigh_k;
  right(1) = weigh_k * known_n_m_;
  for (int i = 0; i < 2; ++i) {
    normal(2 + i, 2 + i) = weigh_b;
    right(2 + i) = weigh_b * known_n_m_ * known_slope_[i];
  }
  for (std::size_t i = 1; i <= n; ++i) {
    const Entry& e = entries_[(count_ - i) % kKept];
    const Vec3 d = e.base_w_nm - newest.base_w_nm;
    const double age_s = 1e-9 * static_cast<double>(newest.time_ns - e.time_ns);
    const double far = d.head<2>().squaredNorm() / (2 * kReach_nm * kReach_nm);
    const double weight = det_exp(-std::min(age_s / kMemory_s + far, 50.0));
    const Vec4 row(1, -d.z(), d.x(), d.y());
    normal += weight * row * row.transpose();
    right += weight * e.force_nn * row;
  }
  const Vec4 fitted = normal.ldlt().solve(right);
  if (!fitted.allFinite()) return;
  stiffness_n_m_ = std::clamp(fitted(1), kLeastPart * lever_n_m_, lever_n_m_);
  for (int i = 0; i < 2; ++i) slope_[i] = std::clamp(fitted(2 + i) / stiffness_n_m_, -slope_max_, slope_max_);
  // What these readings alone say of K and of the slopes: their spread about their mean.
  const auto spread = [&](int i, double prior) {
    return normal(i, i) - prior - normal(0, i) * normal(0, i) / normal(0, 0);
  };
  if (spread(1, weigh_k) > kWellKnown * weigh_k) known_n_m_ = stiffness_n_m_;
  for (int i = 0; i < 2; ++i) {
    if (spread(2 + i, weigh_b) > kWellKnown * weigh_b) known_slope_[i] = slope_[i];
  }
}

void TouchModel::anchor(const Vec3& base_w_nm, double force_nn) noexcept {
  const Vec3 normal = Vec3(-slope_.x(), -slope_.y(), 1).normalized();
  model_.normal_w = normal;
  model_.stiffness_n_m = stiffness_n_m_ / (normal.z() * normal.z());
  model_.adhesion_nn = adhesion_nn_;
  model_.point_w_nm = base_w_nm + normal * (force_nn / (model_.stiffness_n_m * normal.z()));
  ++model_.version;
  if (model_.version == 0) model_.version = 1;
}

void TouchModel::add(const Vec3& base_w_nm, double force_nn, std::int64_t time_ns) noexcept {
  const double threshold = contact_threshold_nn();
  if (force_nn > threshold) {
    touching_ = true;
    entries_[count_++ % kKept] = {base_w_nm, force_nn, time_ns};
    fit();
    anchor(base_w_nm, force_nn);
  } else if (touching_ && force_nn < -threshold) {
    adhesion_nn_ = std::max(adhesion_nn_, -force_nn);
    anchor(base_w_nm, force_nn);
  } else {
    // Free, or about to be. While it touches a force near zero is on its way through it.
    if (touching_) {
      const double depth = model_.normal_w.dot(model_.point_w_nm - base_w_nm);
      if (depth * model_.stiffness_n_m < -adhesion_nn_ - threshold) touching_ = false;
    }
    if (model_.version == 0) return;
    const double depth = model_.normal_w.dot(model_.point_w_nm - base_w_nm);
    if (depth * model_.stiffness_n_m > 2 * threshold) {
      touching_ = false;
      anchor(base_w_nm, 0);
    }
  }
}

Vec3 TouchModel::force_w_nn(const Vec3& base_w_nm) const noexcept {
  if (model_.version == 0) return Vec3::Zero();
  const double depth = model_.normal_w.dot(model_.point_w_nm - base_w_nm);
  double force = model_.stiffness_n_m * depth;
  if (force < 0 && (!touching_ || force < -model_.adhesion_nn)) force = 0;
  return force * model_.normal_w;
}

}  // namespace telenano::afm

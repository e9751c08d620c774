#include "tests/studies/zwidth/sampled_loop.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace telenano::studies {

HeldMotion held_motion(double mass, double damping, double stiffness, double period) {
  // exp of [0 1 0; −k/m −c/m 1/m; 0 0 0] T by scaling and squaring of the Taylor series.
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  a(0, 1) = period;
  a(1, 0) = -stiffness / mass * period;
  a(1, 1) = -damping / mass * period;
  a(1, 2) = period / mass;
  const double size = a.cwiseAbs().rowwise().sum().maxCoeff();
  const int halvings = std::max(0, static_cast<int>(std::ceil(std::log2(std::max(size, 1e-300)))) + 4);
  a *= std::ldexp(1.0, -halvings);
  Eigen::Matrix3d sum = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d term = Eigen::Matrix3d::Identity();
  for (int i = 1; i <= 14; ++i) {  // norm <= 1/16: the rest is below 1e-28
    term = term * a / i;
    sum += term;
  }
  for (int i = 0; i < halvings; ++i) sum = (sum * sum).eval();
  return {sum(0, 0), sum(0, 1), sum(0, 2), sum(1, 0), sum(1, 1), sum(1, 2)};
}

double spectral_radius(const control::HapticDisplay& display, const control::VirtualDamper& damper,
                       double wall, const Hand& hand) {
  const HeldMotion h = held_motion(display.mass_kg + hand.mass_kg, display.damping_n_s_m + hand.damping_n_s_m,
                                   hand.stiffness_n_m, display.period_s);
  // State: x, v (in units of 1/T), last x, filtered velocity times T, forces under way f(k−1) … f(k−d) over
  // K0.
  const double unit = std::max(wall, 1.0);
  const double period = display.period_s;
  const int d = damper.delay_samples;
  const int n = 4 + d;
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  Eigen::RowVectorXd velocity = Eigen::RowVectorXd::Zero(n);  // of this sample, times T
  const double divisor = damper.filter_s + period;
  velocity(0) = period / divisor;
  velocity(2) = -period / divisor;
  velocity(3) = damper.filter_s / divisor;
  Eigen::RowVectorXd force = damper.damping_n_s_m / period / unit * velocity;
  force(0) += wall / unit;
  Eigen::RowVectorXd applied = force;
  if (d > 0) {
    applied.setZero();
    applied(3 + d) = 1.0;
  }
  a(0, 0) = h.xx;
  a(0, 1) = h.xv / period;
  a.row(0) -= h.xf * unit * applied;
  a(1, 0) = h.vx * period;
  a(1, 1) = h.vv;
  a.row(1) -= h.vf * period * unit * applied;
  a(2, 0) = 1.0;
  a.row(3) = velocity;
  if (d > 0) a.row(4) = force;
  for (int i = 1; i < d; ++i) a(4 + i, 3 + i) = 1.0;
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(a, false);
  return solver.eigenvalues().cwiseAbs().maxCoeff();
}

double stability_limit(const control::HapticDisplay& display, const control::VirtualDamper& damper,
                       const Hand& hand) {
  const double mass = display.mass_kg + hand.mass_kg;
  const double b = display.damping_n_s_m + hand.damping_n_s_m;
  const double b_of_wall = std::fabs(damper.damping_n_s_m);
  const double scale = 2.0 * display.damping_n_s_m / display.period_s;
  const double top = 20.0 * (mass / (display.period_s * display.period_s) +
                             (b + b_of_wall) / display.period_s + hand.stiffness_n_m + scale);
  // A mode that barely moves in a period sits next to 1: its distance is what the damping makes of it.
  const double edge = 1.0 - 1e-13;
  const auto stable = [&](double k) { return spectral_radius(display, damper, k, hand) < edge; };
  double low = 1e-4 * scale;
  if (!stable(low)) return std::numeric_limits<double>::quiet_NaN();
  // What is passive is stable with every hand: the search may begin there, which a long delay makes dear.
  const double passive = 0.99 * control::passive_stiffness(display, damper);
  if (passive > low) low = passive;
  double high = low;
  while (true) {
    high = 1.02 * low;
    if (!stable(high)) break;
    low = high;
    if (low > top) return std::numeric_limits<double>::infinity();
  }
  while (high - low > 1e-9 * high) {
    const double middle = 0.5 * (low + high);
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace telenano::studies

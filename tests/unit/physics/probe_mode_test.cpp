#include "telenano/nve_server/physics/probe/probe_mode.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <functional>

#include "tests/support/alloc_guard.h"

namespace telenano::physics {
namespace {

// One step against a contact of stiffness K whose force is −K (q − rest): q₁ = shift + compliance Φ₁.
void step_on_spring(const ProbeMode& mode, const ModePropagator& over, double k, double rest,
                    ModeState& state) {
  const ModeStep step = mode.begin(over, state, k);
  const double force = -k * (step.shift_nm - rest) / (1 + k * step.compliance_nm_nn);
  mode.finish(step, force, state);
}

// Second by second against the closed form of a damped oscillator, in amplitude and phase.
TEST(ProbeMode, RingsDownExactly) {
  for (const double f0_dt : {1e-3, 0.03, 0.1, 0.159}) {
    for (const double quality : {0.6, 3.0, 250.0, 1e5}) {
      const double f0 = 2e4, dt = f0_dt / f0;
      const ProbeMode mode(2.0, f0, quality);
      const ModePropagator over = mode.over(dt);
      ASSERT_EQ(over.integrator, ModeIntegrator::kMeanForce);
      ModeState state{5.0, -1e5, 0};
      const double w = 2 * M_PI * f0, gamma = w / (2 * quality), wd = std::sqrt(w * w - gamma * gamma);
      double damped = 0;
      const double energy = mode.energy_aj(state);
      for (int i = 1; i <= 1000; ++i) {
        damped += mode.finish(mode.begin(over, state, 0), 0, state).damped_aj;
        const double t = i * dt, decay = std::exp(-gamma * t);
        const double q = decay * (5 * std::cos(wd * t) + (-1e5 + gamma * 5) / wd * std::sin(wd * t));
        const double v =
            decay * (-1e5 * std::cos(wd * t) - (w * w * 5 + gamma * -1e5) / wd * std::sin(wd * t));
        // 1000 steps of some ulp each, on 5 nm: 1e-12 leaves a factor of ten.
        ASSERT_NEAR(state.deflection_nm, q, 1e-11) << f0_dt << " " << quality << " " << i;
        ASSERT_NEAR(state.velocity_nm_s / w, v / w, 1e-11);
        ASSERT_NEAR(mode.energy_aj(state) + damped, energy, 1e-10 * energy);
      }
    }
  }
}

// The mode on a linear spring is another oscillator: k + K, the same mass and damping. Its closed form.
double on_spring(double k, double contact, double f0, double quality, double rest, double t) {
  const double w0 = 2 * M_PI * f0, gamma = w0 / (2 * quality);
  const double w = std::sqrt(w0 * w0 * (k + contact) / k - gamma * gamma);
  const double settled = contact * rest / (k + contact);
  return settled * (1 - std::exp(-gamma * t) * (std::cos(w * t) + gamma / w * std::sin(w * t)));
}

double step_response_error(ModeIntegrator integrator, double contact, int steps) {
  const double k = 2.0, f0 = 2e4, quality = 50, t_end = 2 / f0;
  const ProbeMode mode(k, f0, quality);
  const ModePropagator over = mode.over(t_end / steps, integrator);
  ModeState state;
  state.force_nn = contact * 3.0;  // the spring is there from the first moment
  double worst = 0;
  for (int i = 1; i <= steps; ++i) {
    step_on_spring(mode, over, contact, 3.0, state);
    worst = std::max(
        worst, std::abs(state.deflection_nm - on_spring(k, contact, f0, quality, 3.0, i * t_end / steps)));
  }
  return worst;
}

// The order of each method: halving the step divides the error by 2 or 4, to 15 % at these steps.
TEST(ProbeMode, StepResponseOnASpringConvergesToTwoSprings) {
  for (const double contact : {0.5, 6.0, -0.8}) {
    const auto ratio = [&](ModeIntegrator integrator) {
      return step_response_error(integrator, contact, 2000) / step_response_error(integrator, contact, 4000);
    };
    EXPECT_NEAR(ratio(ModeIntegrator::kBackwardEuler), 2, 0.3) << contact;
    EXPECT_NEAR(ratio(ModeIntegrator::kHeldForce), 2, 0.3) << contact;
    EXPECT_NEAR(ratio(ModeIntegrator::kMeanForce), 4, 0.6) << contact;
    EXPECT_LT(step_response_error(ModeIntegrator::kMeanForce, contact, 4000),
              0.05 * step_response_error(ModeIntegrator::kHeldForce, contact, 4000));
  }
}

// The largest eigenvalue of a step, from the step itself: columns are what it makes of (1, 0) and (0, 1).
double growth(const ProbeMode& mode, const ModePropagator& over, double contact, double speed_scale) {
  std::array<std::array<double, 2>, 2> m{};
  for (int column = 0; column < 2; ++column) {
    ModeState state{column == 0 ? 1.0 : 0.0, column == 0 ? 0.0 : speed_scale, 0};
    state.force_nn = -contact * state.deflection_nm;
    step_on_spring(mode, over, contact, 0, state);
    m[0][static_cast<std::size_t>(column)] = state.deflection_nm;
    m[1][static_cast<std::size_t>(column)] = state.velocity_nm_s / speed_scale;
  }
  const std::complex<double> half = 0.5 * (m[0][0] + m[1][1]);
  const std::complex<double> root = std::sqrt(half * half - (m[0][0] * m[1][1] - m[0][1] * m[1][0]));
  return std::max(std::abs(half + root), std::abs(half - root));
}

TEST(ProbeMode, NeverGrowsOnAnyContactAtAnyRate) {
  for (const double f0 : {1e3, 3e4, 2e6}) {
    for (const double rate : {100.0, 1e3, 4e3, 1e4}) {
      for (const double quality : {0.6, 2.0, 100.0, 1e5}) {
        for (const double k : {0.01, 1.0, 1000.0}) {
          const ProbeMode mode(k, f0, quality);
          const double h = 1 / rate / mode.pieces(1 / rate);
          const ModePropagator over = mode.over(h);
          for (double contact = 1e-3; contact < 2e6; contact *= 2) {
            // A double root moves as the root of an ulp: some 1e-8.
            ASSERT_LE(growth(mode, over, contact, 1 / h), 1 + 1e-7)
                << f0 << " " << rate << " " << quality << " " << k << " " << contact;
          }
          for (double part = 0; part < 0.999; part += 0.09) {
            ASSERT_LE(growth(mode, over, -part * k, 1 / h), 1 + 1e-7) << f0 << " " << rate << " " << part;
          }
        }
      }
    }
  }
}

// A contact that the step does not resolve is held: nothing of the impact is left, neither motion nor a force
// that changes its sign from step to step. The method with the end's force held instead bounces on, which is
// why it is not the one used.
TEST(ProbeMode, IsHeldByAContactThatIsTooHardToResolve) {
  const ProbeMode mode(1.0, 1e4, 300);
  const double h = 1e-5;
  const auto after_impact = [&](ModeIntegrator integrator) {
    const ModePropagator over = mode.over(h, integrator);
    ModeState state{0, -1e4, 0};
    for (int i = 0; i < 20; ++i) step_on_spring(mode, over, 1e6, 0, state);
    return state;
  };
  // The impact itself: m v/h = 0.25 nN.
  for (const auto integrator : {ModeIntegrator::kMeanForce, ModeIntegrator::kBackwardEuler}) {
    EXPECT_LT(std::abs(after_impact(integrator).velocity_nm_s), 1.0);
    EXPECT_LT(std::abs(after_impact(integrator).force_nn), 1e-3);
  }
  EXPECT_GT(std::abs(after_impact(ModeIntegrator::kHeldForce).velocity_nm_s), 9e3);
}

TEST(ProbeMode, IsTheSpringAloneWhenTheStepIsLong) {
  const ProbeMode mode(0.5, 3e5, 200);
  const double dt = 1e-3;
  EXPECT_EQ(mode.pieces(dt), 1);
  const ModePropagator over = mode.over(dt);
  EXPECT_EQ(over.integrator, ModeIntegrator::kBackwardEuler);
  ModeState state{40, 1e6, 0};
  mode.finish(mode.begin(over, state, 0), 3.0, state);
  // 1/(ω0 dt)² = 3e-7 of the 40 nm, 1/(ω0 dt Q) = 3e-6 of them, and 1e6 nm/s · m/(k dt) = 3e-4 nm.
  EXPECT_NEAR(state.deflection_nm, 6.0, 6e-4);
  // Static balance is a fixed point, whatever the step.
  for (const double h : {1e-7, 1e-6, 1e-3}) {
    const ModePropagator any = mode.over(h);
    ModeState rest{6.0, 0, 3.0};
    step_on_spring(mode, any, 2.0, 7.5, rest);  // −2 (6 − 7.5) = 3 nN
    EXPECT_NEAR(rest.deflection_nm, 6.0, 1e-11) << h;
    EXPECT_NEAR(rest.velocity_nm_s * h, 0, 1e-11) << h;
  }
}

TEST(ProbeMode, CutsAStepWhereThatResolvesIt) {
  const ProbeMode mode(1.0, 5e3, 10);  // ω0 dt = 31.4 at 1 kHz
  EXPECT_EQ(mode.pieces(1e-3), 32);
  EXPECT_TRUE(mode.resolved(1e-3 / 32));
  EXPECT_EQ(mode.pieces(1.1e-3), 1);
  EXPECT_EQ(mode.pieces(1e-6), 1);
  EXPECT_TRUE(mode.resolved(1e-6));
}

// Mass and damper from the definitions, and energy against the work of a force by numbers.
TEST(ProbeMode, AccountsWorkAsStoredAndDamped) {
  const ProbeMode mode(2.0, 1e4, 30);
  EXPECT_NEAR(mode.mass_kg(), 2.0 / std::pow(2 * M_PI * 1e4, 2), 1e-22);
  EXPECT_NEAR(mode.damping_n_s_m(), 2.0 / (2 * M_PI * 1e4 * 30), 1e-18);
  for (const auto integrator :
       {ModeIntegrator::kBackwardEuler, ModeIntegrator::kHeldForce, ModeIntegrator::kMeanForce}) {
    const ModePropagator over = mode.over(1e-6, integrator);
    ModeState state;
    double damped = 0, numerical = 0, work = 0;
    for (int i = 0; i < 3000; ++i) {
      const ModeState before = state;
      const ModeLoss loss = mode.finish(mode.begin(over, state, 0), 4 * std::sin(i * 0.05), state);
      ASSERT_GE(loss.damped_aj, 0);
      damped += loss.damped_aj;
      numerical += loss.numerical_aj;
      work += 0.5 * (state.force_nn + before.force_nn) * (state.deflection_nm - before.deflection_nm);
    }
    // 3000 sums of some 100 aJ.
    EXPECT_NEAR(mode.energy_aj(state) + damped + numerical, work, 1e-10 * work);
    EXPECT_GT(damped, 0);
    // Without contact the mean force's own loss is none; backward Euler's is large.
    if (integrator == ModeIntegrator::kMeanForce) {
      EXPECT_NEAR(numerical, 0, 1e-10 * work);
    } else if (integrator == ModeIntegrator::kBackwardEuler) {
      EXPECT_GT(numerical, 0.1 * damped);
    }
  }
}

TEST(ProbeMode, SlowsDownByWhatItIsTold) {
  const ProbeMode mode(2.0, 1e4, 30);
  ModeState state{1.0, -3e5, 0};
  const double kinetic = mode.kinetic_aj(state);
  EXPECT_EQ(mode.slow_down(-1, state), 0);
  EXPECT_NEAR(mode.slow_down(0.25 * kinetic, state), 0.25 * kinetic, 1e-15);
  EXPECT_NEAR(mode.kinetic_aj(state), 0.75 * kinetic, 1e-14 * kinetic);
  EXPECT_LT(state.velocity_nm_s, 0);
  EXPECT_NEAR(mode.slow_down(kinetic, state), 0.75 * kinetic, 1e-14 * kinetic);
  EXPECT_EQ(state.velocity_nm_s, 0);
  EXPECT_EQ(mode.slow_down(kinetic, state), 0);
}

TEST(ProbeMode, TakesNothingFromTheHeap) {
  const ProbeMode mode(2.0, 1e4, 30);
  ModeState state{1.0, 0, 0};
  const support::AllocGuard guard;
  const ModePropagator over = mode.over(1e-6);
  for (int i = 0; i < 100; ++i) step_on_spring(mode, over, 3, 0, state);
  EXPECT_EQ(guard.allocations(), 0u);
  if (!support::AllocGuard::active()) GTEST_SKIP() << "allocations are not counted in this build";
}

}  // namespace
}  // namespace telenano::physics

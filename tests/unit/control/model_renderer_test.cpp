#include "telenano/common/control/model_renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace telenano::control {
namespace {

constexpr double kPlenty = 1e12;  // energy (aJ) and force (nN) that limit nothing

ContactPlane ground(double stiffness_n_m, double adhesion_nn = 0, double height_nm = 0) {
  ContactPlane model;
  model.version = 1;
  model.point_w_nm = Vec3(0, 0, height_nm);
  model.stiffness_n_m = stiffness_n_m;
  model.adhesion_nn = adhesion_nn;
  return model;
}

// Taken over whole, at a place where that costs nothing.
ModelRenderer renderer_of(const ContactPlane& model, double stiffness_max_n_m = 1e9) {
  ModelRenderer renderer(stiffness_max_n_m);
  renderer.on_reply(model, false, 0);
  renderer.force_w_nn(Vec3(0, 0, 1e3), 1, kPlenty, kPlenty);
  return renderer;
}

Vec3 at(double z_nm, double x_nm = 0) {
  return Vec3(x_nm, 0, z_nm);
}

TEST(ModelRenderer, WithoutAModelThereIsNoForce) {
  ModelRenderer renderer(100);
  EXPECT_EQ(renderer.force_w_nn(at(-5), 1, kPlenty, kPlenty), Vec3::Zero());
  EXPECT_EQ(renderer.potential_aj(at(-5)), 0);
}

TEST(ModelRenderer, AWallIsASpringAlongItsNormal) {
  ContactPlane model = ground(40);
  model.normal_w = Vec3(0.6, 0, 0.8);
  ModelRenderer renderer = renderer_of(model);
  const Vec3 target = at(-5, 2);
  const double depth = -(0.6 * 2 - 0.8 * 5);
  EXPECT_LT((renderer.force_w_nn(target, 2, kPlenty, kPlenty) - 40 * depth * model.normal_w).norm(), 1e-12);
  EXPECT_EQ(renderer.force_w_nn(at(5), 3, kPlenty, kPlenty), Vec3::Zero());
}

TEST(ModelRenderer, NothingIsShownStifferThanTheDeviceCan) {
  ModelRenderer renderer = renderer_of(ground(40), 10);
  EXPECT_NEAR(renderer.force_w_nn(at(-2), 2, kPlenty, kPlenty).z(), 20, 1e-12);
}

TEST(ModelRenderer, AnAdhesiveContactCostsItsClosedFormAroundTheLoop) {
  // Touches at depth 0, lets go at −F/k: the loop costs F²/(2k), independent of the path. Trapezium over
  // steps of 1e-4 nm: exact on lines, but for the step in which the contact lets go (F·step at most).
  const double k = 20, adhesion = 10, step = 1e-4;
  ModelRenderer renderer = renderer_of(ground(k, adhesion));
  double work = 0, last_z = 1, last_f = 0;
  std::uint64_t command = 2;
  const auto go = [&](double z) {
    const double f = renderer.force_w_nn(at(z), command++, kPlenty, kPlenty).z();
    work -= 0.5 * (f + last_f) * (z - last_z);  // by whoever moves the tip
    last_z = z;
    last_f = f;
  };
  for (double z = 1; z > -2; z -= step) go(z);
  for (double z = -2; z < 2; z += step) go(z);
  EXPECT_NEAR(work, adhesion * adhesion / (2 * k), adhesion * step);
}

TEST(ModelRenderer, ForceIsTheSlopeOfThePotential) {
  ContactPlane model = ground(30, 8);
  model.normal_w = Vec3(0.28, 0.0, 0.96);
  ModelRenderer renderer = renderer_of(model);
  renderer.force_w_nn(at(-3, 1), 2, kPlenty, kPlenty);
  const double h = 1e-4;  // U is quadratic: a central difference is exact to rounding, 1e3·1e-16/1e-4
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 up = at(-3, 1), down = up;
    up[axis] += h;
    down[axis] -= h;
    const double slope = (renderer.potential_aj(up) - renderer.potential_aj(down)) / (2 * h);
    EXPECT_NEAR(renderer.force_w_nn(at(-3, 1), 3, kPlenty, kPlenty)[axis], -slope, 1e-8);
  }
}

TEST(ModelRenderer, AStifferModelIsTakenUpAsFarAsItIsPaidFor) {
  ModelRenderer renderer = renderer_of(ground(10));
  const Vec3 target = at(-4);
  renderer.force_w_nn(target, 2, kPlenty, kPlenty);
  const double before = renderer.potential_aj(target);
  ContactPlane stiffer = ground(50);
  stiffer.version = 2;
  renderer.on_reply(stiffer, true, 2);
  const double budget = 37;  // of ½·40·16 = 320 aJ
  renderer.force_w_nn(target, 3, budget, kPlenty);
  EXPECT_LE(renderer.potential_aj(target) - before, budget);
  EXPECT_GT(renderer.potential_aj(target) - before, 0.4 * budget);  // halving leaves at least half of it
  renderer.force_w_nn(target, 4, 0, kPlenty);
  EXPECT_LE(renderer.potential_aj(target) - before, budget);
  for (int i = 0; i < 100; ++i) renderer.force_w_nn(at(1), 5, 0, kPlenty);  // out of the ground it is free
  EXPECT_NEAR(renderer.force_w_nn(target, 6, 0, kPlenty).z(), 200, 1e-9);
}

TEST(ModelRenderer, GroundThatComesUpUnderTheTipIsPaidForToo) {
  ModelRenderer renderer = renderer_of(ground(50, 0, -100));
  renderer.force_w_nn(at(-4), 2, 0, kPlenty);
  EXPECT_FALSE(renderer.attached());
  ContactPlane higher = ground(50, 0, 0);
  higher.version = 2;
  renderer.on_reply(higher, true, 2);
  double given = 0;
  for (std::uint64_t i = 0; i < 200; ++i) {
    const double before = renderer.potential_aj(at(-4));
    renderer.force_w_nn(at(-4), 3 + i, 1.0, kPlenty);
    EXPECT_LE(renderer.potential_aj(at(-4)) - before, 1.0 + 1e-9);
    given += 1.0;
    EXPECT_LE(renderer.potential_aj(at(-4)), given + 1e-9);
  }
}

TEST(ModelRenderer, ARestingHandIsNotHit) {
  ModelRenderer renderer = renderer_of(ground(10));
  renderer.force_w_nn(at(-4), 2, kPlenty, kPlenty);
  ContactPlane higher = ground(60, 5, 3);
  higher.version = 2;
  renderer.on_reply(higher, true, 2);
  double last = 40;
  for (std::uint64_t i = 0; i < 500; ++i) {
    const double force = renderer.force_w_nn(at(-4), 3 + i, kPlenty, 2).z();
    EXPECT_LE(std::fabs(force - last), 2 + 1e-9);
    last = force;
  }
  EXPECT_NEAR(last, 60 * 7, 1e-9);
}

TEST(ModelRenderer, OldNewsOfTouchDoesNotBringItBack) {
  ModelRenderer renderer = renderer_of(ground(20, 10));
  renderer.force_w_nn(at(-1), 10, kPlenty, kPlenty);
  EXPECT_TRUE(renderer.attached());
  renderer.force_w_nn(at(0.6), 11, kPlenty, kPlenty);  // beyond F/k = 0.5 nm: let go
  EXPECT_FALSE(renderer.attached());
  renderer.on_reply(ground(20, 10), true, 9);  // the slave had not heard of that yet
  renderer.force_w_nn(at(0.3), 12, kPlenty, kPlenty);
  EXPECT_FALSE(renderer.attached());
  renderer.on_reply(ground(20, 10), true, 12);  // now it has, and its tip has snapped in
  EXPECT_NEAR(renderer.force_w_nn(at(0.3), 13, kPlenty, kPlenty).z(), -6, 1e-9);
}

TEST(ModelRenderer, FrictionSticksSlipsAndNeverGivesEnergyAway) {
  ContactPlane model = ground(20);
  model.shear_stiffness_n_m = 15;
  model.friction_nn = 6;
  ModelRenderer renderer = renderer_of(model);
  std::uint64_t command = 2;
  renderer.force_w_nn(at(-2, 0), command++, kPlenty, kPlenty);
  EXPECT_NEAR(renderer.force_w_nn(at(-2, 0.2), command++, kPlenty, kPlenty).x(), -3, 1e-12);  // sticks
  EXPECT_NEAR(renderer.force_w_nn(at(-2, 5), command++, kPlenty, kPlenty).x(), -6, 1e-12);    // slips
  EXPECT_NEAR(renderer.force_w_nn(at(-2, 4.9), command++, kPlenty, kPlenty).x(), -4.5, 1e-12);
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  Vec3 pos = at(-2, 4.9), force = renderer.force_w_nn(pos, command++, kPlenty, kPlenty);
  double work = 0, stored = renderer.potential_aj(pos);
  for (int i = 0; i < 20'000; ++i) {
    const Vec3 next = pos + 0.05 * Vec3(normal(random), normal(random), 0);
    const Vec3 after = renderer.force_w_nn(next, command++, kPlenty, kPlenty);
    // Backward Euler: the force after the step does at least the stored energy's work.
    work -= after.dot(next - pos);
    EXPECT_GE(work - (renderer.potential_aj(next) - stored), -1e-9);
    pos = next;
    force = after;
  }
}

}  // namespace
}  // namespace telenano::control

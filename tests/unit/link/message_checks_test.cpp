// What the values of a message may be (message_checks.h).
#include <gtest/gtest.h>

#include <array>
#include <limits>

#include "golden_messages.h"
#include "telenano/common/link/codec.h"

namespace telenano::link {
namespace {

TEST(Codec, RefusesNonFiniteNumbersWhereverTheyAre) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_of = [&](const auto& message) {
    const std::size_t n = codec.encode(message, out);
    return codec.decode(std::span(out).first(n), in);
  };
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    for (int k = 0; k < 8; ++k) {
      Command c = golden.command;
      double* const fields[] = {&c.tip_vel_w_nm_s.x(), &c.tip_vel_w_nm_s.y(), &c.tip_vel_w_nm_s.z(),
                                &c.tip_pos_w_nm.x(),   &c.tip_pos_w_nm.y(),   &c.tip_pos_w_nm.z(),
                                &c.energy_in_j,        &c.energy_out_j};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(c), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 7; ++k) {
      Command c = golden.command_with_features;
      PortControl& p = c.control;
      double* const fields[] = {&p.energy_scale_aj_j,   &p.energy_sent_j, &p.wave_sum.x(),
                                &p.wave_sum.y(),        &p.wave_sum.z(),  &p.wave_energy_aj,
                                &p.wave_impedance_n_s_m};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(c), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 15; ++k) {
      Reply r = golden.reply_with_features;
      PortAnswer& p = r.port;
      LocalModel& m = r.model;
      double* const fields[] = {
          &p.energy_sent_aj, &p.wave_sum.x(),   &p.wave_sum.y(),   &p.wave_sum.z(),        &p.wave_energy_aj,
          &m.point_w_nm.x(), &m.point_w_nm.y(), &m.point_w_nm.z(), &m.normal_w.x(),        &m.normal_w.y(),
          &m.normal_w.z(),   &m.stiffness_n_m,  &m.adhesion_nn,    &m.shear_stiffness_n_m, &m.friction_nn};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(r), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 4; ++k) {
      Reply r = golden.reply_with_particle;
      Particle& p = r.particle;
      double* const fields[] = {&p.pos_w_nm.x(), &p.pos_w_nm.y(), &p.pos_w_nm.z(), &p.radius_nm};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(r), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 9; ++k) {
      Reply r = golden.reply;
      double* const fields[] = {&r.force_w_nn.x(),   &r.force_w_nn.y(),   &r.force_w_nn.z(),
                                &r.tip_pos_w_nm.x(), &r.tip_pos_w_nm.y(), &r.tip_pos_w_nm.z(),
                                &r.deflection_nm,    &r.energy_in_aj,     &r.energy_out_aj};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(r), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 5; ++k) {
      Welcome w = golden.welcome;
      double* const fields[] = {&w.start_pos_w_nm.y(), &w.surface_z_w_nm, &w.force_max_nn,
                                &w.coupling_stiffness_n_m, &w.stiffness_min_n_m};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(w), DropCause::kNonFinite) << k;
    }
  }
  Command huge = golden.command;  // finite, however large: not this layer's business
  huge.tip_pos_w_nm.x() = std::numeric_limits<double>::max();
  huge.tip_vel_w_nm_s.x() = -std::numeric_limits<double>::max();
  EXPECT_EQ(cause_of(huge), DropCause::kNone);
  Command negative = golden.command;
  negative.energy_in_j = -1;
  EXPECT_EQ(cause_of(negative), DropCause::kOutOfRange);
  Command first = golden.command;
  first.sequence = 0;
  EXPECT_EQ(cause_of(first), DropCause::kOutOfRange);
  // A number that is none is the cause, whatever else is out of range.
  first.control.wave_sum.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(cause_of(first), DropCause::kNonFinite);
  Reply both = golden.reply_with_features;
  both.port.energy_sent_aj = -1;
  both.model.friction_nn = std::numeric_limits<double>::infinity();
  EXPECT_EQ(cause_of(both), DropCause::kNonFinite);
}

TEST(Codec, HoldsPortControlToItsRanges) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_with = [&](auto&& change) {
    Command c = GoldenMessages{}.command_with_features;
    change(c.control);
    return codec.decode(std::span(out).first(codec.encode(c, out)), in);
  };
  const auto with_method = [&](std::uint32_t method, double scale, double impedance) {
    return cause_with([&](PortControl& p) {
      p.method = method;
      p.energy_scale_aj_j = scale;
      p.wave_impedance_n_s_m = impedance;
    });
  };
  for (std::uint32_t method = 0; method <= kMethodTwin; ++method) {
    EXPECT_EQ(with_method(method, 1, 1), DropCause::kNone) << method;
    const bool scale_needed = method == 3 || method == 4 || method == 5;
    EXPECT_EQ(with_method(method, 0, 1), scale_needed ? DropCause::kOutOfRange : DropCause::kNone) << method;
    EXPECT_EQ(with_method(method, 1, 0), method == 4 ? DropCause::kOutOfRange : DropCause::kNone) << method;
    EXPECT_EQ(with_method(method, -1, 1), DropCause::kOutOfRange) << method;
    EXPECT_EQ(with_method(method, 1, -1), DropCause::kOutOfRange) << method;
  }
  EXPECT_EQ(with_method(8, 1, 1), DropCause::kOutOfRange);
  EXPECT_EQ(with_method(UINT32_MAX, 1, 1), DropCause::kOutOfRange);
  EXPECT_EQ(cause_with([](PortControl& p) { p.energy_sent_j = -1e-300; }), DropCause::kOutOfRange);
  EXPECT_EQ(cause_with([](PortControl& p) { p.wave_energy_aj = -1e-300; }), DropCause::kOutOfRange);
  EXPECT_EQ(cause_with([](PortControl& p) { p.wave_sum = -p.wave_sum; }), DropCause::kNone);
  EXPECT_EQ(cause_with([](PortControl& p) { p = {}; }), DropCause::kNone);
}

TEST(Codec, HoldsTheParticleToItsRanges) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_with = [&](auto&& change) {
    Reply r = GoldenMessages{}.reply_with_particle;
    change(r.particle);
    return codec.decode(std::span(out).first(codec.encode(r, out)), in);
  };
  const auto none = DropCause::kNone;
  const auto bad = DropCause::kOutOfRange;
  EXPECT_EQ(cause_with([](Particle& p) { p.radius_nm = -1e-300; }), bad);
  EXPECT_EQ(cause_with([](Particle& p) { p.radius_nm = 0; }), none);
  EXPECT_EQ(cause_with([](Particle& p) { p.pos_w_nm *= -1; }), none);
  EXPECT_EQ(cause_with([](Particle& p) { p.status = ParticleStatus::kLost; }), none);
  EXPECT_EQ(cause_with([](Particle& p) { p.status = static_cast<ParticleStatus>(4); }), bad);
  EXPECT_EQ(cause_with([](Particle& p) { p = {}; }), none);
  EXPECT_TRUE(in.reply.particle.empty());
  // A reply without one does not keep that of the reply before, in either form.
  const GoldenMessages golden;
  for (const Reply* after : {&golden.reply, &golden.reply_with_history}) {
    cause_with([](Particle&) {});
    ASSERT_FALSE(in.reply.particle.empty());
    codec.decode(std::span(out).first(codec.encode(*after, out)), in);
    EXPECT_TRUE(in.reply.particle.empty());
  }
}

TEST(Codec, HoldsPortAnswerAndLocalModelToTheirRanges) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_with = [&](auto&& change) {
    Reply r = GoldenMessages{}.reply_with_features;
    change(r);
    return codec.decode(std::span(out).first(codec.encode(r, out)), in);
  };
  const auto none = DropCause::kNone;
  const auto bad = DropCause::kOutOfRange;
  EXPECT_EQ(cause_with([](Reply& r) { r.port.energy_sent_aj = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.port.wave_energy_aj = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.port.wave_sum *= -1; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.stiffness_n_m = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.adhesion_nn = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.shear_stiffness_n_m = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.friction_nn = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.point_w_nm *= -1; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model = {}; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.port = {}; }), none);
  // Length 1 within 1e-6; none only if there is no model.
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 + 0.9e-6; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 - 0.9e-6; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 + 1.1e-6; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 - 1.1e-6; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1e300; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w.setZero(); }), bad);
  EXPECT_EQ(cause_with([](Reply& r) {
              r.model.normal_w.setZero();
              r.model.version = 0;
            }),
            none);
}

}  // namespace
}  // namespace telenano::link

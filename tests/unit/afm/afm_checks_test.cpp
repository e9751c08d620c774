// What does not fit is refused before anything moves; what only touching can tell ends withdrawn.
#include <gtest/gtest.h>

#include "telenano/nve_server/afm_sim/default_scene.h"
#include "tests/support/virtual_afm.h"

namespace telenano::afm {
namespace {

using nanonis::CommandId;

struct Outcome {
  Phase phase;
  std::string refusal;
  std::uint64_t moves;
  bool up;
  double peak_nn;
};

Outcome start(const AfmConfig& config, const afm_sim::SimConfig& rig) {
  support::VirtualAfm afm(config, rig, afm_sim::default_scene());
  while (afm.now_ns() < 30'000'000'000 && afm.logic().state().phase != Phase::kFollowing &&
         afm.logic().state().phase != Phase::kRefused &&
         !(afm.logic().state().phase == Phase::kWithdrawn && !afm.logic().refusal().empty()))
    afm.advance_to(afm.now_ns() + 1'000'000, {});
  return {afm.logic().state().phase, afm.logic().refusal(), afm.controller().moves(),
          afm.controller().withdrawn(), afm.controller().tip().peak_force_nn()};
}

TEST(AfmChecks, RefusedBeforeAnythingMoves) {
  struct Case {
    const char* says;
    void (*change)(AfmConfig&, afm_sim::SimConfig&);
  };
  const Case cases[] = {
      {"sensitivity_nm_v", [](AfmConfig& c, afm_sim::SimConfig&) { c.sensitivity_nm_v = -50; }},
      {"sensitivity_nm_v", [](AfmConfig&, afm_sim::SimConfig& r) { r.deflection_nm_v = -50; }},
      {"z_sign", [](AfmConfig& c, afm_sim::SimConfig&) { c.z_sign = -1; }},
      {"z_sign", [](AfmConfig&, afm_sim::SimConfig& r) { r.z_sign = -1; }},
      {"no signal 77", [](AfmConfig& c, afm_sim::SimConfig&) { c.deflection_signal = 77; }},
      {"no signal 3", [](AfmConfig& c, afm_sim::SimConfig&) { c.lateral_signal = 3; }},
      {"half_width_nm", [](AfmConfig& c, afm_sim::SimConfig&) { c.half_width_nm = 5001; }},
      {"top_nm", [](AfmConfig& c, afm_sim::SimConfig&) { c.top_nm = 980; }},
      {"top_nm", [](AfmConfig&, afm_sim::SimConfig& r) { r.range_z_nm = 90; }},
      // A signal that ends below the limit, or stands at its end, would never show it.
      {"beyond the end", [](AfmConfig& c, afm_sim::SimConfig&) { c.range_v = 0.2; }},
      {"an end of its range", [](AfmConfig&, afm_sim::SimConfig& r) { r.deflection_offset_nm = 600; }},
  };
  for (const Case& c : cases) {
    AfmConfig config;
    afm_sim::SimConfig rig;
    c.change(config, rig);
    const Outcome outcome = start(config, rig);
    EXPECT_EQ(outcome.phase, Phase::kRefused) << c.says;
    EXPECT_NE(outcome.refusal.find(c.says), std::string::npos) << outcome.refusal;
    EXPECT_EQ(outcome.refusal.find('\n'), std::string::npos);
    EXPECT_EQ(outcome.moves, 0u) << c.says;
    EXPECT_TRUE(outcome.up);
  }
}

TEST(AfmChecks, EitherSignOfZAndOfTheDeflectionWorksWhenBothSidesAgree) {
  for (const int z : {1, -1}) {
    for (const double d : {50.0, -50.0}) {
      AfmConfig config;
      afm_sim::SimConfig rig;
      config.z_sign = rig.z_sign = z;
      config.sensitivity_nm_v = rig.deflection_nm_v = d;
      const Outcome outcome = start(config, rig);
      EXPECT_EQ(outcome.phase, Phase::kFollowing) << z << " " << d << outcome.refusal;
      EXPECT_LT(outcome.peak_nn, config.force_max_nn);
    }
  }
}

TEST(AfmChecks, BothFormsOfErrorRepliesAreUnderstood) {
  for (const auto form : {nanonis::ErrorForm::kAlone, nanonis::ErrorForm::kZeroFilled}) {
    AfmConfig config;
    afm_sim::SimConfig rig;
    rig.error_form = form;
    rig.restrict_roles = true;
    EXPECT_EQ(start(config, rig).phase, Phase::kFollowing) << "each role asks only what suits it";
  }
}

TEST(AfmChecks, WithoutASampleTheApproachEndsWithdrawn) {
  AfmConfig config;
  config.timeout_s = 3;
  afm_sim::SimConfig rig;
  rig.sample_z_nm = -2000;
  support::VirtualAfm afm(config, rig, afm_sim::default_scene());
  while (afm.now_ns() < 20'000'000'000 && afm.logic().state().phase != Phase::kWithdrawn)
    afm.advance_to(afm.now_ns() + 1'000'000, {});
  EXPECT_EQ(afm.logic().state().phase, Phase::kWithdrawn);
  EXPECT_EQ(afm.logic().state().cause, Cause::kNoSurface);
  EXPECT_TRUE(afm.controller().withdrawn());
}

TEST(AfmChecks, SafeTipIsSetUpAndLooked) {
  support::VirtualAfm afm(AfmConfig{}, afm_sim::SimConfig{}, afm_sim::default_scene());
  afm.advance_to(3'000'000'000, {});
  for (const CommandId id : {CommandId::kSafeTipPropsSet, CommandId::kSafeTipOnOffSet})
    EXPECT_EQ(afm.calls(id), 1u);
  // As it was found, whether the controller took what it was told, and again before and in the approach.
  for (const CommandId id : {CommandId::kSafeTipPropsGet, CommandId::kSafeTipOnOffGet})
    EXPECT_GE(afm.calls(id), 3u);
}

TEST(AfmChecks, WithoutASessionTheTipIsParkedAndASessionBringsItBack) {
  AfmConfig config;
  config.park_after_s = 2;
  support::VirtualAfm afm(config, afm_sim::SimConfig{}, afm_sim::default_scene());
  PortTarget wish;
  afm.advance_to(12'000'000'000, wish);
  EXPECT_EQ(afm.logic().state().phase, Phase::kWithdrawn);
  EXPECT_EQ(afm.logic().state().cause, Cause::kParked);
  wish.session = 1;
  wish.follow = true;
  wish.target_w_nm = Vec3(0, 0, 10);
  for (int i = 0; i < 10000; ++i) {
    wish.time_ns = afm.now_ns();
    afm.advance_to(afm.now_ns() + 1'000'000, wish);
  }
  EXPECT_EQ(afm.logic().state().phase, Phase::kFollowing);
  EXPECT_NEAR(afm.logic().state().base_w_nm.z(), 10, 0.01);
}

}  // namespace
}  // namespace telenano::afm

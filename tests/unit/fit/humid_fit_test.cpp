// Humidity and film of a capillary bridge in the fit, against curves in closed form whose tip is led by hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <vector>

#include "telenano/common/base/random.h"
#include "telenano/nve_server/fit/curve_fit.h"
#include "tests/unit/fit/closed_curve.h"

namespace telenano::fit {
namespace {

constexpr double kPoisson = 0.3;

/// A hard sample (DMT) in humid air. Constant curvature, contact angles 0: Kelvin's radius r = 0.539 nm/(−ln RH),
/// reach 2r, F0 = 4πRγ; under the liquid the adhesion is w − 2γ. In: dry up to where the films touch; out: wet to
/// the reach. The tip is led in small steps with the net force until it turns, so that it leaps as it must.
struct HumidSample {
  double humidity = 0.6;
  double film_nm = 0.8;
  double work_n_m = 0.25;
  double contact_modulus_gpa = 3000;  ///< K: so hard that Maugis and Dugdale's law is DMT's (lambda 0.03)
  double radius_nm = 20;
  double stiffness_n_m = 400;

  static constexpr double kTension = 0.0728;
  static constexpr double kCutOff_nm = 0.165;

  double reach_nm() const { return 2 * 0.539 / -std::log(humidity); }
  double force_nn(double d, bool wet) const {
    const double gap = std::max(-d, 0.0);
    const double push = d > 0 ? contact_modulus_gpa * d * std::sqrt(radius_nm * d) : 0.0;
    const double work = wet ? work_n_m - 2 * kTension : work_n_m;
    const double share = kCutOff_nm / (kCutOff_nm + gap);
    const double bridge = wet ? 4 * fit_test::kPi * radius_nm * kTension * (1 - gap / reach_nm()) : 0.0;
    return push - 2 * fit_test::kPi * work * radius_nm * share * share - bridge;
  }
};

struct HumidRamp {
  double far_nm = 8;
  double deep_nm = 2;
  int points = 1200;
  double offset_nm = 0;  ///< of the grid of points
};

RawCurve humid_curve(const HumidSample& sample, const HumidRamp& ramp, const fit_test::Blemish& blemish,
                     std::uint64_t seed) {
  RawCurve curve;
  fit_test::Noise noise(blemish, seed);
  bool wet = false;
  double d = -ramp.far_nm;
  for (int i = 0; i < 2 * ramp.points; ++i) {
    const bool in = i < ramp.points;
    const int along = in ? i : 2 * ramp.points - 1 - i;
    const double base =
        ramp.offset_nm - ramp.far_nm + (ramp.far_nm + ramp.deep_nm) * along / (ramp.points - 1);
    const auto net = [&](double at) { return (base - at) * sample.stiffness_n_m - sample.force_nn(at, wet); };
    // Overdamped: on with the net force's sign until it changes; the bridge comes and goes on the way.
    for (int turns = 0; turns < 8; ++turns) {
      const double way = net(d) > 0 ? 1.0 : -1.0;
      double step = 2e-3;
      bool changed = false;
      while (step > 1e-9) {
        if (net(d + way * step) * way > 0) {
          d += way * step;
          if (!wet && way > 0 && -d <= sample.film_nm && d < 1) wet = changed = true;
          if (wet && way < 0 && -d >= sample.reach_nm()) wet = false, changed = true;
          if (changed) break;
        } else {
          step *= 0.5;
        }
      }
      if (!changed) break;
    }
    RawSegment& segment = in ? curve.approach : curve.retract;
    segment.z_nm.push_back(1000 - base);
    segment.deflection.push_back(sample.force_nn(d, wet) / sample.stiffness_n_m +
                                 noise.at(1000 - base, i / (2.0 * ramp.points)));
  }
  return curve;
}

FitSetup humid_setup(const HumidSample& sample) {
  FitSetup setup;
  setup.law.model = physics::ContactLaw::kMaugisDugdale;
  setup.law.contact_modulus_gpa = 1;
  setup.law.work_of_adhesion_n_m = 0.2;
  setup.law.long_range.capillary.humidity_percent = 40;
  setup.law.long_range.capillary.film_nm = 0.5;
  setup.radius_nm = sample.radius_nm;
  setup.compliance_nm_nn = 1.0 / sample.stiffness_n_m;
  setup.sample_modulus_gpa = 60;
  setup.sample_poisson = kPoisson;
  setup.modulus_max_gpa = 1e5;
  setup.fit_humidity = true;
  setup.fit_film = true;
  return setup;
}

CurveFit fit_of(const RawCurve& raw, const FitSetup& setup) {
  Preparation how;
  how.stiffness_n_m = 1 / setup.compliance_nm_nn;
  how.bridge_step = setup.fit_film || setup.fit_humidity;
  return fit_curve(prepare(raw, how), setup);
}

std::string said(const CurveFit& fit) {
  std::ostringstream text;
  text << fit.error;
  for (const Estimate& e : fit.estimates)
    text << e.name << " = " << e.value << " [" << e.low.value_or(-1) << ", " << e.high.value_or(-1) << "] ";
  text << "rms " << fit.rms_nm << " noise " << fit.noise_nm << " reduced " << fit.reduced;
  for (const std::string& note : fit.notes) text << "\n  " << note;
  return text.str();
}

TEST(HumidFit, HumidityAndFilmAreFoundOnALeverThatDoesNotLeap) {
  const double cases[][2] = {{0.4, 0.5}, {1.5, 0.8}};
  for (const auto& [film_nm, humidity] : cases) {
    HumidSample sample;
    sample.film_nm = film_nm;
    sample.humidity = humidity;
    const CurveFit fit =
        fit_of(humid_curve(sample, {.points = 800}, {.white_nm = 5e-4}, 21), humid_setup(sample));
    ASSERT_EQ(fit.error, "");
    ASSERT_EQ(fit.estimates.size(), 4u) << said(fit);
    // The intervals are some 0.2 and 2 %; what Maugis and Dugdale's law differs from DMT's comes on top, and with w
    // more: within a few hundredths of a nanometre of touch.
    EXPECT_NEAR(fit.humidity_percent / (100 * humidity), 1, 0.005) << said(fit);
    EXPECT_NEAR(fit.film_nm / film_nm, 1, 0.02) << said(fit);
    EXPECT_NEAR(fit.work_n_m / 0.25, 1, 0.06) << said(fit);
    for (const Estimate& e : fit.estimates) EXPECT_TRUE(e.low && e.high) << e.name << said(fit);
  }
}

TEST(HumidFit, HumidityAloneWithTheFilmGiven) {
  HumidSample sample;
  sample.stiffness_n_m = 40;
  FitSetup setup = humid_setup(sample);
  setup.fit_film = false;
  setup.law.long_range.capillary.film_nm = sample.film_nm;
  const CurveFit fit =
      fit_of(humid_curve(sample, {.far_nm = 9, .deep_nm = 3, .points = 800}, {.white_nm = 0.01}, 23), setup);
  ASSERT_EQ(fit.estimates.size(), 3u) << said(fit);
  EXPECT_NEAR(fit.humidity_percent / 60, 1, 0.01) << said(fit);
  EXPECT_EQ(fit.film_nm, sample.film_nm);
}

// A lever softer than F0/reach, 9 N/m, leaps over the bridge's reach both ways. What is left is where it leaps in.
TEST(HumidFit, ASoftLeverLeavesThemOpenAndSaysSo) {
  HumidSample sample;
  sample.stiffness_n_m = 1;
  const HumidRamp ramp{.far_nm = 48, .deep_nm = 42, .points = 800};
  const CurveFit fit = fit_of(humid_curve(sample, ramp, {.white_nm = 0.01}, 22), humid_setup(sample));
  ASSERT_EQ(fit.estimates.size(), 4u) << said(fit);
  const Estimate& work = fit.estimates[1];
  ASSERT_TRUE(work.low && work.high) << said(fit);
  EXPECT_NEAR(work.value / 250, 1, 0.01) << said(fit);  // dry or wet, the pull-off is 2 pi w R
  for (const char* name : {"humidity", "film"}) {
    const Estimate& e = *std::find_if(fit.estimates.begin(), fit.estimates.end(),
                                      [&](const Estimate& any) { return any.name == name; });
    EXPECT_FALSE(e.low && e.high) << said(fit);
    EXPECT_NE(said(fit).find(std::string(name) + " is open"), std::string::npos) << said(fit);
    EXPECT_NE(said(fit).find(std::string(name) + " follows from"), std::string::npos) << said(fit);
  }
}

// Two valleys: where the tip leaps in by the bridge, a small film and much water, or little water that forms its
// bridge at the end of its reach, do the same. The interval must hold the truth, which is in the other valley.
TEST(HumidFit, AnIntervalHoldsEveryValley) {
  HumidSample sample;
  sample.stiffness_n_m = 10;
  const HumidRamp ramp{.far_nm = 12, .deep_nm = 6, .points = 800};
  const CurveFit fit = fit_of(humid_curve(sample, ramp, {.white_nm = 0.01}, 22), humid_setup(sample));
  ASSERT_EQ(fit.estimates.size(), 4u) << said(fit);
  for (const Estimate& e : fit.estimates) {
    const double truth = e.name == "humidity" ? 60 : e.name == "film" ? 0.8 : e.name == "w" ? 250 : e.value;
    EXPECT_LE(e.low.value_or(0), truth) << e.name << ' ' << said(fit);
    EXPECT_GE(e.high.value_or(1e9), truth) << e.name << ' ' << said(fit);
  }
}

// Without any bridge in the curve the step must not be made up of its bends.
TEST(HumidFit, ADryCurveShowsNoFilm) {
  HumidSample sample;
  sample.film_nm = -1e9;
  const CurveFit fit =
      fit_of(humid_curve(sample, {.points = 800}, {.white_nm = 5e-4}, 24), humid_setup(sample));
  ASSERT_EQ(fit.estimates.size(), 4u) << said(fit);
  EXPECT_FALSE(fit.estimates[3].low && fit.estimates[3].high) << said(fit);
  EXPECT_FALSE(fit.estimates[2].low) << said(fit);
}

// Films of nearly the bridge's whole reach (1.5 of 1.555 nm): it forms with a step of 1 pm, some two of the noise's
// standard deviations, that nobody can see. Humidity is still told by the way out; the film has no upper end, as
// every film beyond the reach forms its bridge there.
TEST(HumidFit, AFilmOfNearlyTheBridgesReachIsOpenUpwards) {
  HumidSample sample;
  sample.film_nm = 1.5;
  sample.humidity = 0.5;
  const CurveFit fit =
      fit_of(humid_curve(sample, {.points = 800}, {.white_nm = 5e-4}, 21), humid_setup(sample));
  ASSERT_EQ(fit.estimates.size(), 4u) << said(fit);
  const Estimate& humidity = fit.estimates[2];
  EXPECT_LE(humidity.low.value_or(0), 50) << said(fit);
  EXPECT_GE(humidity.high.value_or(100), 50) << said(fit);
  EXPECT_NEAR(humidity.value, 50, 0.1) << said(fit);
  const Estimate& film = fit.estimates[3];
  EXPECT_FALSE(film.high) << said(fit);
  EXPECT_LE(film.low.value_or(0), sample.film_nm) << said(fit);
  EXPECT_GT(film.low.value_or(0), 1) << said(fit);
  EXPECT_NE(said(fit).find("film is open upwards"), std::string::npos) << said(fit);
}

/// With the noise of a microscope, a lever of 40 N/m.
TEST(HumidFitCoverage, IntervalsHoldWhatTheyShould) {
  int draws = 3;
  if (const char* more = std::getenv("TELENANO_FIT_DRAWS"))
    draws = std::atoi(more);  // NOLINT(concurrency-mt-unsafe)
  const fit_test::Blemish blemish{.white_nm = 0.01, .flicker_nm = 0.005, .drift_nm = 0.03};
  HumidSample sample;
  sample.stiffness_n_m = 40;
  const double truth[] = {0.75 * (1 - kPoisson * kPoisson) * sample.contact_modulus_gpa,
                          1e3 * sample.work_n_m, 100 * sample.humidity, sample.film_nm};
  int held[4] = {};
  int open[4] = {};
  std::vector<double> width[4];
  for (int i = 0; i < draws; ++i) {
    const HumidRamp ramp{.far_nm = 9, .deep_nm = 3, .points = 600, .offset_nm = 0.0031 * (i % 7)};
    const CurveFit fit =
        fit_of(humid_curve(sample, ramp, blemish, 2000 + static_cast<std::uint64_t>(i)), humid_setup(sample));
    ASSERT_EQ(fit.estimates.size(), 4u) << said(fit);
    for (std::size_t p = 0; p < 4; ++p) {
      const Estimate& e = fit.estimates[p];
      held[p] += e.low.value_or(0) <= truth[p] && truth[p] <= e.high.value_or(1e9) ? 1 : 0;
      open[p] += e.low && e.high ? 0 : 1;
      if (e.low && e.high) width[p].push_back(std::log(*e.high / *e.low));
    }
  }
  const char* const names[] = {"E", "w", "humidity", "film"};
  for (std::size_t p = 0; p < 4; ++p) {
    std::sort(width[p].begin(), width[p].end());
    const double median = width[p].empty() ? 0 : width[p][width[p].size() / 2];
    std::printf("%s: %d draws, %.1f %% held, %d open, median width %.3g %%\n", names[p], draws,
                100.0 * held[p] / draws, open[p], 100 * median);
    // Of 3 draws at 95 %, none holds once in 8000. Of 60, 51 or fewer hold once
    // in 450.
    EXPECT_GE(held[p], draws < 50 ? draws / 3 : draws * 52 / 60) << names[p];
  }
}

}  // namespace
}  // namespace telenano::fit

// A lever's stiffness by its thermal motion, against levers that are moved step by step by Langevin's equation, and
// the shares of Butt and Jaschke against the beam's own mode.
#include "telenano/nve_server/fit/thermal_spectrum.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <unsupported/Eigen/MatrixFunctions>

#include "telenano/common/base/random.h"

namespace telenano::fit {
namespace {

constexpr double kTemperature = 295;
constexpr double kThermal = 1.380649e-5 * kTemperature;  // nN nm

struct Lever {
  double stiffness_n_m = 0.2;
  double frequency_hz = 20e3;
  double quality = 50;
};

/// Position of an oscillator in a bath, exactly from step to step: x(t + h) is Gaussian with mean e^(Mh)(x, v) and
/// covariance C − e^(Mh) C e^(Mh)ᵀ, C that of balance: k⟨x²⟩ = m⟨v²⟩ = k_B T.
std::vector<double> moved(const Lever& lever, std::size_t n, double step_s, std::uint64_t seed) {
  const double w = 2 * 3.14159265358979323846 * lever.frequency_hz;
  Eigen::Matrix2d motion;
  motion << 0, 1, -w * w, -w / lever.quality;
  const Eigen::Matrix2d step = (motion * step_s).exp();
  const double xx = kThermal / lever.stiffness_n_m;
  Eigen::Matrix2d balance = Eigen::Matrix2d::Zero();
  balance(0, 0) = xx;
  balance(1, 1) = w * w * xx;
  const Eigen::Matrix2d kick = (balance - step * balance * step.transpose()).llt().matrixL();
  Random random(seed);
  Eigen::Vector2d at{std::sqrt(xx) * random.normal(), w * std::sqrt(xx) * random.normal()};
  std::vector<double> x;
  for (std::size_t i = 0; i < n; ++i) {
    x.push_back(at[0]);
    at = step * at + kick * Eigen::Vector2d{random.normal(), random.normal()};
  }
  return x;
}

std::string series_text(const std::vector<double>& values, double step_s, double white, std::uint64_t seed) {
  Random random(seed);
  std::string text = "time_us,deflection_pm\n";
  char line[80];
  for (std::size_t i = 0; i < values.size(); ++i) {
    std::snprintf(line, sizeof line, "%.6f,%.6g\n", 1e6 * step_s * static_cast<double>(i),
                  1e3 * (values[i] + 7.0 + white * random.normal()));
    text += line;
  }
  return text;
}

ThermalStiffness found_in(const std::string& text) {
  return stiffness_of(read_spectrum(text), {.share = 1.0, .temperature_k = kTemperature});
}

TEST(ThermalSpectrum, StiffnessOfAMovedLeverAndItsError) {
  // An error of s as said: the mean of 24 deviations over it is within ±0.6 (3/√24), their rms 0.6 to 1.45 (99.7 %).
  for (const double quality : {3.0, 80.0}) {
    double sum = 0;
    double squares = 0;
    const Lever lever{.stiffness_n_m = 0.2, .frequency_hz = 20e3, .quality = quality};
    constexpr int kDraws = 24;
    for (int i = 0; i < kDraws; ++i) {
      const double step_s = 1 / 400e3;
      const auto seed = static_cast<std::uint64_t>(100 + i);
      const ThermalStiffness found =
          found_in(series_text(moved(lever, 45'000, step_s, seed), step_s, 0.05, seed));
      ASSERT_EQ(found.error, "");
      EXPECT_NEAR(found.frequency_hz / lever.frequency_hz, 1, quality > 10 ? 0.005 : 0.05);
      EXPECT_GT(found.relative_error, 0.002);
      EXPECT_LT(found.relative_error, 0.15);  // Q = 80: some 90 independent amplitudes in 0.11 s
      const double off = std::log(found.stiffness_n_m / lever.stiffness_n_m) / found.relative_error;
      sum += off;
      squares += off * off;
    }
    std::printf("Q = %g: mean deviation %.2f, rms %.2f of the error said\n", quality, sum / kDraws,
                std::sqrt(squares / kDraws));
    EXPECT_LT(std::abs(sum / kDraws), 0.6);
    EXPECT_GT(std::sqrt(squares / kDraws), 0.6);
    EXPECT_LT(std::sqrt(squares / kDraws), 1.45);
  }
}

TEST(ThermalSpectrum, AveragedSpectrumInVolts) {
  // The oscillator's formula with its own scatter: 60 exponential variates a value.
  Random random(5);
  const double f0 = 71.3e3;
  const double quality = 180;
  const double stiffness = 2.5;
  const double a = kThermal / stiffness / (0.5 * 3.14159265358979 * f0 * quality);
  std::string text = "Instrument X\nFrequency (kHz);PSD (V^2/Hz)\n";
  char line[80];
  for (double f = 1e3; f < 200e3; f += 50) {
    const double u = f * f - f0 * f0;
    const double v = f * f0 / quality;
    const double s = a * f0 * f0 * f0 * f0 / (u * u + v * v) + 2e-8 + 1e-3 / f * 1e-4;
    double mean = 0;
    for (int i = 0; i < 60; ++i) mean -= std::log(1 - random.uniform()) / 60;
    std::snprintf(line, sizeof line, "%.4f;%.8g\n", f / 1e3, s * mean / (40.0 * 40.0));
    text += line;
  }
  const Spectrum spectrum = read_spectrum(text);
  ASSERT_EQ(spectrum.error, "");
  EXPECT_NE(stiffness_of(spectrum, {}).error.find("--invols-nm-v"), std::string::npos);
  const ThermalStiffness found =
      stiffness_of(spectrum, {.share = 1.0, .temperature_k = kTemperature, .invols_nm_v = 40.0});
  ASSERT_EQ(found.error, "");
  EXPECT_NEAR(std::log(found.stiffness_n_m / stiffness), 0, 4 * found.relative_error);
  EXPECT_LT(found.relative_error, 0.03);
  EXPECT_NEAR(found.quality / quality, 1, 0.1);
  EXPECT_NEAR(found.averages / 60, 1, 0.15);
  // The share and the temperature are factors.
  const ThermalStiffness other =
      stiffness_of(spectrum, {.share = 0.817, .temperature_k = 2 * kTemperature, .invols_nm_v = 40.0});
  EXPECT_NEAR(other.stiffness_n_m / found.stiffness_n_m, 2 * 0.817, 1e-9);
}

TEST(ThermalSpectrum, SharesAreThoseOfTheBeam) {
  // The first mode of a beam held at one end: cos α cosh α = −1, by halving.
  double low = 1.5;
  double high = 2.5;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (std::cos(middle) * std::cosh(middle) > -1 ? low : high) = middle;
  }
  const double alpha = low;
  const double ratio = (std::cos(alpha) + std::cosh(alpha)) / (std::sin(alpha) + std::sinh(alpha));
  const auto mode = [&](double x) {
    return std::cosh(alpha * x) - std::cos(alpha * x) - ratio * (std::sinh(alpha * x) - std::sin(alpha * x));
  };
  // Stiffness of the mode at its end over that of a load there, 3 EI/L³: ∫ φ''² / φ(1)² by Simpson's rule.
  const auto bend = [&](double x) {
    return alpha * alpha *
           (std::cosh(alpha * x) + std::cos(alpha * x) -
            ratio * (std::sinh(alpha * x) + std::sin(alpha * x)));
  };
  double energy = 0;
  constexpr int kParts = 2000;
  for (int i = 0; i <= kParts; ++i) {
    const double weight = i == 0 || i == kParts ? 1 : i % 2 == 1 ? 4 : 2;
    const double b = bend(static_cast<double>(i) / kParts);
    energy += weight * b * b / (3.0 * kParts);
  }
  const double share = 3.0 / (energy / (mode(1) * mode(1)));
  EXPECT_NEAR(thermal_share(LeverShape::kDisplacement), share, 5e-4);
  // The slope at the end for a displacement of 1: the mode's, and 3/2 of a load there.
  const double slope = (mode(1) - mode(1 - 1e-6)) / 1e-6 / mode(1) / 1.5;
  EXPECT_NEAR(thermal_share(LeverShape::kRectangular), share * slope * slope, 5e-4);
}

TEST(ThermalSpectrum, WhatIsNoneIsSaidInOneLine) {
  const std::pair<std::string, const char*> wrong[] = {
      {"", "no table"},
      {"x,y\n1,2\n", "no columns like"},
      {"time_s,deflection_nm\n0,1\n1,2\n", "at least 1024"},
      {"frequency_hz,psd_nm2_hz\n1,2\n2,nan\n", "row 2"},
      {"frequency_hz,psd_nm2_hz\n1,2\n2,-1\n", "row 2"},
      {"frequency_hz,psd_nm2_hz\n1,2\n2,3\n", "fewer than 40"}};
  for (const auto& [text, said] : wrong) {
    const std::string error = found_in(text).error;
    EXPECT_NE(error.find(said), std::string::npos) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos);
  }
  Random random(9);
  std::string flat = "frequency_hz,psd_nm2_hz\n";
  for (int i = 1; i < 4000; ++i)
    flat += std::to_string(10 * i) + "," + std::to_string(1 + 0.1 * random.normal()) + "\n";
  EXPECT_NE(found_in(flat).error.find("no resonance"), std::string::npos) << found_in(flat).error;
  std::string jump = series_text(std::vector<double>(2000, 1.0), 1e-5, 0.1, 3);
  jump.replace(jump.find("\n100.0"), 6, "\n170.0");
  EXPECT_NE(found_in(jump).error.find("unequal"), std::string::npos) << found_in(jump).error;
}

}  // namespace
}  // namespace telenano::fit

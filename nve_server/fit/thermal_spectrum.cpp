#include "telenano/nve_server/fit/thermal_spectrum.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/fit/curve_file.h"
#include "telenano/nve_server/fit/decompositions.h"
#include "telenano/nve_server/fit/text_table.h"

namespace telenano::fit {
namespace {

constexpr double kBoltzmann_aj_k = 1.380649e-5;  // nN nm/K
constexpr std::size_t kLeastPoints = 40;
constexpr std::size_t kLeastSeries = 1024;

struct Unit {
  const char* name;
  double factor;
};
constexpr std::array<Unit, 6> kDensities{
    {{"nm2", 1}, {"pm2", 1e-6}, {"fm2", 1e-12}, {"m2", 1e18}, {"mv2", 1e-6}, {"v2", 1}}};
constexpr std::array<Unit, 6> kLengths{
    {{"nm", 1}, {"pm", 1e-3}, {"um", 1e3}, {"m", 1e9}, {"mv", 1e-3}, {"v", 1}}};
constexpr std::array<Unit, 3> kFrequencies{{{"khz", 1e3}, {"mhz", 1e6}, {"hz", 1}}};
constexpr std::array<Unit, 3> kTimes{{{"us", 1e-6}, {"ms", 1e-3}, {"s", 1}}};

/// The words of a column's name; "^" goes, so that "nm^2/Hz" is nm2 and hz.
std::vector<std::string> words_of(const std::string& name) {
  std::vector<std::string> words(1);
  for (const char c : name) {
    if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'))
      words.back() += c;
    else if (c != '^' && !words.back().empty())
      words.emplace_back();
  }
  if (words.back().empty()) words.pop_back();
  return words;
}

template <std::size_t n>
const Unit* unit_among(const std::array<Unit, n>& units, const std::string& word) {
  for (const Unit& unit : units)
    if (word == unit.name) return &unit;
  return nullptr;
}

/// In place, 2^n values.
void transform(std::vector<std::complex<double>>& x) {
  const std::size_t n = x.size();
  for (std::size_t i = 1, j = 0; i < n; ++i) {
    std::size_t bit = n >> 1;
    for (; (j & bit) != 0; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) std::swap(x[i], x[j]);
  }
  for (std::size_t size = 2; size <= n; size *= 2) {
    std::vector<std::complex<double>> turn(size / 2);
    for (std::size_t k = 0; k < size / 2; ++k) {
      const SinCos angle = det_sin_cos(-2.0 * kPi * static_cast<double>(k) / static_cast<double>(size));
      turn[k] = {angle.cos, angle.sin};
    }
    for (std::size_t begin = 0; begin < n; begin += size) {
      for (std::size_t k = 0; k < size / 2; ++k) {
        const std::complex<double> a = x[begin + k];
        const std::complex<double> b = x[begin + k + size / 2] * turn[k];
        x[begin + k] = a + b;
        x[begin + k + size / 2] = a - b;
      }
    }
  }
}

void add_periodogram(const std::vector<double>& values, std::size_t begin, std::size_t n, double step_s,
                     Spectrum& spectrum) {
  double mean = 0;
  for (std::size_t i = 0; i < n; ++i) mean += values[begin + i] / static_cast<double>(n);
  std::vector<std::complex<double>> x(n);
  for (std::size_t i = 0; i < n; ++i) x[i] = values[begin + i] - mean;
  transform(x);
  for (std::size_t k = 1; k < n / 2; ++k) {
    spectrum.frequency_hz.push_back(static_cast<double>(k) / (static_cast<double>(n) * step_s));
    spectrum.density.push_back(2.0 * step_s / static_cast<double>(n) * std::norm(x[k]));
  }
}

void read_series(const std::vector<double>& time_s, const std::vector<double>& values, Spectrum& spectrum) {
  const std::size_t n = values.size();
  if (n < kLeastSeries) {
    spectrum.error =
        "has " + std::to_string(n) + " values, expected a series of at least " + std::to_string(kLeastSeries);
    return;
  }
  const double step_s = (time_s[n - 1] - time_s[0]) / static_cast<double>(n - 1);
  if (!(step_s > 0)) {
    spectrum.error = "has a time that does not increase";
    return;
  }
  for (std::size_t i = 0; i < n; ++i) {
    // Times are written with few digits: a step is one to within half of it.
    if (std::abs(time_s[i] - time_s[0] - step_s * static_cast<double>(i)) > 0.5 * step_s) {
      spectrum.error = "has unequal steps of time, at value " + std::to_string(i + 1);
      return;
    }
  }
  std::size_t begin = 0;
  for (std::size_t size = std::size_t{1} << 20; size >= kLeastSeries; size /= 2) {
    for (; n - begin >= size; begin += size) add_periodogram(values, begin, size, step_s, spectrum);
  }
}

/// ln A, ln f0, ln Q, ln B.
using Parameters = Eigen::Vector4d;

struct Oscillator {
  double a, f0, q, b;
  explicit Oscillator(const Parameters& p)
      : a(det_exp(p[0])), f0(det_exp(p[1])), q(det_exp(p[2])), b(det_exp(p[3])) {}
  double resonance(double f) const {
    const double u = f * f - f0 * f0;
    const double v = f * f0 / q;
    return a * f0 * f0 * f0 * f0 / (u * u + v * v);
  }
  double at(double f) const { return resonance(f) + b; }
  /// d ln S/dp.
  Parameters slope(double f) const {
    const double u = f * f - f0 * f0;
    const double v = f * f0 / q;
    const double whole = u * u + v * v;
    const double share = resonance(f) / at(f);
    return {share, share * (4.0 + (4.0 * u * f0 * f0 - 2.0 * v * v) / whole), share * 2.0 * v * v / whole,
            1.0 - share};
  }
};

struct Band {
  std::vector<double> f;
  std::vector<double> p;
};

double cost_of(const Band& band, const Parameters& p) {
  const Oscillator oscillator(p);
  double cost = 0;
  for (std::size_t i = 0; i < band.f.size(); ++i) {
    const double s = oscillator.at(band.f[i]);
    cost += det_log(s) + band.p[i] / s;
  }
  return cost;
}

/// Scoring: the expected curvature is ΣJJᵀ.
Eigen::Matrix4d information(const Band& band, const Parameters& p, Parameters& gradient) {
  const Oscillator oscillator(p);
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  gradient.setZero();
  for (std::size_t i = 0; i < band.f.size(); ++i) {
    const Parameters j = oscillator.slope(band.f[i]);
    gradient += (1.0 - band.p[i] / oscillator.at(band.f[i])) * j;
    normal += j * j.transpose();
  }
  return normal;
}

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Band band_of(const Spectrum& spectrum, double low_hz, double high_hz, double scale) {
  Band band;
  for (std::size_t i = 0; i < spectrum.density.size(); ++i) {
    const double f = spectrum.frequency_hz[i];
    if (!(f >= low_hz && f <= high_hz) || !(spectrum.density[i] > 0)) continue;
    band.f.push_back(f);
    band.p.push_back(scale * spectrum.density[i]);
  }
  return band;
}

/// Where a mean over neighbours is greatest, at frequencies within the limits, and that mean.
struct Peak {
  double frequency_hz = 0;
  double density = 0;
};
Peak peak_of(const Band& all) {
  // Means over narrow parts of ln f, so that several periodograms need no order and no one value decides.
  Peak peak;
  constexpr double kPart = 0.01;
  const double first = det_log(*std::min_element(all.f.begin(), all.f.end()));
  const double last = det_log(*std::max_element(all.f.begin(), all.f.end()));
  const auto parts = static_cast<std::size_t>((last - first) / kPart) + 1;
  std::vector<double> sum(parts, 0.0);
  std::vector<double> count(parts, 0.0);
  for (std::size_t i = 0; i < all.f.size(); ++i) {
    const auto part = std::min(parts - 1, static_cast<std::size_t>((det_log(all.f[i]) - first) / kPart));
    sum[part] += all.p[i];
    count[part] += 1;
  }
  // Of equal heights the one at the higher frequency: times f, which 1/f noise has no peak in.
  double best = 0;
  for (std::size_t k = 0; k < parts; ++k) {
    if (!(count[k] > 0)) continue;
    const double f = det_exp(first + kPart * (static_cast<double>(k) + 0.5));
    const double mean = sum[k] / count[k];
    if (mean * f <= best) continue;
    best = mean * f;
    peak = {f, mean};
  }
  return peak;
}

}  // namespace

double thermal_share(LeverShape shape) noexcept {
  switch (shape) {
    case LeverShape::kRectangular:
      return 0.817;
    case LeverShape::kVShaped:
      return 0.764;
    default:
      return 0.971;
  }
}

Spectrum read_spectrum(std::string_view bytes) {
  Spectrum spectrum;
  const std::string like = "frequency_hz,psd_nm2_hz or time_s,deflection_nm";
  const Table table = read_table(bytes, "", like);
  spectrum.error = table.error;
  if (!spectrum.error.empty()) return spectrum;
  const std::vector<double>* across = nullptr;
  const std::vector<double>* along = nullptr;
  double across_factor = 1;
  double along_factor = 1;
  bool series = false;
  for (std::size_t i = 0; i < table.names.size(); ++i) {
    const std::vector<std::string> words = words_of(table.names[i]);
    if (words.empty()) continue;
    const std::string last = words.back();
    const bool rooted = std::find(words.begin(), words.end(), "sqrt") != words.end() ||
                        std::find(words.begin(), words.end(), "rthz") != words.end();
    if (table.names[i].starts_with("time") && across == nullptr) {
      if (const Unit* unit = unit_among(kTimes, last)) {
        across = &table.columns[i];
        across_factor = unit->factor;
        series = true;
      }
    } else if (table.names[i].starts_with("f") && across == nullptr) {
      if (const Unit* unit = unit_among(kFrequencies, last)) {
        across = &table.columns[i];
        across_factor = unit->factor;
      }
    } else if (along == nullptr && words.size() >= 2 && last == "hz" && !rooted) {
      if (const Unit* unit = unit_among(kDensities, words[words.size() - 2])) {
        along = &table.columns[i];
        along_factor = unit->factor;
        spectrum.in_volts = std::string_view(unit->name).find('v') != std::string_view::npos;
      }
    } else if (along == nullptr && table.names[i].find("defl") != std::string::npos) {
      if (const Unit* unit = unit_among(kLengths, last)) {
        along = &table.columns[i];
        along_factor = unit->factor;
        spectrum.in_volts = std::string_view(unit->name).find('v') != std::string_view::npos;
      }
    }
  }
  if (across == nullptr || along == nullptr) {
    std::string names;
    for (const std::string& name : table.names) names += (names.empty() ? "" : ", ") + name;
    spectrum.error = "has no columns like " + like + "; it has " + plain_line(names, 100);
    return spectrum;
  }
  std::vector<double> x(across->size());
  std::vector<double> y(across->size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    x[i] = across_factor * (*across)[i];
    y[i] = along_factor * (*along)[i];
    const bool good =
        std::abs(x[i]) <= 1e12 && std::abs(y[i]) <= 1e15 && (series || (x[i] >= 0 && y[i] >= 0));
    if (!good) {
      spectrum.error = "has no usable number in row " + std::to_string(i + 1);
      return spectrum;
    }
  }
  spectrum.what = (series ? "series of " : "spectrum of ") + std::to_string(x.size()) + " values";
  if (series) {
    read_series(x, y, spectrum);
    return spectrum;
  }
  spectrum.frequency_hz = std::move(x);
  spectrum.density = std::move(y);
  return spectrum;
}

ThermalStiffness stiffness_of(const Spectrum& spectrum, const ThermalSetup& setup) {
  ThermalStiffness found;
  const auto fail = [&](const std::string& why) {
    found.error = why;
    return found;
  };
  if (!spectrum.error.empty()) return fail(spectrum.error);
  double scale = 1;
  if (spectrum.in_volts) {
    if (!setup.invols_nm_v) return fail("is in volts: give --invols-nm-v as a number");
    scale = *setup.invols_nm_v * *setup.invols_nm_v;
  }
  const double lowest = setup.low_hz.value_or(1e-3);
  const double highest = setup.high_hz.value_or(1e12);
  const std::string few = "has fewer than " + std::to_string(kLeastPoints) + " values above 0 in its band";
  const Band all = band_of(spectrum, lowest, highest, scale);
  if (all.f.size() < kLeastPoints) return fail(few);
  const Peak peak = peak_of(all);
  const Band band = band_of(spectrum, setup.low_hz.value_or(0.5 * peak.frequency_hz),
                            setup.high_hz.value_or(1.5 * peak.frequency_hz), scale);
  if (band.f.size() < kLeastPoints) return fail(few);
  // Starts: quality from broad to narrow, the floor a part of the median.
  const double middle = median_of(band.p);
  Parameters best;
  double least = 1e300;
  for (const double quality : {2.0, 10.0, 50.0, 300.0}) {
    Parameters p{det_log(peak.density / (quality * quality)), det_log(peak.frequency_hz), det_log(quality),
                 det_log(0.3 * middle)};
    double cost = cost_of(band, p);
    double damping = 1e-2;
    for (int i = 0; i < 200; ++i) {
      Parameters gradient;
      const Eigen::Matrix4d normal = information(band, p, gradient);
      bool better = false;
      double gained = 0;
      for (int k = 0; k < 12 && !better; ++k) {
        Eigen::Matrix4d damped = normal;
        damped.diagonal() += damping * normal.diagonal() + Eigen::Vector4d::Constant(1e-9);
        const Parameters step = -damped.ldlt().solve(gradient);
        if (!step.allFinite()) break;
        // A floor far below the resonance is as good as none.
        Parameters trial = p + step.cwiseMax(-1.0).cwiseMin(1.0);
        trial[3] = std::max(trial[3], trial[0] - 30.0);
        trial[2] = std::clamp(trial[2], det_log(0.3), det_log(1e6));
        const double at_trial = cost_of(band, trial);
        if (at_trial < cost) {
          gained = cost - at_trial;
          p = trial;
          cost = at_trial;
          damping = std::max(0.2 * damping, 1e-9);
          better = true;
        } else {
          damping *= 6.0;
        }
      }
      if (!better || gained < 1e-8) break;
    }
    if (cost < least) {
      least = cost;
      best = p;
    }
  }
  const Oscillator oscillator(best);
  if (!(oscillator.q > 0.31) ||
      !(oscillator.f0 > 0.5 * peak.frequency_hz && oscillator.f0 < 1.5 * peak.frequency_hz) ||
      !(oscillator.resonance(oscillator.f0) > 2.0 * oscillator.b)) {
    return fail("shows no resonance above its noise: check --thermal-band-hz");
  }
  if (oscillator.q < 10 && !setup.low_hz && !setup.high_hz) {
    // So broad a peak and its floor are told apart by what is beside it.
    ThermalSetup wider = setup;
    wider.low_hz = 0.2 * oscillator.f0;
    wider.high_hz = 3.0 * oscillator.f0;
    return stiffness_of(spectrum, wider);
  }
  Parameters gradient;
  const Eigen::Matrix4d normal = information(band, best, gradient);
  double scatter = 0;
  double at_peak = 0;
  double near_peak = 0;
  const double half_width = oscillator.f0 / oscillator.q;
  for (std::size_t i = 0; i < band.f.size(); ++i) {
    const double ratio = band.p[i] / oscillator.at(band.f[i]);
    scatter += (ratio - 1.0) * (ratio - 1.0);
    if (std::abs(band.f[i] - oscillator.f0) > half_width) continue;
    at_peak += ratio;
    near_peak += 1;
  }
  found.points = band.f.size();
  found.averages = std::max(1.0, static_cast<double>(band.f.size()) / std::max(scatter, 1e-12));
  if (near_peak < 3)
    return fail("has fewer than three values across its resonance: give a longer series or a finer spectrum");
  found.scatter_at_peak = at_peak / near_peak;
  // ln⟨z²⟩ = ln A + ln f0 + ln Q + const.
  const Eigen::Matrix4d covariance = pseudo_inverse(found.averages * normal);
  const Eigen::Vector4d share{1, 1, 1, 0};
  found.relative_error = std::sqrt(std::max(0.0, share.dot(covariance * share)));
  found.frequency_hz = oscillator.f0;
  found.quality = oscillator.q;
  found.floor_nm2_hz = oscillator.b;
  found.mean_square_nm2 = 0.5 * kPi * oscillator.a * oscillator.f0 * oscillator.q;
  found.stiffness_n_m = setup.share * kBoltzmann_aj_k * setup.temperature_k / found.mean_square_nm2;
  if (!std::isfinite(found.stiffness_n_m) || !(found.stiffness_n_m > 0))
    return fail("shows no resonance with a finite mean square: check --thermal-band-hz");
  return found;
}

}  // namespace telenano::fit

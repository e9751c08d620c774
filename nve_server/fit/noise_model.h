#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace telenano::fit {

/// White noise and a spectrum that rises towards low frequencies: a sum of processes that forget over 3, 12,
/// 48, … 3072 points, whose variances go like a power of that time. Equal variances are 1/f noise (J.
/// Bernamont, Proc. Phys. Soc. 49 (1937) 138); growing ones drift.
inline constexpr std::size_t kMemories = 6;

struct NoiseModel {
  double white = 0;                          ///< variance
  std::array<double, kMemories> variance{};  ///< of each process
  double sigma() const noexcept;             ///< of one point, in all
};

/// Kalman's filter (R. E. Kalman, Trans. ASME D 82 (1960) 35) for that noise: turns a series into innovations
/// of variance 1, independent of each other. Points that are left out are passed over in time.
class Whitener {
 public:
  /// `more`: variance of each point beside the model's; `used`: which points are there. In order of time, as
  /// many of both.
  Whitener(const NoiseModel& model, const std::vector<double>& more, const std::vector<char>& used);
  /// `out[i]` is 0 where the point is not used.
  void apply(const std::vector<double>& series, double* out) const;
  double log_determinant() const noexcept { return log_determinant_; }

 private:
  std::vector<std::array<double, kMemories>> gain_;
  std::vector<double> scale_;  // 1/standard deviation of the innovation; 0: not used
  double log_determinant_ = 0;
};

/// By restricted maximum likelihood (H. D. Patterson, R. Thompson, Biometrika 58 (1971) 545): what the
/// columns of `design` take out of a noise, here the baselines' offsets and slopes, is not held for calm.
NoiseModel estimate_noise(const std::vector<double>& series, const std::vector<char>& used,
                          const std::vector<std::vector<double>>& design);

}  // namespace telenano::fit

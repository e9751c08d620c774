#pragma once

#include <algorithm>

namespace telenano::support {

/// What a hand has got out of its port, by an account that shares nothing with the product: true positions, the
/// force that really acted, long double.
///
///   extracted(k) = Σ F(j−1)·[x(j) − x(j−1)] − b Σ [x(j) − x(j−1)]²/T,   F on the hand, held between samples
///
/// The first sum is exactly what the port gave. b is the device's own damping, which lies between port and
/// hand: its least loss over a sample is bΔx²/T (Cauchy–Schwarz on ∫b v² dt), so the hand got no more than
/// `extracted`, and a device that is passive by its own friction is not blamed for what its friction takes.
class PortAccount {
 public:
  PortAccount(double damping_certain_n_s_m, double period_s)
      : damping_n_s_m_(damping_certain_n_s_m), period_s_(period_s) {}

  void add(long double force_n, long double moved_m) noexcept {
    given_j_ += force_n * moved_m;
    certain_loss_j_ += damping_n_s_m_ * moved_m * moved_m / period_s_;
    most_given_j_ = std::max(most_given_j_, given_j_);
    most_extracted_j_ = std::max(most_extracted_j_, given_j_ - certain_loss_j_);
  }

  double given_j() const noexcept { return static_cast<double>(given_j_); }  ///< to the hand so far, net
  double certain_loss_j() const noexcept { return static_cast<double>(certain_loss_j_); }
  double extracted_j() const noexcept {
    return static_cast<double>(given_j_ - certain_loss_j_);
  }  ///< now; may be negative
  double most_given_j() const noexcept { return static_cast<double>(most_given_j_); }
  /// ≥ 0: at the start nothing is extracted
  double most_extracted_j() const noexcept { return static_cast<double>(most_extracted_j_); }

 private:
  long double damping_n_s_m_;
  long double period_s_;
  long double given_j_ = 0;
  long double certain_loss_j_ = 0;
  long double most_given_j_ = 0;
  long double most_extracted_j_ = 0;
};

}  // namespace telenano::support

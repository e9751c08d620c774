#pragma once

#include <memory>

namespace telenano::oracle {

/// Maugis–Dugdale in 50-digit arithmetic, by plain bisection on Maugis' own equations in m = c/a; shares no
/// formula, parameter or code with the product. About 3 ms a point. Results are rounded to double at the very
/// end.
class MaugisDugdale {
 public:
  struct State {
    bool stable = false;  ///< false: no stable state at this overlap (then all else is 0)
    bool contact = false;
    double contact_radius = 0;
    double load = 0;
    double slope = 0;  ///< dP/dDelta
  };

  explicit MaugisDugdale(double lambda);
  ~MaugisDugdale();
  MaugisDugdale(const MaugisDugdale&) = delete;
  MaugisDugdale& operator=(const MaugisDugdale&) = delete;

  double range() const;          ///< H0
  double onset_overlap() const;  ///< where contact begins
  double fold_overlap() const;   ///< snap-off under displacement control
  bool fold_in_contact() const;
  /// Overlap `relative * max(1, |fold|)` above the fold, from the fold's 50 digits.
  double above_fold(double relative) const;
  State at_overlap(double overlap) const;
  double pull_off_load() const;  ///< load control
  double zero_load_radius() const;
  double zero_load_overlap() const;
  /// Integral of P dDelta along the curve from C = 0, by Gauss–Legendre quadrature of the contact branch.
  double energy(double overlap) const;
  double loop_energy() const;  ///< of the displacement-controlled loop: snap-in at -H0, snap-off at the fold

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::oracle

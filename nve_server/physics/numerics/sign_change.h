#pragma once

namespace telenano::physics {

/// Two places between which a continuous function changes its sign, drawn together by the regula falsi of
/// Anderson and Björck (BIT 13, 1973): the end that stays is weighted down by the success of the last step.
/// When it is near enough is the caller's to say.
struct SignChange {
  double negative = 0;       ///< where the function is below zero
  double negative_rate = 0;  ///< and its value there
  double positive = 0;
  double positive_rate = 0;
  int moved = 0;  ///< the end that moved last: 1 the positive, -1 the negative

  /// The secant's root, or the middle where rounding throws that out. Needs negative < positive.
  double between() const noexcept {
    const double x = (negative * positive_rate - positive * negative_rate) / (positive_rate - negative_rate);
    return x > negative && x < positive ? x : 0.5 * (negative + positive);
  }

  /// The function's value at `x`, between the two; not zero.
  void take(double x, double rate) noexcept {
    const bool above = rate > 0;
    const double weight = 1.0 - rate / (above ? positive_rate : negative_rate);
    (above ? positive : negative) = x;
    (above ? positive_rate : negative_rate) = rate;
    if (moved == (above ? 1 : -1)) (above ? negative_rate : positive_rate) *= weight > 0 ? weight : 0.5;
    moved = above ? 1 : -1;
  }
};

}  // namespace telenano::physics

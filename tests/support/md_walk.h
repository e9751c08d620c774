#pragma once

/// Which state a tip is in, from first principles, for tests only: the whole curve of Maugis–Dugdale written
/// from the paper in m = c/a and long double, the stable states as those with residual zero on the segment
/// where Z = Delta + c P rises with the approach, the ends of segments by search. Shares no formula,
/// parameter or code with the product, and thousands of times faster than md_oracle.h (19 digits instead of
/// 50).
namespace telenano::oracle {

class MdWalk {
 public:
  using Real = long double;

  /// Dimensionless spring compliance c >= 0; `van_der_waals`: attraction outside joined at the crossing.
  MdWalk(Real lambda, Real compliance, bool van_der_waals);

  /// The tip is outside (free or van der Waals) until Z exceeds this ...
  Real leaves_outside() const { return outside_end_; }
  /// ... and inside (on the Dugdale curve) until Z falls below this.
  Real leaves_inside() const { return inside_end_; }

  struct State {
    Real overlap = 0;
    Real load = 0;
    Real gain = 0;  ///< |dP/dZ|: what rounding of Z does to the load
  };
  State inside(Real z) const;   ///< the stable root on the curve; needs leaves_inside() < z
  State outside(Real z) const;  ///< needs z < leaves_outside()
  Real range() const { return h0_; }

 private:
  struct Point {
    Real overlap = 0;
    Real load = 0;
  };
  // One coordinate along the whole curve, from deep contact (-inf) to no interaction: ln(m − 1) up to kOnset,
  // then kOnset + (C0 − C).
  Point at(Real x) const;
  Real held(Real x) const;
  Real held_at_gap(Real y) const;
  Real segment_end(Real compliance) const;

  Real lambda_, compliance_, h0_, q_, c0_, eta_;
  bool van_der_waals_;
  Real end_x_ = 0;    // of the segment inside
  Real end_gap_ = 0;  // of the segment outside
  Real inside_end_ = 0, outside_end_ = 0;
};

}  // namespace telenano::oracle

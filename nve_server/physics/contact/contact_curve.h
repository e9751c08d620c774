#pragma once

#include <concepts>

namespace telenano::physics {

/// A contact law as a curve, without dimensions: overlap Delta, load P and radii over one parameter s that
/// runs from first interaction to deep contact. Laws differ in the curve; branches, jumps and the balance
/// with a spring are found on it in the same way (tip_sample_law.h).

/// What is held: Z = overlap * Delta + load * P. {1, c} a spring of compliance c, {1, 0} the overlap, {0, 1}
/// the load.
struct Held {
  double overlap = 1;
  double load = 0;
};

/// One state of the curve.
struct CurvePoint {
  bool contact = false;
  double parameter = 0;            ///< s, see above
  double outer_radius = 0;         ///< C
  double contact_radius = 0;       ///< A
  double overlap = 0;              ///< Delta
  double load = 0;                 ///< P
  double overlap_rate = 0;         ///< dDelta/ds
  double load_rate = 0;            ///< dP/ds
  double contact_radius_rate = 0;  ///< dA/ds
  double overlap_bend = 0;         ///< d2Delta/ds2; 0 where the law does not say
  double load_bend = 0;            ///< d2P/ds2
  double overlap_by_lambda = 0;  ///< lambda dDelta/dlambda at this u, or C; all 0 where the law does not say
  double load_by_lambda = 0;     ///< lambda dP/dlambda
  double contact_radius_by_lambda = 0;
  double energy = 0;  ///< integral of P dDelta along the curve from where interaction begins
  double angle = 0;   ///< Maugis' theta, and its rates; 0 where the law has none
  double angle_rate = 0, angle_bend = 0;

  double held(const Held& h) const noexcept { return h.overlap * overlap + h.load * load; }
  /// Moves by a small `ds` along the curve, as far as the law says: to second order (the radius and the rates
  /// to first), or without bends to first (the energy to second).
  void shift(double ds) noexcept {
    if (ds == 0) return;
    const double moved = (overlap_rate + 0.5 * overlap_bend * ds) * ds;
    energy += (load + 0.5 * load_rate * ds) * moved;
    overlap += moved;
    load += (load_rate + 0.5 * load_bend * ds) * ds;
    overlap_rate += overlap_bend * ds;
    load_rate += load_bend * ds;
    contact_radius += contact_radius_rate * ds;
    angle += (angle_rate + 0.5 * angle_bend * ds) * ds;
    parameter += ds;
  }
  double held_rate(const Held& h) const noexcept { return h.overlap * overlap_rate + h.load * load_rate; }
  double held_bend(const Held& h) const noexcept { return h.overlap * overlap_bend + h.load * load_bend; }
};

enum class CurveStatus : unsigned char { kOk, kNoState, kNotConverged };

struct CurveSolution {
  CurveStatus status = CurveStatus::kOk;
  CurvePoint point;     ///< with kNoState: the fold, where the last stable state was
  int evaluations = 0;  ///< of the contact formulas
};

/// What a step needs to know of a law, whatever its formulas. The stable states under a spring form one
/// segment, from the fold of Z to deep contact, along which the parameter grows; states without contact have
/// smaller parameters than those in contact. Besides, find_handover(curve, outside, guess) and
/// find_parting(curve, outside) join it to van der Waals (joined_law.h).
template <class Curve>
concept ContactCurve = requires(const Curve& curve, const Held& held, double x) {
  { curve.lambda() }
  noexcept->std::same_as<double>;
  /// Without van der Waals the attraction begins at the overlap -range().
  { curve.range() }
  noexcept->std::same_as<double>;
  /// The end of the stable segment.
  { curve.fold(held) }
  noexcept->std::same_as<CurvePoint>;
  /// solve(z, held, guess): the stable state that holds Z, from a contact parameter to start with (0: none).
  { curve.solve(x, held, x) }
  noexcept->std::same_as<CurveSolution>;
};

}  // namespace telenano::physics

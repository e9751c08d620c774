#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "telenano/nve_server/physics/contact/contact_curve.h"
#include "telenano/nve_server/physics/contact/joined_law.h"
#include "telenano/nve_server/physics/contact/maugis_dugdale.h"

namespace telenano::physics {

/// Maugis–Dugdale from a table, for one lambda: the same curve as maugis_dugdale.h without its transcendental
/// equation.
///
/// Formula   In contact P and A are cubic Hermite splines of t = sqrt(Delta - Delta_0), which is the curve's
///           parameter. Delta_0 is the fold of overlap where this lies in contact, else the onset of contact:
///           P has an infinite slope over Delta at the one and a kink at the other, and both are smooth over
///           t. U = U_0 + int P 2 t dt is integrated exactly, segment by segment, so that force, energy and
///           stiffness (P'/(2 t)) belong to one another to rounding. Without contact the closed forms of
///           maugis_dugdale.h.
/// Segments  kPerOctave equal ones between each 2^e and 2^(e+1), e = -16 ... 9 (Delta to 10^6), one below,
///           found from the exponent's bits. Beyond: the direct method.
/// Errors    Against 50 digits |P - P_MD| <= 1e-8 (|P| + |pull-off|) (seen: 6.4e-9), contact radius 5e-11.
/// Cost      Some 0.7 ms and 80 KB to make; 38 ns for a state with its rates, radius and energy, some 6 ns
///           for the force alone (load_at). A table belongs to its lambda and may be shared by threads.
class MaugisTable {
 public:
  /// Not for loops: allocates.
  explicit MaugisTable(double lambda);

  double lambda() const noexcept { return exact_.lambda(); }
  double range() const noexcept { return exact_.range(); }
  const MaugisDugdale& exact() const noexcept { return exact_; }
  const Handover& handover() const noexcept { return handover_; }
  const Parting& parting() const noexcept { return parting_; }
  double start_overlap() const noexcept { return start_.overlap; }  ///< Delta_0
  double end_parameter() const noexcept { return end_; }            ///< t where the table ends

  /// P at a held overlap, the same bits as solve({1, 0}): below the end of the curve the load there. Inside
  /// the table a square root and a cubic, whose cell and place in it are read from the root's bits.
  double load_at(double overlap) const noexcept {
    const auto bits = std::bit_cast<std::uint64_t>(std::sqrt(overlap - start_.overlap));
    // Wraps for what lies before the first cell of an octave, or below the start (not a number).
    const std::uint64_t cell = (bits >> (52 - kPerOctaveBits)) - kFirstCell;
    if (cell >= kCells) return load_outside_cells(overlap);
    // The bits of the fraction below the cell's are the place in it: 1.xxx - 1.
    const double x = std::bit_cast<double>(((bits << kPerOctaveBits) & kFractionBits) | kOneBits) - 1.0;
    return value(loads_[cell + 1], x);
  }

  CurvePoint contact(double t) const noexcept {
    CurvePoint p;
    contact(t, p);
    return p;
  }
  CurvePoint fold(const Held& held) const noexcept;
  CurveSolution solve(double z, const Held& held, double guess = 0) const noexcept {
    CurveSolution out;
    solve(z, held, guess, out);
    return out;
  }
  /// The same into `out`: a step of a flat sample feels it when states are copied.
  void solve(double z, const Held& held, double guess, CurveSolution& out) const noexcept;

 private:
  using Cubic = std::array<double, 4>;
  static constexpr int kPerOctaveBits = 5;
  static constexpr int kPerOctave = 1 << kPerOctaveBits;
  static constexpr int kFirstOctave = -16;
  static constexpr int kOctaves = 26;
  static constexpr std::uint64_t kCells = std::uint64_t{kOctaves} * kPerOctave;
  // Exponent and leading bits of the fraction of a number, read as one integer, count the cells.
  static constexpr std::uint64_t kFirstCell = static_cast<std::uint64_t>(1023 + kFirstOctave)
                                              << kPerOctaveBits;
  static constexpr std::uint64_t kFractionBits = (std::uint64_t{1} << 52) - 1;
  static constexpr std::uint64_t kOneBits = std::uint64_t{1023} << 52;

  /// By pairs: half the latency of Horner's scheme.
  static double value(const Cubic& c, double x) noexcept {
    return (c[0] + x * c[1]) + (x * x) * (c[2] + x * c[3]);
  }

  // Cubics in the fraction x = (t - left)/width of the segment; the load's apart, densely.
  struct Segment {
    double left, width, per_width;
    Cubic radius;
    double energy;  // at x = 0
  };

  /// What Newton's method looks at, the same bits as contact() gives.
  struct Balance {
    double overlap, load, overlap_rate, load_rate;
    double held(const Held& h) const noexcept { return h.overlap * overlap + h.load * load; }
    double held_rate(const Held& h) const noexcept { return h.overlap * overlap_rate + h.load * load_rate; }
  };
  Balance balance(double t) const noexcept;
  void contact(double t, CurvePoint& p) const noexcept;
  std::size_t segment_of(double t) const noexcept;
  double load_outside_cells(double overlap) const noexcept;
  void append(double left, double right, const CurvePoint& at_left, const CurvePoint& at_right,
              double load_slope_left, double radius_slope_left);
  void join_van_der_waals() noexcept;
  CurveSolution solve_directly(double z, const Held& held) const noexcept;

  MaugisDugdale exact_;
  CurvePoint start_;
  bool fold_in_contact_ = false;
  double end_ = 0;
  std::vector<Segment> segments_;
  std::vector<Cubic> loads_;
  Handover handover_;
  Parting parting_;
};

/// The handover that the table keeps; its contact state is one of the table, so that the force is continuous.
inline const Handover& find_handover(const MaugisTable& curve, const OutsideLaw& /*outside*/,
                                     double /*guess*/ = 0) noexcept {
  return curve.handover();
}
inline const Parting& find_parting(const MaugisTable& curve, const OutsideLaw& /*outside*/) noexcept {
  return curve.parting();
}

static_assert(ContactCurve<MaugisTable>);

}  // namespace telenano::physics

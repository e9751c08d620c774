#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace telenano::physics {

/// What the parts of a foot add to its force on the way out of a contact: the law of one foot, taken apart by gap,
/// so that the greatest attraction of several feet, or of one that is no paraboloid, can be put together from it.
///
/// Model     Of a ball of radius R the tip has equal areas 2πR du at equal steps du of the gap above the nearest
///           point (Archimedes). Let F_R(u) be the law's force at a gap u of that point, on the way out, elasticity
///           included. Then
///             F_R(w) = 2πR ∫_w^∞ q_R(u) du,  q_R = −F_R'/(2πR),
///           and over a ground of which N(d) dd is the area at depths d below the top
///             F(w) = ∫ N(d) q_R(w + d) dd,
///           R that of the finest foot: it is pressed while a wider ground beside it still attracts, and small feet
///           are stiffer for their size than large ones. excess = ln(max −F / max −F_R). It is below 0 where ρ of one
///           exponential has counted ground in that is out of reach.
/// Elastic   Each part bears its own load here, as if the others did not move it. Two things of elastic bodies are
///           put in by a number each. Feet do not let go at one gap: F_R is smoothed by a Gaussian of σ = kSmoothing
///           times the way from no force to the greatest attraction. And feet close by are moved with the one that
///           is pressed: rise = (1 − kShared E) excess, E = ln(∫ N e^{−d/way} dd/(2πR way)), which is 0 for one
///           foot.
/// Errors    Pull-off against boundary elements with Lennard-Jones adhesion, over eight self-affine grounds, 384
///           places (rms slope 0.12 to 0.4; half of them dilated by a tip of 6 to 15 nm), where the two numbers were
///           chosen (they are not kept): median 2.6 %, ninth decile 8.8 %; without the rise 4.2 and 15 %. At 96 places of four other
///           grounds (`ctest -R SelfAffine`) 1.9 and 7.6 %. The midpoint rule over areas leaves some 1e-3 on planes.
class RetractionKernel {
 public:
  /// Force (nN, attraction negative) over the radius (nm) of a foot at a gap (nm, pressed negative) and ln(R/1 nm),
  /// on the way out of a contact. No attraction at the tip's radius: no kernel, active() is false.
  using ForcePerRadius = std::function<double(double gap_nm, double log_radius)>;
  RetractionKernel(const ForcePerRadius& force, double tip_radius_nm);

  bool active() const noexcept { return !columns_.empty(); }

  /// Depths below the top that areas are sorted by: bin b is at (b − kBinsAbove) bin_nm() below it.
  double bin_nm() const noexcept { return bin_; }
  static constexpr int kBins = 72;
  static constexpr int kBinsAbove = 4;

  using Areas = float[kBins];  ///< nm², by normal depth
  /// By how much ρ = ln(R/1 nm) of the finest foot must rise for the pull-off of all, within ± kMostRise. No
  /// allocation.
  double log_rise(const Areas& areas, double log_radius) const noexcept;
  /// The excess above: each part bears its own load. −∞ where nothing attracts.
  double log_excess(const Areas& areas, double log_radius) const noexcept;

  /// FNV-1a over all that log_rise() depends on; 0 where not active.
  std::uint64_t hash() const noexcept;

  static constexpr double kSmoothing = 0.15;
  static constexpr double kMostRise = 1.5;
  static constexpr double kShared = 0.5;

 private:
  static constexpr int kPlaces = 24;  // w, two bins apart
  static constexpr int kReach = kBins + 2 * (kPlaces - 1);
  /// q for one R, even and odd bins apart: q[parity][k] is at bin 2k + parity of the reach.
  struct Column {
    float q[2][(kReach + 1) / 2 + 1];
    double log_peak;  ///< of a single foot, over its radius
  };
  struct Scale {
    double peak = 0;   // gap of the greatest attraction
    double way = 0;    // to there from no force
    double range = 0;  // from there to half of it; 0: nothing attracts
  };
  static Scale scale(const ForcePerRadius& force, double tip_radius_nm);
  Column column(const ForcePerRadius& force, double log_radius, double first_gap_nm) const;
  static double log_peak(const Column& column, const Areas& areas) noexcept;

  double bin_ = 0;
  float nearness_[kBins] = {};
  double first_ = 0;  // ρ of the first column
  std::vector<Column> columns_;
};

}  // namespace telenano::physics

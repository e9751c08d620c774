#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "telenano/common/base/vec3.h"

namespace telenano::afm {

/// The height of the piezo at which the tip touches, from touches now and then: what it is now, how fast it
/// moves, and by how much that may be wrong. A Kalman filter; lengths in nm, times in s.
///
///   H(t) = h(t) + Σ aᵢ yᵢ(t),   dh/dt = v,   dv/dt = white noise of density q
///
/// v is the drift. yᵢ is the piezo's height behind a low pass of 4, 20 and 100 s (from where it stood at the
/// first touch): creep follows the motion late, over all of these times, by parts aᵢ that are the rig's own
/// and are learned. So what the last large motion left behind is told from what goes on.
///
/// A touch at a place measures H + p, with an error of some tenths of a nanometre, and more for the distance
/// across. p, the height of the ground there over that of the start, is 0 at the start and learned elsewhere.
///
/// How much the drift changes is the rig's own too: q follows how large the errors of the predictions are
/// beside what was said of them. A touch that lies outside of all that (a step of the ground, a tip that has
/// become shorter) is believed anyway: it is where the tip touches.
class SurfaceTracker {
 public:
  /// The first touch of an approach, over (x, y), where W's zero is: nothing is known of H before. The drift and the creep of
  /// an earlier approach stay known, the drift less the longer ago.
  void begin(double x_nm, double y_nm, double height_nm, std::int64_t now_ns) noexcept;
  /// A touch over (x, y). A place that is new, more than kSamePlace_nm from all that are known, is learned.
  /// `spread_nm`: what the touch may be wrong by, besides kTouch_nm.
  void touch(double x_nm, double y_nm, double height_nm, double spread_nm, std::int64_t now_ns) noexcept;
  /// Where the piezo stands, now and then, whether it touches or not: creep follows it.
  void piezo(double height_nm, std::int64_t now_ns) noexcept;

  double height_nm(std::int64_t now_ns) const noexcept;
  /// The truth is within this of height_nm in 95 % of all times.
  double bound_nm(std::int64_t now_ns) const noexcept;
  double drift_nm_s() const noexcept { return state_[1]; }
  double drift_bound_nm_s() const noexcept;

  static constexpr double kSamePlace_nm = 3;
  static constexpr double kTouch_nm = 0.12;  // noise, bending with temperature, curvature of the contact
  static constexpr double kSlope = 0.25;     // of the ground between two touches not quite at one place

 private:
  static constexpr std::size_t kCreeps = 3, kPlaces = 8, kFirstPlace = 2 + kCreeps;
  static constexpr std::size_t kStates = kFirstPlace + kPlaces;
  using State = std::array<double, kStates>;
  struct Place {
    double x_nm = 0, y_nm = 0;
    bool known = false;
  };

  void predict(std::int64_t now_ns) noexcept;
  void correct(std::size_t place, double height_nm, double variance) noexcept;
  /// Of H + p; the row of H's derivatives.
  State row(std::size_t place) const noexcept;

  State state_{};
  std::array<State, kStates> covariance_{};
  std::int64_t time_ns_ = 0;
  bool begun_ = false;
  double q_ = 0;  // nm²/s³
  // Creep.
  std::array<double, kCreeps> late_nm_{};
  double from_nm_ = 0;
  std::int64_t piezo_ns_ = 0;
  bool piezo_known_ = false;
  std::array<Place, kPlaces> places_{};
  std::size_t next_place_ = 1;
};

}  // namespace telenano::afm

#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "telenano/common/recording/sample.h"

namespace telenano::view_model {

/// The force–distance curve of the last touch: one approach and the retract that followed it, as an AFM plots
/// them. Made of the replies of the slave, never of the forces of the hand: an observer, who feels nothing,
/// and a method that renders a model see the curve of the tip.
class ForceCurve {
 public:
  /// The direction has turned when the tip has gone back so far. Above the noise of a height, below a touch.
  static constexpr double kTurn_nm = 0.5;
  /// Two replies farther apart in time belong to no common curve: what lay between was not seen.
  static constexpr double kBreakS = 0.2;
  /// A tip leaps when it goes at least so many times as far as the base of its lever. On a stable branch
  /// the ratio is k / (k − k_ts), so 4 is a gradient of attraction of ¾ of the lever's stiffness; at the
  /// instability (k_ts = k) the ratio has no bound.
  static constexpr double kLeapRatio = 4;
  /// An attraction counts from so many standard deviations of the noise on. Of 10⁴ Gaussian values one in 300
  /// such curves has one by chance.
  static constexpr double kSigmas = 5;
  static constexpr double kLeast_nn = 1e-3;  ///< and from here on without noise
  static constexpr std::size_t kPointsMax = 16384;

  struct Point {
    double time_s = 0;
    double distance_nm = 0;  ///< apex above the surface under it; negative: below the undeformed surface
    double height_nm = 0;    ///< apex, along z of W
    double base_nm = 0;      ///< end of the lever: height less the lever's bend
    double force_nn = 0;     ///< along z, push positive
    double lateral_nn = 0;   ///< size of the part across z
    double work_aj = 0;      ///< done on the sample by the tip since some moment; 1 nN·nm = 1 aJ
    bool contact = false;
  };

  enum class State : std::uint8_t {
    kNone,      ///< there is no such segment
    kUnderWay,  ///< it goes on
    kDone,
    kCutOff,  ///< the replies stopped before its end
  };

  struct Segment {
    std::vector<Point> points;
    State state = State::kNone;
    double lateral_most_nn() const noexcept;
  };

  /// Where the sample pulled most.
  struct Pull {
    double force_nn = 0;     ///< along z, negative
    double distance_nm = 0;  ///< there
    bool leapt = false;      ///< the lever lost to the gradient of the force
    double leap_from_nm = 0;
    double leap_to_nm = 0;
  };

  /// One row of the loop. Rows without a reply that is new are passed over.
  void take(const recording::Sample& sample, double distance_nm);

  /// Goes down and into contact. While it is the newest, there is no retract.
  const Segment& approach() const noexcept { return approach_; }
  /// From the last lowest point up. Done when the contact has been left.
  const Segment& retract() const noexcept { return retract_; }
  /// Of the approach; none: no attraction above the noise.
  std::optional<Pull> snap_in() const;
  /// Of the retract; none also before it is done, or if it was cut off: the most may have been to come.
  std::optional<Pull> pull_off() const;
  /// Lost in the touch, from the begin of the approach to the end of the retract: −∮F dz, with all presses
  /// between. None before the retract is done.
  std::optional<double> hysteresis_aj() const noexcept;
  /// Standard deviation of the force's noise, of the differences between replies in free air.
  double noise_nn() const noexcept;

  /// Comment lines with what was found and its units, a header and a row for each point.
  std::string csv() const;

 private:
  std::optional<Pull> pull_of(const Segment& segment, int way) const;
  void turn(int way);
  void show();
  void start_anew();

  std::vector<Point> track_;  // since the last turn
  int way_ = 0;               // −1 down, +1 up, 0 not known yet
  std::size_t extreme_ = 0;   // of the track: lowest on the way down, highest on the way up
  bool any_ = false;
  bool in_touch_ = false;  // the approach shown is of the touch that goes on
  std::int64_t reply_seen_ = 0;
  Point last_{};
  bool last_free_ = false;
  double differences_nn2_ = 0;
  std::uint64_t differences_ = 0;
  Segment approach_;
  Segment retract_;
};

}  // namespace telenano::view_model

#pragma once

#include <array>
#include <optional>
#include <vector>

#include "telenano/nve_server/fit/curve_fit.h"
#include "telenano/nve_server/fit/curve_path.h"
#include "telenano/nve_server/fit/decompositions.h"

namespace telenano::fit {

inline constexpr double kLeastDistance_nm = 0.05;  // z0 that a scene takes
inline constexpr double kGreatestDistance_nm = 2.0;
inline constexpr double kLeastRadius_nm = 1.0;
inline constexpr double kGreatestRadius_nm = 1e4;
inline constexpr int kLeaps =
    3;  // their places are the last residuals: approach, the bridge's step there, retract

/// Where each parameter stands in the vector; −1: not free.
struct ParameterLayout {
  int modulus = 0;
  int work = -1;
  int radius = -1;
  int distance = -1;
  int hamaker = -1;
  int humidity = -1;
  int film = -1;
  int shift = -1;
  int touch = 0;
  int offsets = 0;
  int laws = 0;  // the first ones, that change the path
  int count = 0;
};

/// A curve's whitened residuals as a function of the parameters that curve_fit.h names. Curve and setup must outlive it.
class FitProblem {
 public:
  FitProblem(const PreparedCurve& curve, const FitSetup& setup);

  const ParameterLayout& at() const { return at_; }
  Eigen::Index rows() const { return rows_; }
  long evaluations() const { return evaluations_; }

  double radius_nm(const Vector& p) const;
  physics::TipSampleParameters law(const Vector& p) const;

  /// Where H is free or held, it and w must leave z0 where a scene takes it. `fixed` and a held H stay, the other
  /// one gives way.
  void keep_distance(Vector& p, int fixed) const;
  /// z0 or R has come to an end of what a scene takes: an interval that goes so far is open, whichever it is of.
  bool at_end_of_others(const Vector& p) const;

  /// Which points lie on the same side of each leap in curve and model.
  void mask(const Vector& p, std::vector<char>& used);

  void model_nm(const Vector& p, bool approach, std::vector<double>& out);

  /// A perturbation of the residuals in nm, by segment, as it is seen after whitening.
  void whiten(const std::vector<double>& approach, const std::vector<double>& retract,
              const std::vector<char>& used, Vector& out);

  /// False: the law has no balance somewhere.
  bool residuals(const Vector& p, const std::vector<char>& used, Vector& out);

 private:
  /// A leap of the curve, and which one of the model it is.
  struct Match {
    bool approach = true;
    const std::optional<Leap>& leap;
    const std::optional<double>& model_x_nm;
    double model_nn = 0;
  };

  double contact_modulus_gpa(const Vector& p) const;
  /// Kept while only touch, shift and baseline change.
  const CurvePath& path(const Vector& p);
  double overlap_nm(const Vector& p, bool approach, double z_nm) const;
  double baseline_nm(const Vector& p, bool approach, double z_nm) const;
  std::array<Match, kLeaps> matches(const CurvePath& way) const;

  const PreparedCurve& curve_;
  const FitSetup& setup_;
  ParameterLayout at_;
  double from_nm_ = 0;
  double to_nm_ = 0;
  double tolerance_nn_ = 0;
  std::vector<double> more_;  // variance by noise of z
  Eigen::Index rows_ = 0;
  std::optional<Whitener> whitener_;
  std::vector<char> whitened_;
  std::vector<double> series_;
  CurvePath path_;
  Vector path_of_;
  std::vector<double> work_[2];
  long evaluations_ = 0;
};

}  // namespace telenano::fit

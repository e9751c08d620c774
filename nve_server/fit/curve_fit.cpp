#include "telenano/nve_server/fit/curve_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/fit/curve_path.h"
#include "telenano/nve_server/physics/long_range/van_der_waals.h"

namespace telenano::fit {
namespace {

constexpr double kHuber = 3.0;
constexpr double kQuantile = 3.841458820694124;  // χ² of one degree of freedom, 95 %
constexpr double kLostLeap = 30.0;               // standard deviations: a leap that the model does not have
constexpr double kLogStep = 1e-4;                // of a logarithm: well above the path's own 1e-8
constexpr double kPathShare = 0.1;               // of the noise: where the path is made closer
constexpr double kLeastDistance_nm = 0.05;       // z0 that a scene takes
constexpr double kGreatestDistance_nm = 2.0;
constexpr double kLeastRadius_nm = 1.0;
constexpr double kGreatestRadius_nm = 1e4;
constexpr double kLeastHumidity = 1.0;  // %
constexpr double kGreatestHumidity = 98.9;
constexpr double kLeastFilm_nm = 0.01;
constexpr double kGreatestFilm_nm = 100.0;
constexpr int kOffsets = 4;  // approach, retract, their tilts
constexpr int kLeaps = 3;  // their places are the last residuals: approach, the bridge's step there, retract

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;

double power(double base, double exponent) {
  return det_exp(exponent * det_log(base));
}

/// Where each parameter stands in the vector; −1: not free.
struct Layout {
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

Layout layout_of(const FitSetup& setup) {
  Layout layout;
  int n = 1;
  if (setup.law.model != physics::ContactLaw::kHertz) layout.work = n++;
  if (setup.fit_radius) layout.radius = n++;
  if (setup.fit_distance) layout.distance = n++;
  if (setup.fit_hamaker && layout.work >= 0) layout.hamaker = n++;
  if (setup.fit_humidity) layout.humidity = n++;
  if (setup.fit_film) layout.film = n++;
  layout.laws = n;
  layout.touch = n++;
  if (setup.fit_shift) layout.shift = n++;
  layout.offsets = n;
  layout.count = n + kOffsets;
  return layout;
}

class Problem {
 public:
  Problem(const PreparedCurve& curve, const FitSetup& setup)
      : curve_(curve), setup_(setup), at_(layout_of(setup)) {
    const std::vector<double>& z = curve.approach.z_nm;
    const std::vector<double>& back = curve.retract.z_nm;
    const double top =
        std::max(*std::max_element(z.begin(), z.end()), *std::max_element(back.begin(), back.end()));
    const double low =
        std::min(*std::min_element(z.begin(), z.end()), *std::min_element(back.begin(), back.end()));
    const double margin = 5.0 + 0.05 * (top - low);
    from_nm_ = curve.touch_z_nm - top - margin;
    to_nm_ = curve.touch_z_nm - low + margin;
    tolerance_nn_ = kPathShare * std::sqrt(curve.noise.white) / setup.compliance_nm_nn;
    rows_ = static_cast<Eigen::Index>(z.size() + back.size()) + kLeaps;
    for (const PreparedSegment* segment : {&curve.approach, &curve.retract}) {
      for (const double slope : segment->slope) {
        const double of_z = curve.z_noise_nm * slope;
        more_.push_back(of_z * of_z);
      }
    }
  }

  const Layout& at() const { return at_; }
  Eigen::Index rows() const { return rows_; }
  long evaluations() const { return evaluations_; }

  double contact_modulus_gpa(const Vector& p) const {
    const double sample = (1.0 - setup_.sample_poisson * setup_.sample_poisson) / det_exp(p[at_.modulus]);
    return 4.0 / 3.0 / (sample + setup_.tip_compliance_per_gpa);
  }
  double radius_nm(const Vector& p) const {
    return at_.radius < 0 ? setup_.radius_nm : det_exp(p[at_.radius]);
  }
  physics::TipSampleParameters law(const Vector& p) const {
    physics::TipSampleParameters law = setup_.law;
    law.method = physics::MaugisMethod::kDirect;
    law.contact_modulus_gpa = contact_modulus_gpa(p);
    if (at_.work >= 0) law.work_of_adhesion_n_m = det_exp(p[at_.work]);
    if (at_.distance >= 0) law.equilibrium_distance_nm = det_exp(p[at_.distance]);
    if (at_.hamaker >= 0 || (setup_.hamaker_aj && at_.work >= 0)) {
      const double hamaker = at_.hamaker >= 0 ? det_exp(p[at_.hamaker]) : *setup_.hamaker_aj;
      law.equilibrium_distance_nm = physics::VanDerWaals::cut_off_nm(hamaker, law.work_of_adhesion_n_m);
    }
    physics::CapillaryParameters& water = law.long_range.capillary;
    if (at_.humidity >= 0) water.humidity_percent = det_exp(p[at_.humidity]);
    if (at_.film >= 0) water.film_nm = det_exp(p[at_.film]);
    return law;
  }

  /// Where H is free or held, it and w must leave z0 where a scene takes it. `fixed` and a held H stay, the other
  /// one gives way.
  void keep_distance(Vector& p, int fixed) const {
    if (at_.work < 0 || (at_.hamaker < 0 && !setup_.hamaker_aj)) return;
    // ln H = ln(12π z0²) + ln w
    const double least = det_log(12.0 * kPi * kLeastDistance_nm * kLeastDistance_nm);
    const double most = det_log(12.0 * kPi * kGreatestDistance_nm * kGreatestDistance_nm);
    if (at_.hamaker >= 0 && fixed != at_.hamaker) {
      p[at_.hamaker] = std::clamp(p[at_.hamaker], p[at_.work] + least, p[at_.work] + most);
    } else {
      const double hamaker = at_.hamaker >= 0 ? p[at_.hamaker] : det_log(*setup_.hamaker_aj);
      p[at_.work] = std::clamp(p[at_.work], hamaker - most, hamaker - least);
    }
  }
  /// z0 or R has come to an end of what a scene takes: an interval that goes so far is open, whichever it is of.
  bool at_end_of_others(const Vector& p) const {
    if (at_.radius >= 0 && (p[at_.radius] < det_log(1.001 * kLeastRadius_nm) ||
                            p[at_.radius] > det_log(0.999 * kGreatestRadius_nm)))
      return true;
    if (at_.hamaker < 0) return false;
    const double distance = law(p).equilibrium_distance_nm;
    return distance < 1.001 * kLeastDistance_nm || distance > 0.999 * kGreatestDistance_nm;
  }

  /// Kept while only touch, shift and baseline change.
  const CurvePath& path(const Vector& p) {
    const Vector laws = p.head(at_.laws);
    if (path_of_.size() != laws.size() || path_of_ != laws) {
      path_ = trace_path(physics::TipSampleLaw(law(p)), radius_nm(p), setup_.compliance_nm_nn, from_nm_,
                         to_nm_, tolerance_nn_);
      path_of_ = laws;
      ++evaluations_;
    }
    return path_;
  }

  double overlap_nm(const Vector& p, bool approach, double z_nm) const {
    const double shift = approach || at_.shift < 0 ? 0.0 : p[at_.shift];
    return p[at_.touch] + shift - z_nm;
  }
  double baseline_nm(const Vector& p, bool approach, double z_nm) const {
    return p[at_.offsets + (approach ? 0 : 1)] +
           p[at_.offsets + (approach ? 2 : 3)] * (z_nm - curve_.z_middle_nm);
  }

  /// A leap of the curve, and which one of the model it is.
  struct Match {
    bool approach = true;
    const std::optional<Leap>& leap;
    const std::optional<double>& model_x_nm;
    double model_nn = 0;
  };
  std::array<Match, kLeaps> matches(const CurvePath& way) const {
    const PathSegment& in = way.approach;
    const PathSegment& out = way.retract;
    const bool two = curve_.approach.step.has_value();
    return {Match{true, curve_.approach.leap, two ? in.dry_leap_x_nm : in.leap_x_nm,
                  two ? in.dry_leap_nn : in.leap_nn},
            Match{true, curve_.approach.step, in.bridge_x_nm, in.bridge_nn},
            Match{false, curve_.retract.leap, out.leap_x_nm, out.leap_nn}};
  }

  /// Which points lie on the same side of each leap in curve and model.
  void mask(const Vector& p, std::vector<char>& used) {
    used.assign(static_cast<std::size_t>(rows_), 1);
    for (const Match& match : matches(path(p))) {
      if (!match.leap) continue;
      const std::vector<double>& z = (match.approach ? curve_.approach : curve_.retract).z_nm;
      std::size_t row = match.approach ? 0 : curve_.approach.z_nm.size();
      for (std::size_t i = 0; i < z.size(); ++i, ++row) {
        if (i > match.leap->before && i < match.leap->after) used[row] = 0;
        if (!match.model_x_nm) continue;
        const double x = overlap_nm(p, match.approach, z[i]);
        const bool model_after = match.approach ? x >= *match.model_x_nm : x <= *match.model_x_nm;
        if (model_after != (i >= match.leap->after)) used[row] = 0;
      }
    }
  }

  void model_nm(const Vector& p, bool approach, std::vector<double>& out) {
    const PathSegment& segment = approach ? path(p).approach : path(p).retract;
    const std::vector<double>& z = (approach ? curve_.approach : curve_.retract).z_nm;
    out.resize(z.size());
    for (std::size_t i = 0; i < z.size(); ++i) {
      out[i] = setup_.compliance_nm_nn * segment.force_nn(overlap_nm(p, approach, z[i])) +
               baseline_nm(p, approach, z[i]);
    }
  }

  /// A perturbation of the residuals in nm, by segment, as it is seen after whitening.
  void whiten(const std::vector<double>& approach, const std::vector<double>& retract,
              const std::vector<char>& used, Vector& out) {
    if (!whitener_ || used != whitened_) {
      whitened_ = used;
      std::vector<char> points(used.begin(), used.end() - kLeaps);
      whitener_.emplace(curve_.noise, more_, points);
    }
    series_.assign(approach.begin(), approach.end());
    series_.insert(series_.end(), retract.begin(), retract.end());
    out.setZero(rows_);
    whitener_->apply(series_, out.data());
  }

  /// False: the law has no balance somewhere.
  bool residuals(const Vector& p, const std::vector<char>& used, Vector& out) {
    const CurvePath& way = path(p);
    if (!way.approach.good || !way.retract.good) return false;
    for (const bool approach : {true, false}) {
      const PreparedSegment& segment = approach ? curve_.approach : curve_.retract;
      std::vector<double>& r = approach ? work_[0] : work_[1];
      model_nm(p, approach, r);
      for (std::size_t i = 0; i < r.size(); ++i) r[i] = segment.deflection_nm[i] - r[i];
    }
    whiten(work_[0], work_[1], used, out);
    Eigen::Index row = rows_ - kLeaps;
    for (const Match& match : matches(way)) {
      double& last = out[row++];
      last = 0;
      if (!match.leap) continue;
      last = kLostLeap;
      if (match.model_x_nm && setup_.compliance_nm_nn * match.model_nn > 3.0 * curve_.noise_nm)
        last = (overlap_nm(p, match.approach, match.leap->z_nm) - *match.model_x_nm) / match.leap->sigma_nm;
    }
    return out.allFinite();
  }

 private:
  const PreparedCurve& curve_;
  const FitSetup& setup_;
  Layout at_;
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

/// Of Huber's loss in least squares. A leap's place is not to be an outlier: it is what holds the points on
/// their sides.
Vector weights_of(const Vector& r) {
  Vector weight = Vector::Ones(r.size());
  for (Eigen::Index i = 0; i + kLeaps < r.size(); ++i)
    if (std::abs(r[i]) > kHuber) weight[i] = kHuber / std::abs(r[i]);
  return weight;
}

/// A point that is left out costs what a fitted one does on average: leaving out must not pay.
double cost_of(const Vector& r, const std::vector<char>& used) {
  double cost = 0.5 * static_cast<double>(std::count(used.begin(), used.end(), 0));
  for (Eigen::Index i = 0; i + kLeaps < r.size(); ++i) {
    const double size = std::abs(r[i]);
    cost += size <= kHuber ? 0.5 * size * size : kHuber * (size - 0.5 * kHuber);
  }
  return cost + 0.5 * r.tail(kLeaps).squaredNorm();
}

struct Bounds {
  Vector low;
  Vector high;
};

struct Found {
  Vector p;
  double cost = 1e300;
  bool good = false;
};

class Search {
 public:
  Search(Problem& problem, Bounds bounds) : problem_(problem), bounds_(std::move(bounds)) {}

  bool evaluate(const Vector& p, double& cost) {
    problem_.mask(p, used_);
    if (!problem_.residuals(p, used_, residual_)) return false;
    cost = cost_of(residual_, used_);
    return true;
  }

  /// By differences, at fixed `used`.
  bool jacobian(const Vector& p, const std::vector<char>& used, const Vector& residual, Matrix& jacobian) {
    const Layout& at = problem_.at();
    jacobian.resize(problem_.rows(), at.count);
    Vector moved;
    // What does not change the path first: it is kept.
    for (int pass = 0; pass < 2; ++pass) {
      for (int i = 0; i < at.count; ++i) {
        const bool of_law = i < at.laws;
        if (of_law != (pass == 1)) continue;
        Vector q = p;
        const double step = of_law ? kLogStep : i >= at.offsets + 2 ? 1e-7 : 1e-5;
        q[i] += step;
        if (!problem_.residuals(q, used, moved)) return false;
        jacobian.col(i) = (moved - residual) / step;
      }
    }
    return true;
  }

  /// `fixed` (−1: none) stays as it is.
  Found descend(const Vector& start, int iterations, int fixed = -1) {
    Found found;
    found.p = start.cwiseMax(bounds_.low).cwiseMin(bounds_.high);
    problem_.keep_distance(found.p, fixed);
    if (!evaluate(found.p, found.cost)) return found;
    found.good = true;
    double damping = 1e-3;
    for (int i = 0; i < iterations; ++i) {
      double at_start = 0;
      if (!evaluate(found.p, at_start)) break;
      const std::vector<char> used = used_;
      const Vector residual = residual_;
      Matrix j;
      if (!jacobian(found.p, used, residual, j)) break;
      const Vector weight = weights_of(residual);
      if (fixed >= 0) j.col(fixed).setZero();
      Matrix normal = j.transpose() * weight.asDiagonal() * j;
      const Vector gradient = j.transpose() * weight.cwiseProduct(residual);
      if (fixed >= 0) normal(fixed, fixed) = 1.0;
      bool better = false;
      double gained = 0;
      for (int k = 0; k < 12 && !better; ++k) {
        Matrix damped = normal;
        damped.diagonal() += damping * normal.diagonal().cwiseMax(1e-12);
        Vector step = -damped.ldlt().solve(gradient);
        if (!step.allFinite()) break;
        for (int law = 0; law < problem_.at().laws; ++law) step[law] = std::clamp(step[law], -1.5, 1.5);
        Vector trial = (found.p + step).cwiseMax(bounds_.low).cwiseMin(bounds_.high);
        problem_.keep_distance(trial, fixed);
        double cost = 0;
        if (evaluate(trial, cost) && cost < found.cost) {
          gained = found.cost - cost;
          found.p = trial;
          found.cost = cost;
          damping = std::max(0.2 * damping, 1e-9);
          better = true;
        } else {
          damping *= 6.0;
        }
      }
      if (!better || gained < 1e-4) break;
    }
    return found;
  }

  bool at_end_of_others(const Vector& p) const { return problem_.at_end_of_others(p); }
  const std::vector<char>& used() const { return used_; }
  const Vector& residual() const { return residual_; }
  const Bounds& bounds() const { return bounds_; }

 private:
  Problem& problem_;
  Bounds bounds_;
  std::vector<char> used_;
  Vector residual_;
};

/// Where the profile of parameter `i` has risen by `rise`, from the best fit in direction `way`.
std::optional<double> profile_end(Search& search, const Found& best, int i, double way, double error,
                                  double rise) {
  const double limit = way > 0 ? search.bounds().high[i] : search.bounds().low[i];
  double inside = 0;
  double inside_rise = 0;
  double step = std::clamp(1.96 * error, 1e-7, 2.0);
  Vector p = best.p;
  for (int k = 0; k < 12; ++k) {
    double distance = inside + step;
    const bool at_limit = distance >= std::abs(limit - best.p[i]);
    if (at_limit) distance = std::abs(limit - best.p[i]);
    Vector q = p;
    q[i] = best.p[i] + way * distance;
    const Found found = search.descend(q, 12, i);
    if (search.at_end_of_others(found.p)) return std::nullopt;
    const double risen = found.good ? std::max(found.cost - best.cost, 0.0) : 1e9;
    if (risen >= rise) {
      // Between the two, the root of the rise is nearly a line.
      double low = inside;
      double low_root = std::sqrt(inside_rise);
      double high = distance;
      double high_root = std::sqrt(risen);
      const double aim = std::sqrt(rise);
      for (int h = 0; h < 6; ++h) {
        const double part = std::clamp((aim - low_root) / (high_root - low_root), 0.1, 0.9);
        const double middle = low + part * (high - low);
        q = p;
        q[i] = best.p[i] + way * middle;
        const Found again = search.descend(q, 12, i);
        const double root = again.good ? std::sqrt(std::max(again.cost - best.cost, 0.0)) : 1e4;
        if (std::abs(root - aim) < 0.01 * aim) return best.p[i] + way * middle;
        (root < aim ? low : high) = middle;
        (root < aim ? low_root : high_root) = root;
      }
      const double part = std::clamp((aim - low_root) / (high_root - low_root), 0.0, 1.0);
      return best.p[i] + way * (low + part * (high - low));
    }
    if (at_limit) return std::nullopt;
    p = found.p;
    inside = distance;
    inside_rise = risen;
    // What the rise so far promises, but at most thrice as far.
    const double promised = risen > 0 ? distance * std::sqrt(rise / risen) * 1.1 - distance : 2.0 * distance;
    step = std::clamp(promised, 0.1 * distance, 2.0 * distance);
    // Flat: the curve may have nothing to say, and the way to the limit is long.
    if (risen < 1e-3 * rise) step = std::max(step, 0.3);
  }
  return std::nullopt;
}

/// Those of `modes` that are inside of `rise` above the best, each at other laws than the ones before.
std::vector<Found> apart(std::vector<Found> modes, const Found& best, int laws, double rise) {
  std::sort(modes.begin(), modes.end(), [](const Found& a, const Found& b) { return a.cost < b.cost; });
  std::vector<Found> valleys;
  const auto same = [&](const Found& a, const Found& b) {
    return (a.p.head(laws) - b.p.head(laws)).cwiseAbs().maxCoeff() < 0.01;
  };
  for (const Found& mode : modes) {
    if (mode.cost - best.cost >= rise || same(mode, best)) continue;
    if (std::any_of(valleys.begin(), valleys.end(), [&](const Found& v) { return same(v, mode); })) continue;
    valleys.push_back(mode);
  }
  return valleys;
}

std::string number(double value, int digits = 3) {
  std::ostringstream text;
  text.precision(digits);
  text << value;
  return text.str();
}

/// Of the logarithms of `shown` the combination that the curve tells best, whatever the others are: the direction
/// of the most information after touch and baselines have taken theirs.
std::string best_known(const Matrix& normal, const std::vector<int>& shown,
                       const std::vector<Estimate>& names, double reduced) {
  const auto n = static_cast<Eigen::Index>(shown.size());
  std::vector<Eigen::Index> rest;
  for (Eigen::Index i = 0; i < normal.rows(); ++i)
    if (std::find(shown.begin(), shown.end(), static_cast<int>(i)) == shown.end()) rest.push_back(i);
  const auto m = static_cast<Eigen::Index>(rest.size());
  Matrix own(n, n);
  Matrix with(m, n);
  Matrix theirs(m, m);
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b < n; ++b)
      own(a, b) = normal(shown[static_cast<std::size_t>(a)], shown[static_cast<std::size_t>(b)]);
    for (Eigen::Index b = 0; b < m; ++b)
      with(b, a) = normal(rest[static_cast<std::size_t>(b)], shown[static_cast<std::size_t>(a)]);
  }
  for (Eigen::Index a = 0; a < m; ++a)
    for (Eigen::Index b = 0; b < m; ++b)
      theirs(a, b) = normal(rest[static_cast<std::size_t>(a)], rest[static_cast<std::size_t>(b)]);
  const Vector scale = theirs.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const Matrix scaled = scale.asDiagonal() * theirs * scale.asDiagonal();
  const Matrix left = scale.asDiagonal() * with;
  const Matrix information = own - left.transpose() * scaled.completeOrthogonalDecomposition().solve(left);
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(information);
  if (solver.info() != Eigen::Success || !(solver.eigenvalues()[n - 1] > 0)) return {};
  Vector direction = solver.eigenvectors().col(n - 1);
  Eigen::Index largest = 0;
  direction.cwiseAbs().maxCoeff(&largest);
  const double factor = direction[largest];
  direction /= factor;
  const double error = std::sqrt(std::max(reduced, 1.0) / solver.eigenvalues()[n - 1]) / std::abs(factor);
  std::string text;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (std::abs(direction[i]) < 0.02) continue;
    text += (text.empty() ? "" : " ") + names[static_cast<std::size_t>(i)].name;
    if (i != largest) text += "^" + number(direction[i], 2);
  }
  return text + " is known to +- " + number(196.0 * error, 2) + " %";
}

struct Start {
  double modulus_gpa;
  double work_n_m;
};

std::vector<Start> starts_of(const PreparedCurve& curve, const FitSetup& setup, bool adhesion) {
  const double stiffness = 1.0 / setup.compliance_nm_nn;
  double work = setup.law.work_of_adhesion_n_m;
  if (curve.retract.leap) work = stiffness * curve.retract.leap->height_nm / (1.75 * kPi * setup.radius_nm);
  work = std::clamp(work, 1e-6, 20.0);
  // Hertz at the deepest part: S = dF/dδ = (3/2) K^(2/3) (R F)^(1/3), and d(deflection)/d(−z) = S/(S + k).
  const double slope = std::clamp(curve.deepest_slope, 0.01, 0.99);
  const double contact = stiffness * slope / (1.0 - slope);
  const std::vector<double>& d = curve.approach.deflection_nm;
  const double push = std::max(stiffness * (d.back() - curve.offset_nm[0]), stiffness * curve.noise_nm) +
                      (adhesion ? 2.0 * kPi * work * setup.radius_nm : 0.0);
  const double modulus_k = power(contact / 1.5, 1.5) / std::sqrt(setup.radius_nm * push);
  const double left = 4.0 / 3.0 / modulus_k - setup.tip_compliance_per_gpa;
  const double poisson = 1.0 - setup.sample_poisson * setup.sample_poisson;
  const double modulus = left > 0 ? poisson / left : setup.sample_modulus_gpa;
  std::vector<Start> starts;
  for (const double factor : {1.0, 0.2, 5.0, 0.04}) starts.push_back({modulus * factor, work});
  starts.push_back({setup.sample_modulus_gpa, work});
  starts.push_back({modulus, 2.0 * work});
  for (Start& start : starts)
    start.modulus_gpa =
        std::clamp(start.modulus_gpa, setup.modulus_min_gpa * 1.01, setup.modulus_max_gpa * 0.99);
  return starts;
}

/// What a polynomial of degree 8 through the contact of each way leaves, with no physics in it: rms, 0 where there are
/// too few points. A smooth law that leaves less does not exist, whatever its parameters.
double smooth_floor_nm(const PreparedCurve& curve) {
  constexpr Eigen::Index kTerms = 9;
  double squares = 0;
  double freedom = 0;
  for (const PreparedSegment* segment : {&curve.approach, &curve.retract}) {
    const bool in = segment == &curve.approach;
    const std::size_t n = segment->z_nm.size();
    std::size_t begin = 0;
    std::size_t end = n;
    if (segment->leap) {
      (in ? begin : end) = in ? segment->leap->after : segment->leap->before + 1;
    } else {
      while (in && begin < n && segment->z_nm[begin] > curve.touch_z_nm) ++begin;
      while (!in && end > 0 && segment->z_nm[end - 1] > curve.touch_z_nm) --end;
    }
    if (end < begin + 40) continue;
    const auto [low, high] = std::minmax_element(segment->z_nm.begin() + static_cast<std::ptrdiff_t>(begin),
                                                 segment->z_nm.begin() + static_cast<std::ptrdiff_t>(end));
    const double middle = 0.5 * (*low + *high);
    const double half = std::max(0.5 * (*high - *low), 1e-9);
    const auto points = static_cast<Eigen::Index>(end - begin);
    Matrix design(points, kTerms);
    Vector measured(points);
    for (Eigen::Index i = 0; i < points; ++i) {
      const std::size_t at = begin + static_cast<std::size_t>(i);
      const double t = (segment->z_nm[at] - middle) / half;
      // Chebyshev's, by their recursion.
      design(i, 0) = 1;
      design(i, 1) = t;
      for (Eigen::Index k = 2; k < kTerms; ++k) design(i, k) = 2 * t * design(i, k - 1) - design(i, k - 2);
      measured[i] = segment->deflection_nm[at];
    }
    const Vector left = measured - design * design.colPivHouseholderQr().solve(measured);
    squares += left.squaredNorm();
    freedom += static_cast<double>(points - kTerms);
  }
  return freedom > 0 ? std::sqrt(squares / freedom) : 0;
}

void say_what_is_not_known(CurveFit& fit, const PreparedCurve& curve, const FitSetup& setup) {
  const auto say = [&](const std::string& text) { fit.notes.push_back(text); };
  say("k, K, w and the Hamaker constant scale together: no quasi-static curve tells the lever's stiffness; "
      "an error "
      "of it goes straight into all of them");
  if (setup.law.model == physics::ContactLaw::kHertz || setup.law.model == physics::ContactLaw::kDmt)
    say("Hertz's shape gives K times the root of R only: an error of R goes into E");
  for (const Estimate& e : fit.estimates) {
    if (!e.low || !e.high) {
      say(e.name + " is open " +
          (!e.low && !e.high ? "to both sides"
           : e.low           ? "upwards"
                             : "downwards") +
          ": the curve has no more to say about it");
    }
    if (e.name == "E" && (e.value < 1.01 * setup.modulus_min_gpa || e.value > 0.99 * setup.modulus_max_gpa)) {
      say("E lies at the end of what a scene takes (" + number(setup.modulus_min_gpa) + " to " +
          number(setup.modulus_max_gpa) + " GPa): is the tip's radius right?");
    }
    if (e.name == "E" && std::abs(e.sensitivity_invols) > 5) {
      say("E and the deflection's sensitivity are hardly told apart on so stiff a sample: 1 % of InvOLS "
          "moves E by " +
          number(std::abs(e.sensitivity_invols)) + " %");
    }
    if (e.name == "R" && fit.lambda > 0 && !(fit.lambda >= 0.1 && fit.lambda <= 5.0)) {
      say("R is told from K and w for lambda 0.1 to 5 only, here lambda = " + number(fit.lambda) +
          ": give R instead");
    }
  }
  if (setup.stiffness_error > 0) {
    say("the intervals hold the lever's stiffness to within " + number(100 * setup.stiffness_error) +
        " % (standard deviation)");
  }
  for (const Estimate& e : fit.estimates) {
    if (e.name != "H" || (e.low && e.high)) continue;
    say("H is told by the attraction before contact: where the tip snaps in, or noise hides it, it is not");
  }
  for (const Estimate& e : fit.estimates) {
    if ((e.name != "humidity" && e.name != "film") || (e.low && e.high)) continue;
    say(e.name + " is told by " +
        (e.name == "film" ? "where the bridge forms on the way in"
                          : "how far the bridge reaches on the way out") +
        ": a lever that leaps there hides it");
  }
  if (curve.deepest_slope > 1.02) {
    say("the deflection grows faster than the base goes down (slope " + number(curve.deepest_slope, 4) +
        "): the deflection's sensitivity is wrong");
  }
  if (setup.law.model != physics::ContactLaw::kHertz && !curve.retract.leap && !curve.approach.leap)
    say("no leap in either way: w rests on the shape of the contact alone");
  if (fit.rms_nm > 1.2 * fit.noise_nm) {
    say("residuals are " + number(fit.rms_nm / fit.noise_nm) +
        " times the free part's noise: model or calibration miss something that the intervals do not hold");
    const double floor_nm = smooth_floor_nm(curve);
    if (floor_nm > 1.5 * fit.noise_nm) {
      say("in contact a polynomial of degree 8 through each way leaves " + number(floor_nm / fit.noise_nm) +
          " times that noise: no smooth law does better, the measurement itself is not as quiet there");
    }
  }
  if (std::abs(fit.left_correlation) > 0.2)
    say("residuals go on after the noise's own correlation is taken out (" + number(fit.left_correlation, 2) +
        ")");
}

CurveFit fit_with_its_leaps(const PreparedCurve& curve, const FitSetup& setup, double& cost) {
  CurveFit fit;
  fit.error = curve.error;
  if (!fit.error.empty()) return fit;
  Problem problem(curve, setup);
  const Layout& at = problem.at();
  Bounds bounds{Vector::Constant(at.count, -1e12), Vector::Constant(at.count, 1e12)};
  const auto bound = [&](int i, double low, double high) {
    if (i < 0) return;
    bounds.low[i] = det_log(low);
    bounds.high[i] = det_log(high);
  };
  bound(at.modulus, setup.modulus_min_gpa, setup.modulus_max_gpa);
  bound(at.work, 1e-6, 20.0);
  bound(at.radius, kLeastRadius_nm, kGreatestRadius_nm);
  bound(at.distance, kLeastDistance_nm, kGreatestDistance_nm);
  bound(at.hamaker, 1e-7, 1e4);
  bound(at.humidity, kLeastHumidity, kGreatestHumidity);
  bound(at.film, kLeastFilm_nm, kGreatestFilm_nm);
  Search search(problem, bounds);

  Found best;
  std::vector<double> ends;
  for (const Start& start : starts_of(curve, setup, at.work >= 0)) {
    Vector p = Vector::Zero(at.count);
    p[at.modulus] = det_log(start.modulus_gpa);
    if (at.work >= 0) p[at.work] = det_log(start.work_n_m);
    if (at.radius >= 0) p[at.radius] = det_log(setup.radius_nm);
    if (at.distance >= 0) p[at.distance] = det_log(setup.law.equilibrium_distance_nm);
    if (at.hamaker >= 0) {
      const double z0 = setup.law.equilibrium_distance_nm;
      p[at.hamaker] = det_log(setup.hamaker_aj.value_or(12.0 * kPi * z0 * z0 * start.work_n_m));
    }
    const physics::CapillaryParameters& water = setup.law.long_range.capillary;
    if (at.humidity >= 0) p[at.humidity] = det_log(std::max(water.humidity_percent, kLeastHumidity));
    if (at.film >= 0) p[at.film] = det_log(std::max(water.film_nm, kLeastFilm_nm));
    p[at.touch] = curve.touch_z_nm;
    p[at.offsets] = curve.offset_nm[0];
    p[at.offsets + 1] = curve.offset_nm[1];
    p[at.offsets + 2] = curve.tilt[0];
    p[at.offsets + 3] = curve.tilt[1];
    const Found found = search.descend(p, 40);
    ++fit.starts;
    if (!found.good) continue;
    ends.push_back(found.cost);
    if (found.cost < best.cost) best = found;
  }
  if (!best.good) {
    fit.error =
        "finds no balance of tip and lever for any start: do radius, stiffness and law of the scene fit it?";
    return fit;
  }
  // Both move steps of the curve, to which no slope leads from afar. Where the lever leaps over what tells them,
  // several valleys are as good as the best: an interval holds all of them.
  std::vector<Found> modes;
  if (at.humidity >= 0 || at.film >= 0) {
    const Vector from = best.p;
    for (const double humidity : {0.0, 25.0, 45.0, 65.0, 85.0}) {
      if (humidity > 0 && at.humidity < 0) continue;
      for (const double film_nm : {0.0, 0.05, 0.2, 0.5, 1.0, 2.0, 4.0}) {
        if (film_nm > 0 && at.film < 0) continue;
        Vector p = from;
        if (humidity > 0) p[at.humidity] = det_log(humidity);
        if (film_nm > 0) p[at.film] = det_log(film_nm);
        Found found = search.descend(p, 5);
        ++fit.starts;
        if (!found.good || found.cost > 40.0 * best.cost) continue;
        found = search.descend(found.p, 40);
        modes.push_back(found);
        if (found.cost < best.cost) best = found;
      }
    }
  }
  best = search.descend(best.p, 40);
  // Each point that passes a leap makes a small step of the cost, before which a descent may stop.
  const bool steps = at.humidity >= 0 || at.film >= 0;
  for (int i = 0; steps && i < at.laws; ++i) {
    for (const double way : {-0.01, 0.01}) {
      Vector p = best.p;
      p[i] += way;
      const Found found = search.descend(p, 40);
      if (found.good && found.cost < best.cost) best = found;
    }
  }
  for (const double end : ends) fit.starts_agree += end <= 1.01 * best.cost + 0.1 ? 1 : 0;

  search.evaluate(best.p, cost);
  const std::vector<char> used = search.used();
  const Vector residual = search.residual();
  Matrix j;
  search.jacobian(best.p, used, residual, j);
  double sum = 0;
  double count = 0;
  double lagged = 0;
  double squares = 0;
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const double e = std::clamp(residual[i], -kHuber, kHuber);
    sum += e * e;
    count += used[static_cast<std::size_t>(i)] != 0 ? 1 : 0;
    squares += e * e;
    if (i > 0) lagged += e * std::clamp(residual[i - 1], -kHuber, kHuber);
  }
  fit.reduced = sum / std::max(count - at.count, 1.0);
  fit.left_correlation = squares > 0 ? lagged / squares : 0;
  const Vector weight = weights_of(residual);
  const Matrix normal = j.transpose() * weight.asDiagonal() * j;
  // By columns of equal size: nm, logarithms and a tilt stand side by side.
  const Vector scale = normal.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const Matrix scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Matrix inverse = scaled.completeOrthogonalDecomposition().pseudoInverse();
  const Matrix covariance = scale.asDiagonal() * inverse * scale.asDiagonal();

  // What an error of a calibration does: the fit moves by −(JᵀWJ)⁻¹ JᵀW ∂r.
  const auto moved = [&](const Vector& change) -> Vector {
    return -covariance * (j.transpose() * weight.cwiseProduct(change));
  };
  const auto by_setup = [&](const FitSetup& other) -> Vector {
    Problem again(curve, other);
    Vector r;
    if (!again.residuals(best.p, used, r)) return Vector::Zero(at.count);
    return moved((r - residual) / kLogStep);
  };
  FitSetup stiffer = setup;
  stiffer.compliance_nm_nn /= 1.0 + kLogStep;
  FitSetup wider = setup;
  wider.radius_nm *= 1.0 + kLogStep;
  const Vector by_stiffness = by_setup(stiffer);
  const Vector by_radius = by_setup(wider);
  std::vector<double> bent[2] = {curve.approach.deflection_nm, curve.retract.deflection_nm};
  for (std::size_t segment = 0; segment < 2; ++segment)
    for (double& d : bent[segment]) d -= curve.offset_nm[segment];
  Vector larger;
  problem.whiten(bent[0], bent[1], used, larger);
  const Vector by_invols = moved(larger);

  const double rise = 0.5 * kQuantile * std::max(fit.reduced, 1.0);
  const std::vector<Found> valleys = apart(modes, best, at.laws, rise);
  const auto estimate = [&](int i, const char* name, const char* unit, double to_unit) {
    if (i < 0) return;
    Estimate e;
    e.name = name;
    e.unit = unit;
    e.value = to_unit * det_exp(best.p[i]);
    const double error = std::sqrt(std::max(covariance(i, i), 0.0) * std::max(fit.reduced, 1.0));
    std::optional<double> low = profile_end(search, best, i, -1.0, error, rise);
    std::optional<double> high = profile_end(search, best, i, 1.0, error, rise);
    // So may a profile: to the one side it ends no nearer than to the other, if the curvature says so, too.
    if (steps && low && high) {
      const double wide = std::min(1.96 * error, std::max(best.p[i] - *low, *high - best.p[i]));
      low = std::min(*low, best.p[i] - wide);
      high = std::max(*high, best.p[i] + wide);
    }
    for (const Found& valley : valleys) {
      const double left = rise - (valley.cost - best.cost);
      if (low && valley.p[i] < *low) low = profile_end(search, valley, i, -1.0, error, left);
      if (high && valley.p[i] > *high) high = profile_end(search, valley, i, 1.0, error, left);
    }
    if (low) e.low = to_unit * det_exp(*low);
    if (high) e.high = to_unit * det_exp(*high);
    e.sensitivity_stiffness = by_stiffness[i];
    e.sensitivity_invols = by_invols[i];
    e.sensitivity_radius = at.radius < 0 ? by_radius[i] : 0.0;
    // The lever's own error is independent of the curve's noise: their squares add.
    const double of_lever = 1.96 * std::abs(e.sensitivity_stiffness) * setup.stiffness_error;
    const auto widened = [&](std::optional<double>& end) {
      if (!end || !(of_lever > 0)) return;
      const double way = *end < e.value ? -1.0 : 1.0;
      end = e.value * det_exp(way * std::hypot(det_log(*end / e.value), of_lever));
    };
    widened(e.low);
    widened(e.high);
    fit.estimates.push_back(e);
  };
  estimate(at.modulus, "E", "GPa", 1.0);
  estimate(at.work, "w", "mJ/m2", 1e3);
  estimate(at.radius, "R", "nm", 1.0);
  estimate(at.distance, "z0", "nm", 1.0);
  estimate(at.hamaker, "H", "aJ", 1.0);
  estimate(at.humidity, "humidity", "%", 1.0);
  estimate(at.film, "film", "nm", 1.0);
  std::vector<int> shown{at.modulus};
  for (const int i : {at.work, at.radius, at.distance, at.hamaker, at.humidity, at.film})
    if (i >= 0) shown.push_back(i);
  for (const int a : shown) {
    std::vector<double> row;
    for (const int b : shown) {
      const double product = std::sqrt(covariance(a, a) * covariance(b, b));
      row.push_back(product > 0 ? covariance(a, b) / product : 0.0);
    }
    fit.correlation.push_back(row);
  }

  bool mixed = false;
  for (const Estimate& e : fit.estimates) mixed = mixed || !e.low || !e.high;
  for (std::size_t a = 0; a < shown.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) mixed = mixed || std::abs(fit.correlation[a][b]) > 0.9;
  if (mixed && shown.size() > 1) {
    const std::string known = best_known(normal, shown, fit.estimates, fit.reduced);
    if (!known.empty()) fit.notes.push_back("not each by itself: the combination " + known);
  }

  const physics::TipSampleParameters law = problem.law(best.p);
  fit.modulus_gpa = det_exp(best.p[at.modulus]);
  fit.radius_nm = problem.radius_nm(best.p);
  fit.contact_modulus_gpa = law.contact_modulus_gpa;
  fit.distance_nm = law.equilibrium_distance_nm;
  fit.humidity_percent = law.long_range.capillary.humidity_percent;
  fit.film_nm = law.long_range.capillary.film_nm;
  if (at.work >= 0) {
    fit.work_n_m = law.work_of_adhesion_n_m;
    fit.lambda = physics::TipSampleLaw(law).lambda(fit.radius_nm);
    // nm²·N/m = 1e-18 J = aJ
    if (law.van_der_waals) fit.hamaker_aj = 12.0 * kPi * fit.distance_nm * fit.distance_nm * fit.work_n_m;
  }
  fit.touch_z_nm = best.p[at.touch];
  fit.shift_nm = at.shift < 0 ? 0.0 : best.p[at.shift];
  fit.noise_nm = curve.noise_nm;
  double misfit = 0;
  double points = 0;
  std::size_t row = 0;
  for (const bool approach : {true, false}) {
    FitSegment& segment = approach ? fit.approach : fit.retract;
    const std::vector<double>& d = (approach ? curve.approach : curve.retract).deflection_nm;
    problem.model_nm(best.p, approach, segment.model_nm);
    for (std::size_t i = 0; i < d.size(); ++i, ++row) {
      segment.residual_nm.push_back(d[i] - segment.model_nm[i]);
      segment.used.push_back(used[row]);
      if (used[row] == 0) continue;
      misfit += segment.residual_nm.back() * segment.residual_nm.back();
      points += 1;
    }
  }
  fit.rms_nm = std::sqrt(misfit / std::max(points, 1.0));
  fit.evaluations = problem.evaluations();
  say_what_is_not_known(fit, curve, setup);
  return fit;
}

}  // namespace

CurveFit fit_curve(const PreparedCurve& curve, const FitSetup& setup) {
  double cost = 1e300;
  CurveFit fit = fit_with_its_leaps(curve, setup, cost);
  if (!curve.approach.step) return fit;
  // What looked like the bridge's step may be a bend of the curve.
  PreparedCurve smooth = curve;
  smooth.approach.step.reset();
  double without = 1e300;
  CurveFit other = fit_with_its_leaps(smooth, setup, without);
  return other.error.empty() && without < cost ? other : fit;
}

}  // namespace telenano::fit

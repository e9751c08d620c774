#include "telenano/nve_server/fit/fit_problem.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/long_range/van_der_waals.h"

namespace telenano::fit {
namespace {

constexpr double kLostLeap = 30.0;  // standard deviations: a leap that the model does not have
constexpr double kPathShare = 0.1;  // of the noise: where the path is made closer
constexpr int kOffsets = 4;         // approach, retract, their tilts

ParameterLayout layout_of(const FitSetup& setup) {
  ParameterLayout layout;
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

}  // namespace

FitProblem::FitProblem(const PreparedCurve& curve, const FitSetup& setup)
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

double FitProblem::contact_modulus_gpa(const Vector& p) const {
  const double sample = (1.0 - setup_.sample_poisson * setup_.sample_poisson) / det_exp(p[at_.modulus]);
  return 4.0 / 3.0 / (sample + setup_.tip_compliance_per_gpa);
}

double FitProblem::radius_nm(const Vector& p) const {
  return at_.radius < 0 ? setup_.radius_nm : det_exp(p[at_.radius]);
}

physics::TipSampleParameters FitProblem::law(const Vector& p) const {
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

void FitProblem::keep_distance(Vector& p, int fixed) const {
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

bool FitProblem::at_end_of_others(const Vector& p) const {
  if (at_.radius >= 0 && (p[at_.radius] < det_log(1.001 * kLeastRadius_nm) ||
                          p[at_.radius] > det_log(0.999 * kGreatestRadius_nm)))
    return true;
  if (at_.hamaker < 0) return false;
  const double distance = law(p).equilibrium_distance_nm;
  return distance < 1.001 * kLeastDistance_nm || distance > 0.999 * kGreatestDistance_nm;
}

const CurvePath& FitProblem::path(const Vector& p) {
  const Vector laws = p.head(at_.laws);
  if (path_of_.size() != laws.size() || path_of_ != laws) {
    path_ = trace_path(physics::TipSampleLaw(law(p)), radius_nm(p), setup_.compliance_nm_nn, from_nm_, to_nm_,
                       tolerance_nn_);
    path_of_ = laws;
    ++evaluations_;
  }
  return path_;
}

double FitProblem::overlap_nm(const Vector& p, bool approach, double z_nm) const {
  const double shift = approach || at_.shift < 0 ? 0.0 : p[at_.shift];
  return p[at_.touch] + shift - z_nm;
}

double FitProblem::baseline_nm(const Vector& p, bool approach, double z_nm) const {
  return p[at_.offsets + (approach ? 0 : 1)] +
         p[at_.offsets + (approach ? 2 : 3)] * (z_nm - curve_.z_middle_nm);
}

std::array<FitProblem::Match, kLeaps> FitProblem::matches(const CurvePath& way) const {
  const PathSegment& in = way.approach;
  const PathSegment& out = way.retract;
  const bool two = curve_.approach.step.has_value();
  return {Match{true, curve_.approach.leap, two ? in.dry_leap_x_nm : in.leap_x_nm,
                two ? in.dry_leap_nn : in.leap_nn},
          Match{true, curve_.approach.step, in.bridge_x_nm, in.bridge_nn},
          Match{false, curve_.retract.leap, out.leap_x_nm, out.leap_nn}};
}

void FitProblem::mask(const Vector& p, std::vector<char>& used) {
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

void FitProblem::model_nm(const Vector& p, bool approach, std::vector<double>& out) {
  const PathSegment& segment = approach ? path(p).approach : path(p).retract;
  const std::vector<double>& z = (approach ? curve_.approach : curve_.retract).z_nm;
  out.resize(z.size());
  for (std::size_t i = 0; i < z.size(); ++i) {
    out[i] = setup_.compliance_nm_nn * segment.force_nn(overlap_nm(p, approach, z[i])) +
             baseline_nm(p, approach, z[i]);
  }
}

void FitProblem::whiten(const std::vector<double>& approach, const std::vector<double>& retract,
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

bool FitProblem::residuals(const Vector& p, const std::vector<char>& used, Vector& out) {
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

}  // namespace telenano::fit

#include "tests/studies/elastic/ground_truth.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>
#include <utility>

#include "telenano/nve_server/physics/potential/retraction.h"

namespace telenano::elastic {

double retraction_force_nn(const physics::BranchPotential& law, const physics::ContactJet& jet) noexcept {
  physics::PotentialJet potential;
  physics::retraction(law, jet.overlap_nm, jet.log_radius, potential);
  return -(potential.force_nn * jet.overlap_grad.z() +
           potential.by_radius_aj * jet.log_radius_grad_per_nm.z());
}

ForceOf vertical_force(const physics::BranchPotential& law, ContactOf contact) {
  return [&law, contact = std::move(contact)](double z) {
    struct Seen {
      double overlap_nm, log_radius;
    };
    const auto seen = [&](double at) {
      physics::ContactJet jet;
      double cosine = 1;
      contact(at, jet, cosine);
      return Seen{jet.overlap_nm / cosine, jet.log_radius + 2 * std::log(cosine)};
    };
    // δ/c and ρ + 2 ln c are C² in z: central differences of 1e-4 nm leave 1e-8 of their slopes.
    constexpr double kStep = 1e-4;
    const Seen here = seen(z), above = seen(z + kStep), below = seen(z - kStep);
    physics::ContactJet jet;
    jet.overlap_nm = here.overlap_nm;
    jet.log_radius = here.log_radius;
    jet.overlap_grad = Vec3(0, 0, (above.overlap_nm - below.overlap_nm) / (2 * kStep));
    jet.log_radius_grad_per_nm = Vec3(0, 0, (above.log_radius - below.log_radius) / (2 * kStep));
    return retraction_force_nn(law, jet);
  };
}

ContactOf contact_of(const physics::ScanFields& fields, double x_nm, double y_nm, double touch_nm) {
  return [&fields, x_nm, y_nm, touch_nm](double z, physics::ContactJet& jet, double& cosine) {
    const Vec3 apex(x_nm, y_nm, touch_nm + z);
    fields.contact_at(apex, jet);
    double unmarked_log_radius = 0;
    fields.ground_at(apex, cosine, unmarked_log_radius);
  };
}

double lateral_force_nn(const physics::BranchPotential& law, const physics::ContactJet& jet) noexcept {
  physics::PotentialJet potential;
  physics::CurveHint hint;
  physics::ContactSize size;
  if (!law.inside(jet.overlap_nm, jet.log_radius, hint, potential, size)) return NAN;
  return -(potential.force_nn * jet.overlap_grad.x() +
           potential.by_radius_aj * jet.log_radius_grad_per_nm.x());
}

ForceOf flat_force(const physics::BranchPotential& law, double radius_nm) {
  return [&law, radius_nm](double z) {
    physics::ContactJet jet;
    jet.overlap_nm = -z;
    jet.overlap_grad = Vec3(0, 0, -1);
    jet.log_radius = std::log(radius_nm);
    return retraction_force_nn(law, jet);
  };
}

double same_flat_force_nm(const Place& flat, const ForceOf& on_flat, double above_touch_nm) {
  std::size_t k = 1;
  while (k + 1 < flat.states.size() && flat.states[k].z_nm < above_touch_nm) ++k;
  const State &low = flat.states[k - 1], &high = flat.states[k];
  const double force =
      low.force_nn + (high.force_nn - low.force_nn) * (above_touch_nm - low.z_nm) / (high.z_nm - low.z_nm);
  double deep = above_touch_nm - 1.0, shallow = above_touch_nm + 1.0;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (deep + shallow);
    (on_flat(middle) > force ? deep : shallow) = middle;
  }
  return 0.5 * (deep + shallow);
}

double pull_off_nn(const ForceOf& force, double to_nm) {
  double most = 0;
  const int last = static_cast<int>(std::lround(to_nm / 0.002));
  for (int k = -100; k < last; ++k) most = std::max(most, -force(0.002 * k));
  return most;
}

double PlaceError::pull_off_error() const noexcept {
  return std::abs(pull_off_ratio / reference_ratio - 1);
}

PlaceError place_error(const physics::BranchPotential& law, const Place& flat, const ForceOf& on_flat,
                       const Place& place, const ContactOf& contact) {
  const ForceOf force = vertical_force(law, contact);
  PlaceError result;
  physics::ContactJet jet;
  contact(-0.4, jet, result.cosine);
  result.pull_off_ratio = pull_off_nn(force) / pull_off_nn(on_flat);
  result.reference_ratio = place.pull_off_nn() / flat.pull_off_nn();
  for (std::size_t k = 0; k < place.states.size() && k < flat.states.size(); ++k) {
    const State& state = place.states[k];
    if (state.z_nm > -0.2) continue;
    const double lennard_jones_nn = flat.states[k].force_nn - on_flat(flat.states[k].z_nm);
    const double off = force(state.z_nm) + lennard_jones_nn - state.force_nn;
    result.pressed_error_nn2 += off * off;
    result.pressed_square_nn2 += state.force_nn * state.force_nn;
  }
  return result;
}

bool is_steep(const PlaceError& place) noexcept {
  return place.cosine < 0.8660254037844386;
}

std::vector<PlaceError> without_steep(const std::vector<PlaceError>& places) {
  std::vector<PlaceError> gentle;
  std::copy_if(places.begin(), places.end(), std::back_inserter(gentle),
               [](const PlaceError& p) { return !is_steep(p); });
  return gentle;
}

double pressed_error(const std::vector<PlaceError>& places) {
  double error = 0, square = 0;
  for (const PlaceError& place : places) {
    error += place.pressed_error_nn2;
    square += place.pressed_square_nn2;
  }
  return std::sqrt(error / square);
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const auto k = static_cast<std::size_t>(at);
  return k + 1 < values.size() ? values[k] + (at - static_cast<double>(k)) * (values[k + 1] - values[k])
                               : values[k];
}

Interval bootstrap(const std::vector<double>& values, double q, int resamples) {
  std::mt19937_64 draw(1);
  std::vector<double> quantiles, sample(values.size());
  for (int i = 0; i < resamples; ++i) {
    for (double& value : sample) value = values[draw() % values.size()];
    quantiles.push_back(quantile(sample, q));
  }
  return {quantile(quantiles, 0.025), quantile(quantiles, 0.975)};
}

surface::HeightGrid piece_round(const surface::HeightGrid& scan, int column, int row) {
  const int first_column = std::clamp(column - 32, 0, scan.columns - 64);
  const int first_row = std::clamp(row - 32, 0, scan.rows - 64);
  surface::HeightGrid piece{64,
                            64,
                            scan.dx_nm,
                            scan.dy_nm,
                            scan.x_first_nm + first_column * scan.dx_nm,
                            scan.y_first_nm + first_row * scan.dy_nm,
                            {}};
  for (int j = 0; j < 64; ++j) {
    for (int i = 0; i < 64; ++i) {
      piece.z_nm.push_back(
          scan.z_nm[static_cast<std::size_t>((first_row + j) * scan.columns + first_column + i)]);
    }
  }
  return piece;
}

}  // namespace telenano::elastic

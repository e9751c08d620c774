#include "tests/support/md_oracle.h"

#include <algorithm>
#include <array>
#include <boost/math/constants/constants.hpp>
#include <boost/math/quadrature/gauss.hpp>
#include <boost/multiprecision/cpp_dec_float.hpp>
#include <utility>

namespace telenano::oracle {
namespace {

using Real = boost::multiprecision::cpp_dec_float_50;
const Real kPi = boost::math::constants::pi<Real>();

double to_double(const Real& x) {
  return x.convert_to<double>();
}

}  // namespace

struct MaugisDugdale::Impl {
  struct Contact {
    Real a, load, overlap;
  };

  explicit Impl(double l) : lambda(l) {
    h0 = 2 / (kPi * lambda);
    q = 8 * lambda / (3 * kPi);
    // (pi/4) lambda C0^2 + (4/3)(pi/2 - 1) lambda^2 C0 = 1
    const Real alpha = kPi * lambda / 4;
    const Real beta = Real(4) / 3 * (kPi / 2 - 1) * lambda * lambda;
    c0 = (sqrt(beta * beta + 4 * alpha) - beta) / (2 * alpha);
    onset = c0 * c0 / 2 - q * c0 - h0;
    in_contact = c0 < q;
    if (in_contact) {
      t_fold = stationary(true);
      fold = contact(t_fold).overlap;
    } else {
      fold = -q * q / 2 - h0;
    }
  }

  /// Maugis' equations at m = 1 + t.
  Contact contact(const Real& t) const {
    const Real m = 1 + t;
    const Real root = sqrt(t * (2 + t));  // sqrt(m^2 - 1)
    const Real arc = atan(root);
    const Real alpha = lambda / 2 * (root + (m * m - 2) * arc);
    const Real beta = Real(4) / 3 * lambda * lambda * (root * arc - t);
    const Real a = 2 / (beta + sqrt(beta * beta + 4 * alpha));
    return {a, a * a * a - lambda * a * a * (root + m * m * arc), a * a - Real(4) / 3 * lambda * a * root};
  }

  /// d/d ln t by central difference: step 1e-12, error about 1e-24 of the value.
  std::pair<Real, Real> rates(const Real& t) const {
    const Real h("1e-12");
    const Contact up = contact(t * (1 + h));
    const Contact down = contact(t * (1 - h));
    return {(up.overlap - down.overlap) / (2 * h), (up.load - down.load) / (2 * h)};
  }

  /// Geometric bisection of a sign change between t = 1e-14 (deep contact) and 1e14 (onset).
  template <class Low>
  static Real bisect(Low&& is_low, int steps = 100) {
    Real lo("1e-14"), hi("1e14");
    for (int i = 0; i < steps; ++i) {
      const Real mid = sqrt(lo * hi);
      (is_low(mid) ? lo : hi) = mid;
    }
    return sqrt(lo * hi);
  }

  Real stationary(bool of_overlap) const {
    // From deep contact (small t) both fall with t until they turn.
    return bisect([&](const Real& t) {
      const auto [d_overlap, d_load] = rates(t);
      return (of_overlap ? d_overlap : d_load) < 0;
    });
  }

  Real t_at(const Real& overlap) const {
    return bisect([&](const Real& t) { return (!in_contact || t < t_fold) && contact(t).overlap > overlap; });
  }

  Real noncontact_energy(const Real& c) const {
    return -kPi / 2 * lambda * (c * c * c * c / 4 - q * c * c * c / 3);
  }

  /// Integral of P dDelta over the contact branch from the onset to t. In k = 1/m, where both are analytic at
  /// the onset, down to m = 2; in ln t from there.
  Real contact_energy(const Real& t) const {
    Real sum = 0;
    const Real k_end = std::min(Real(1 / (1 + t)), Real(0.5));
    const Real step("1e-12");
    const auto in_k = [&](const Real& k) {
      const Real h = step * std::max(k, Real("1e-3"));
      const Real up = contact(1 / (k + h) - 1).overlap;
      const Real down = contact(1 / (k - h) - 1).overlap;
      return Real(contact(1 / k - 1).load * (up - down) / (2 * h));
    };
    constexpr int kPanels = 4;
    for (int i = 0; i < kPanels; ++i) {
      sum += boost::math::quadrature::gauss<Real, 15>::integrate(in_k, Real(k_end * i / kPanels),
                                                                 Real(k_end * (i + 1) / kPanels));
    }
    if (t >= 1) return sum;
    const auto in_log = [&](const Real& x) {
      const Real at = exp(x);
      return Real(contact(at).load * rates(at).first);
    };
    const Real end = log(t);
    const int panels = 1 + static_cast<int>(-to_double(end));
    for (int i = 0; i < panels; ++i) {
      sum += boost::math::quadrature::gauss<Real, 15>::integrate(in_log, Real(end * i / panels),
                                                                 Real(end * (i + 1) / panels));
    }
    return sum;
  }

  Real energy(const Real& overlap) const {
    if (!in_contact && overlap < onset) return noncontact_energy(q + sqrt(q * q + 2 * (overlap + h0)));
    return noncontact_energy(c0) + contact_energy(t_at(overlap));
  }

  Real lambda, h0, q, c0, onset, fold, t_fold;
  bool in_contact = false;
};

MaugisDugdale::MaugisDugdale(double lambda) : impl_(std::make_unique<Impl>(lambda)) {}
MaugisDugdale::~MaugisDugdale() = default;

double MaugisDugdale::range() const {
  return to_double(impl_->h0);
}
double MaugisDugdale::onset_overlap() const {
  return to_double(impl_->onset);
}
double MaugisDugdale::fold_overlap() const {
  return to_double(impl_->fold);
}
bool MaugisDugdale::fold_in_contact() const {
  return impl_->in_contact;
}

double MaugisDugdale::above_fold(double relative) const {
  return to_double(impl_->fold + relative * std::max(Real(1), Real(abs(impl_->fold))));
}

MaugisDugdale::State MaugisDugdale::at_overlap(double overlap) const {
  const Impl& i = *impl_;
  State s;
  if (overlap < i.fold) return s;
  s.stable = true;
  if (!i.in_contact && overlap < i.onset) {
    const Real c = i.q + sqrt(i.q * i.q + 2 * (overlap + i.h0));
    s.load = to_double(-kPi / 2 * i.lambda * c * c);
    s.slope = to_double(-kPi * i.lambda * c / (c - i.q));
    return s;
  }
  const Real t = i.t_at(overlap);
  const Impl::Contact c = i.contact(t);
  const auto [d_overlap, d_load] = i.rates(t);
  s.contact = true;
  s.contact_radius = to_double(c.a);
  s.load = to_double(c.load);
  s.slope = to_double(d_load / d_overlap);
  return s;
}

double MaugisDugdale::pull_off_load() const {
  return to_double(impl_->contact(impl_->stationary(false)).load);
}

double MaugisDugdale::zero_load_radius() const {
  return to_double(impl_->contact(Impl::bisect([&](const Real& t) { return impl_->contact(t).load > 0; })).a);
}

double MaugisDugdale::zero_load_overlap() const {
  return to_double(
      impl_->contact(Impl::bisect([&](const Real& t) { return impl_->contact(t).load > 0; })).overlap);
}

double MaugisDugdale::energy(double overlap) const {
  return to_double(impl_->energy(overlap));
}

double MaugisDugdale::loop_energy() const {
  const Impl& i = *impl_;
  const Real at_fold =
      i.in_contact ? Real(i.noncontact_energy(i.c0) + i.contact_energy(i.t_fold)) : i.noncontact_energy(i.q);
  return to_double(at_fold - i.energy(-i.h0));
}

}  // namespace telenano::oracle

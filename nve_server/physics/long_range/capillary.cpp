#include "telenano/nve_server/physics/long_range/capillary.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "telenano/common/base/constants.h"
#include "telenano/common/base/det_math.h"
#include "telenano/nve_server/physics/numerics/require.h"

namespace telenano::physics {
namespace {

// Molar volume of water over R_gas T at 20 °C: 18.05e-6/(8.31446 * 293.15) m^3/J, in nm per N/m.
constexpr double kKelvinPerTension = 18.05e-6 / (8.31446261815324 * 293.15) * 1e9;
constexpr double kRadiansPerDegree = kPi / 180.0;
constexpr double kDugdaleRangeOverA0 = 0.97427857925749347766;  // 9 sqrt(3)/16

}  // namespace

double Capillary::adhesion_n_m(const CapillaryParameters& p) noexcept {
  if (!(p.humidity_percent > 0 || p.volume_nm3 > 0)) return 0;
  return p.surface_tension_n_m * (det_sin_cos(kRadiansPerDegree * p.contact_angle_tip_deg).cos +
                                  det_sin_cos(kRadiansPerDegree * p.contact_angle_sample_deg).cos);
}

Capillary::Capillary(const CapillaryParameters& p, const DisplacedAttraction& displaced)
    : displaced_(displaced) {
  require(p.humidity_percent >= 0 && p.humidity_percent < 100,
          "capillary bridge: humidity must be 0 (none) to below 100 %", p.humidity_percent);
  require(std::isfinite(p.volume_nm3) && p.volume_nm3 >= 0,
          "capillary bridge: volume must be finite and positive, or 0 for that of the humidity (nm^3)",
          p.volume_nm3);
  require(p.volume_nm3 == 0 || p.model == CapillaryModel::kConstantVolume,
          "capillary bridge: a volume goes with the constant-volume model only", p.volume_nm3);
  active_ = p.humidity_percent > 0 || p.volume_nm3 > 0;
  for (const double angle : {p.contact_angle_tip_deg, p.contact_angle_sample_deg})
    require(angle >= 0 && angle <= 180, "capillary bridge: contact angles must be 0 to 180 degrees", angle);
  require(std::isfinite(p.surface_tension_n_m) && p.surface_tension_n_m > 0,
          "capillary bridge: surface tension must be finite and positive (N/m)", p.surface_tension_n_m);
  require(std::isfinite(p.film_nm) && p.film_nm >= 0, "capillary bridge: film must be finite, 0 or more (nm)",
          p.film_nm);
  if (!active_) return;

  const double tip = kRadiansPerDegree * p.contact_angle_tip_deg;
  const double sample = kRadiansPerDegree * p.contact_angle_sample_deg;
  const double cosine = 0.5 * (det_sin_cos(tip).cos + det_sin_cos(sample).cos);
  require(cosine > 0,
          "capillary bridge: no bridge forms unless the mean cosine of the contact angles is positive",
          cosine);
  constant_volume_ = p.model == CapillaryModel::kConstantVolume;
  force_per_radius_ = 4.0 * kPi * p.surface_tension_n_m * cosine;
  if (p.humidity_percent > 0) {
    kelvin_nm_ = kKelvinPerTension * p.surface_tension_n_m / -det_log(0.01 * p.humidity_percent);
  }
  reach_nm_ = 2.0 * kelvin_nm_ * cosine;
  stretch_ = 1.0 + 0.25 * (tip + sample);
  volume_nm3_ = p.volume_nm3;
  film_nm_ = p.film_nm;
  // Of the displaced attraction: that of a linear one with the same force at touch and the same energy.
  const double range = (displaced.van_der_waals ? 2.0 : kDugdaleRangeOverA0) * displaced.cut_off_nm *
                       (displaced.work_n_m / adhesion_n_m(p));
  if (!(volume_nm3_ > 0) && reach_nm_ <= range) {
    active_ = false;
    return;
  }
  if (constant_volume_ || displaced.work_n_m == 0) return;
  // At touch it frees energy, and beyond some gap it does not: where.
  film_nm_ = std::min(film_nm_, reach_nm_);
  if (freed_aj(film_nm_, 1.0) >= 0) return;
  double low = 0;
  for (int i = 0; i < 200; ++i) {
    const double mid = 0.5 * (low + film_nm_);
    if (!(mid > low && mid < film_nm_)) break;
    (freed_aj(mid, 1.0) >= 0 ? low : film_nm_) = mid;
  }
  film_nm_ = low;
}

double Capillary::freed_aj(double gap_nm, double radius_nm) const noexcept {
  const double a0 = displaced_.cut_off_nm;
  const double range = kDugdaleRangeOverA0 * a0;
  double energy_per_work = 0;
  if (displaced_.work_n_m > 0) {
    const double left = std::max(0.0, range - gap_nm);
    energy_per_work = displaced_.van_der_waals ? a0 * a0 / (a0 + gap_nm) : 0.5 * left * left / range;
  }
  return -energy_aj(gap_nm, radius_nm, formed_at(gap_nm, radius_nm)) -
         2.0 * kPi * radius_nm * displaced_.work_n_m * energy_per_work;
}

double Capillary::formation_gap_nm(double radius_nm) const noexcept {
  if (!constant_volume_) return std::min(film_nm_, reach_nm_);
  if (volume_nm3_ > 0) return std::min(film_nm_, stretch_ * det_cbrt(volume_nm3_));
  if (film_nm_ == 0) return 0;
  const double half_area = 0.5 * reach_nm_ * reach_nm_;
  return std::min({film_nm_, std::sqrt(half_area), det_cbrt(kPi * radius_nm * half_area)});
}

BridgeState Capillary::formed_at(double gap_nm, double radius_nm) const noexcept {
  BridgeState bridge;
  if (!active_) return bridge;
  bridge.present = true;
  if (constant_volume_) {
    bridge.volume_nm3 =
        volume_nm3_ > 0 ? volume_nm3_ : kPi * radius_nm * (reach_nm_ - gap_nm) * (reach_nm_ + gap_nm);
  }
  bridge.rupture_gap_nm = constant_volume_ ? stretch_ * det_cbrt(bridge.volume_nm3) : reach_nm_;
  return bridge;
}

LongRangePoint Capillary::at(double gap_nm, double radius_nm, const BridgeState& bridge) const noexcept {
  if (!bridge.present) return {};
  const double f0 = force_per_radius_ * radius_nm;
  if (!constant_volume_) {
    return {-f0 * ((reach_nm_ - gap_nm) / reach_nm_), -f0 / reach_nm_};
  }
  // 1 - D/s = (V/pi R)/(s (s + D))
  const double b2 = bridge.volume_nm3 / (kPi * radius_nm);
  const double s = std::sqrt(gap_nm * gap_nm + b2);
  return {-f0 * b2 / (s * (s + gap_nm)), -f0 * b2 / (s * s * s)};
}

double Capillary::energy_aj(double gap_nm, double radius_nm, const BridgeState& bridge) const noexcept {
  if (!bridge.present) return 0;
  const double f0 = force_per_radius_ * radius_nm;
  const double rupture = bridge.rupture_gap_nm;
  if (!constant_volume_) {
    const double left = rupture - gap_nm;
    return -f0 * left * left / (2.0 * rupture);
  }
  const double b2 = bridge.volume_nm3 / (kPi * radius_nm);
  // s - D = (V/pi R)/(s + D)
  const auto excess = [b2](double d) { return b2 / (std::sqrt(d * d + b2) + d); };
  return -f0 * (excess(gap_nm) - excess(rupture));
}

}  // namespace telenano::physics

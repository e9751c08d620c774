#include "telenano/nve_server/physics/potential/bridge_potential.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace telenano::physics {
namespace {

CapillaryParameters humid(double percent) {
  CapillaryParameters p;
  p.humidity_percent = percent;
  p.contact_angle_tip_deg = 20;
  p.contact_angle_sample_deg = 40;
  p.film_nm = 0.3;
  return p;
}

std::vector<CapillaryParameters> waters() {
  CapillaryParameters held = humid(60);
  held.model = CapillaryModel::kConstantVolume;
  CapillaryParameters given = held;
  given.volume_nm3 = 40;
  return {humid(50), humid(80), held, given};
}

PotentialJet jet_of(const BridgePotential& w, const BridgeState& bridge, double overlap, double rho) {
  PotentialJet jet;
  w.add(bridge, overlap, rho, jet);
  return jet;
}

// Energy and force are those of the sphere–plane bridge (its own tests hold it to closed forms), held from
// touch on.
TEST(BridgePotential, IsTheBridgeOfAnyRadius) {
  for (const CapillaryParameters& p : waters()) {
    const Capillary exact(p);
    const BridgePotential w(exact, 20.0);
    for (const double radius : {4.0, 20.0, 130.0}) {
      const double rho = std::log(radius);
      const BridgeState bridge = w.formed_at(w.formation_overlap_nm(rho), rho);
      ASSERT_TRUE(bridge.present);
      EXPECT_NEAR(-w.formation_overlap_nm(rho), exact.formation_gap_nm(radius), 1e-14);
      EXPECT_EQ(jet_of(w, bridge, -1.001 * bridge.rupture_gap_nm, rho).energy_aj, 0.0);
      for (const double part : {0.0, 0.1, 0.5, 0.99, 1.0}) {
        const double gap = part * bridge.rupture_gap_nm;
        const PotentialJet jet = jet_of(w, bridge, -gap, rho);
        EXPECT_NEAR(jet.energy_aj, exact.energy_aj(gap, radius, bridge), 1e-12 * radius);
        EXPECT_NEAR(jet.force_nn, exact.at(gap, radius, bridge).force_nn, 1e-12 * radius);
        if (gap > 0) {
          EXPECT_NEAR(jet.stiffness_n_m, exact.at(gap, radius, bridge).stiffness_n_m, 1e-12 * radius);
        }
      }
      const PotentialJet pressed = jet_of(w, bridge, 0.7, rho);
      const double force = exact.at(0, radius, bridge).force_nn;
      EXPECT_NEAR(pressed.force_nn, force, 1e-12 * radius);
      EXPECT_NEAR(pressed.energy_aj, exact.energy_aj(0, radius, bridge) + 0.7 * force, 1e-12 * radius);
      EXPECT_FALSE(BridgePotential::ruptured(bridge, -0.999 * bridge.rupture_gap_nm));
      EXPECT_TRUE(BridgePotential::ruptured(bridge, -1.001 * bridge.rupture_gap_nm));
    }
  }
}

// Differences over 1e-4: h²/6 of a third derivative of the term's own size, and 1e-16/h² of rounding.
TEST(BridgePotential, DerivativesAgreeWithDifferences) {
  constexpr double h = 1e-4;
  for (const CapillaryParameters& p : waters()) {
    const BridgePotential w(Capillary(p), 20.0);
    const double rho = std::log(17.0);
    const BridgeState bridge = w.formed_at(0.0, rho);
    for (const double overlap : {-0.8 * bridge.rupture_gap_nm, -0.2 * bridge.rupture_gap_nm, -0.01, 0.4}) {
      const PotentialJet jet = jet_of(w, bridge, overlap, rho);
      const PotentialJet deeper = jet_of(w, bridge, overlap + h, rho),
                         higher = jet_of(w, bridge, overlap - h, rho),
                         wider = jet_of(w, bridge, overlap, rho + h),
                         narrower = jet_of(w, bridge, overlap, rho - h);
      const double size = 1e-6 * 17.0;
      EXPECT_NEAR((deeper.energy_aj - higher.energy_aj) / (2 * h), jet.force_nn, size);
      EXPECT_NEAR((deeper.force_nn - higher.force_nn) / (2 * h), jet.stiffness_n_m, size);
      EXPECT_NEAR((wider.energy_aj - narrower.energy_aj) / (2 * h), jet.by_radius_aj, size);
      EXPECT_NEAR((wider.by_radius_aj - narrower.by_radius_aj) / (2 * h), jet.by_radius_twice_aj, size);
      EXPECT_NEAR((wider.force_nn - narrower.force_nn) / (2 * h), jet.mixed_nn, size);
      EXPECT_NEAR((deeper.by_radius_aj - higher.by_radius_aj) / (2 * h), jet.mixed_nn, size);
    }
  }
}

}  // namespace
}  // namespace telenano::physics

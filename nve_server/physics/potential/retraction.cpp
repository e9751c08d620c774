#include "telenano/nve_server/physics/potential/retraction.h"

#include "telenano/common/base/det_math.h"

namespace telenano::physics {

double retraction_force_nn(const BranchPotential& law, double overlap_nm, double log_radius) noexcept {
  PotentialJet potential;
  CurveHint hint;
  ContactSize size;
  if (overlap_nm < law.borders(log_radius).leave_nm ||
      !law.inside(overlap_nm, log_radius, hint, potential, size)) {
    law.outside(overlap_nm, log_radius, potential);
  }
  return potential.force_nn;
}

RetractionKernel retraction_kernel(const BranchPotential& law, double tip_radius_nm) {
  return {[&law](double gap_nm, double log_radius) {
            return retraction_force_nn(law, -gap_nm, log_radius) / det_exp(log_radius);
          },
          tip_radius_nm};
}

}  // namespace telenano::physics

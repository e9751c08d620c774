#include "telenano/nve_server/physics/potential/retraction.h"

#include "telenano/common/base/det_math.h"

namespace telenano::physics {

void retraction(const BranchPotential& law, double overlap_nm, double log_radius,
                PotentialJet& jet) noexcept {
  CurveHint hint;
  ContactSize size;
  if (overlap_nm < law.borders(log_radius).leave_nm || !law.inside(overlap_nm, log_radius, hint, jet, size))
    law.outside(overlap_nm, log_radius, jet);
}

RetractionKernel retraction_kernel(const BranchPotential& law, double tip_radius_nm) {
  return {[&law](double gap_nm, double log_radius) {
            PotentialJet jet;
            retraction(law, -gap_nm, log_radius, jet);
            return jet.force_nn / det_exp(log_radius);
          },
          tip_radius_nm};
}

}  // namespace telenano::physics

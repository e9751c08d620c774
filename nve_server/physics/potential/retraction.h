#pragma once

#include "telenano/nve_server/physics/potential/branch_potential.h"
#include "telenano/nve_server/physics/surface/retraction_kernel.h"

namespace telenano::physics {

/// W and its derivatives on the way out of a contact with the overlap held: of the inner branch up to where it is
/// left, then of the outer one. Without bias and bridge.
void retraction(const BranchPotential& law, double overlap_nm, double log_radius, PotentialJet& jet) noexcept;

/// What the parts of a foot add to its force there. Takes 10 ms.
RetractionKernel retraction_kernel(const BranchPotential& law, double tip_radius_nm);

}  // namespace telenano::physics

#pragma once

#include "telenano/nve_server/physics/law/tip_sample_law.h"

namespace telenano::physics {

/// The greatest attraction on a tip that is drawn out of a contact with the overlap held, with all terms of
/// the law: where it parts under load control (no spring). A walk outwards along the law itself, with its
/// memory, so that what the law does on the way (a bridge that breaks, a handover) is in it.
///
/// Begins in contact beyond where the load is 0, as a contact that was pressed; ends beyond the fold, from
/// where all terms only weaken. Positive, nN; 0 if nothing attracts.
/// Errors   of the law where its force is smooth near the greatest attraction (golden section); else one step
///          of the walk, a hundredth of the law's own length.
/// For set-up, not for loops: some 600 balances.
double total_pull_off_nn(const TipSampleLaw& law, double radius_nm) noexcept;

}  // namespace telenano::physics

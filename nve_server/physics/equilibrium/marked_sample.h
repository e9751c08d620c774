#pragma once

#include <memory>

#include "telenano/nve_server/physics/equilibrium/tip_equilibrium.h"
#include "telenano/nve_server/physics/surface/mark_journal.h"
#include "telenano/nve_server/physics/surface/spline_surface.h"

namespace telenano::physics {

/// A sample that keeps marks: a copy of the surface of its own, and the balance of the tip on it. One for
/// each session; many trials, then press() what the accepted one yielded.
///
/// Shape of a mark. Flow at contact radius a* lowers the surface by dδ_p where the tip has cut it, that is
/// within r² = 2 R δ = 2 a*². A mark of the surface falls to half at kHalfLevel of its rim; so the rim is √2
/// a*/kHalfLevel. A flow over a wide range of a* is pressed in pieces of kPiece in a*, each with its own rim,
/// which add up to the shape of the tip, whatever the step in which it came. On a slope the height falls by
/// δ_p/n_z, so that the surface moves by δ_p along its normal.
class MarkedSample {
 public:
  /// Throws UserError unless the options have a hardness and no radius force: a mark is no wider than the
  /// contact that made it, so that ∇R_eff means nothing there, and a tip would be caught at its rim.
  MarkedSample(const SplineSurface& surface, const TipSampleLaw& law, double tip_radius_nm,
               const EquilibriumOptions& options);
  MarkedSample(const MarkedSample&) = delete;
  MarkedSample& operator=(const MarkedSample&) = delete;

  const TipEquilibrium& equilibrium() const noexcept { return equilibrium_; }
  /// Lowers the surface by what flowed in an accepted step; nothing if nothing did. No allocation.
  void press(const TipFlow& yielded) noexcept;

  const SplineSurface& surface() const noexcept { return *surface_; }
  /// For who brings back marks that were kept elsewhere.
  SplineSurface& surface_to_restore() noexcept { return *surface_; }
  /// Steps that left a mark.
  std::uint64_t marks() const noexcept { return marks_; }
  /// From now on hears of every mark; null: nobody. Must outlive this, or be taken away before.
  void set_journal(MarkJournal* journal) noexcept { journal_ = journal; }

 private:
  std::shared_ptr<SplineSurface> surface_;
  TipEquilibrium equilibrium_;
  std::uint64_t marks_ = 0;
  MarkJournal* journal_ = nullptr;
};

}  // namespace telenano::physics

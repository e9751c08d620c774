#include "telenano/nve_server/physics/equilibrium/marked_sample.h"

#include <algorithm>
#include <cmath>

#include "telenano/common/base/error.h"

namespace telenano::physics {
namespace {

constexpr double kHalfLevel = 0.735;  // (1 − ρ⁴)² = ½
constexpr double kPiece = 1.1;        // of a*
constexpr int kMaxPieces = 64;
constexpr double kLeastNormal = 0.1;  // steeper a height field cannot follow

const EquilibriumOptions& checked(const EquilibriumOptions& options) {
  if (!options.hardness_gpa) throw UserError("a sample that keeps marks needs a hardness");
  if (options.radius_force) throw UserError("a sample that keeps marks cannot have a radius force");
  return options;
}

}  // namespace

MarkedSample::MarkedSample(const SplineSurface& surface, const TipSampleLaw& law, double tip_radius_nm,
                           const EquilibriumOptions& options)
    : surface_(std::make_shared<SplineSurface>(surface)),
      equilibrium_(surface_, law, tip_radius_nm, checked(options)) {}

void MarkedSample::press(const TipFlow& yielded) noexcept {
  const PlasticFlow& flow = yielded.flow;
  if (!(flow.depth_nm > 0.0)) return;
  ++marks_;
  const PlasticContact& plastic = *equilibrium_.plastic();
  const double ratio = flow.radius_nm / yielded.from_radius_nm;
  double left = flow.depth_nm;
  double radius = yielded.from_radius_nm;
  for (int piece = 0; piece < kMaxPieces && left > 0.0; ++piece) {
    // The last piece takes what is left, so that the depth is exact.
    const bool last = piece + 1 == kMaxPieces || radius * kPiece >= flow.radius_nm || !(ratio > 1.0);
    const double to = last ? flow.radius_nm : radius * kPiece;
    const double depth = last ? left : std::min(left, plastic.depth_nm(radius, to, yielded.origin_radius_nm));
    const double a = last ? flow.contact_radius_nm : plastic.yield_radius_nm(to);
    for (int i = 0; i < yielded.feet; ++i) {
      const TipFlow::Foot& foot = yielded.foot[i];
      Mark mark;
      mark.x_nm = foot.at_w_nm.x();
      mark.y_nm = foot.at_w_nm.y();
      mark.depth_nm = depth / std::max(foot.normal_z, kLeastNormal);
      mark.radius_nm = std::sqrt(2.0) * a / kHalfLevel;
      mark.conformity = equilibrium_.tip_radius_nm() / to;
      mark.strain = plastic.strain();
      surface_->press(mark);
      if (journal_ != nullptr) journal_->on_mark(mark);
    }
    left -= depth;
    radius = to;
    if (last) break;
  }
}

}  // namespace telenano::physics

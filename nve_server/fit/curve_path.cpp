#include "telenano/nve_server/fit/curve_path.h"

#include <algorithm>
#include <cmath>

namespace telenano::fit {
namespace {

constexpr int kHalvings = 26;
constexpr int kNodesMax = 4000;
constexpr double kLeastStep_nm = 1e-3;

class Walker {
 public:
  Walker(const physics::TipSampleLaw& law, double radius_nm, double compliance_nm_nn)
      : law_(law), radius_nm_(radius_nm), compliance_(compliance_nm_nn) {}

  struct At {
    PathNode node;
    int jumps = 0;
    physics::Branch branch = physics::Branch::kFree;
    bool bridge = false;
    bool good = true;
  };

  At go(double x_nm, physics::TipSampleState& state) const {
    const physics::Equilibrium eq = law_.advance(x_nm, compliance_, radius_nm_, state);
    At at;
    at.good = eq.status == physics::SolveStatus::kOk;
    at.jumps = eq.jumps;
    at.branch = eq.branch;
    at.bridge = eq.bridge;
    // Near a fold 1 + cS passes zero: the cubic must not follow it to infinity.
    const double give = std::max(1.0 + compliance_ * eq.stiffness_n_m, 1e-3);
    at.node = {x_nm, eq.force_nn, eq.stiffness_n_m / give};
    return at;
  }

 private:
  const physics::TipSampleLaw& law_;
  double radius_nm_;
  double compliance_;
};

bool inside(physics::Branch branch) {
  return branch == physics::Branch::kContact || branch == physics::Branch::kNonContact;
}

bool parted(const Walker::At& a, const Walker::At& b) {
  return b.jumps > 0 || inside(a.branch) != inside(b.branch) || a.bridge != b.bridge;
}

void trace_segment(const Walker& walker, physics::TipSampleState& state, double from_nm, double to_nm,
                   double tolerance_nn, PathSegment& segment) {
  const double way = to_nm > from_nm ? 1.0 : -1.0;
  const double length = std::abs(to_nm - from_nm);
  Walker::At last = walker.go(from_nm, state);
  segment.good = last.good;
  segment.starts = {0};
  segment.nodes = {last.node};
  double step = 0.05;
  while (segment.good && way * (to_nm - last.node.x_nm) > 1e-12 * length &&
         segment.nodes.size() < static_cast<std::size_t>(kNodesMax)) {
    // Far out the law changes over the gap's own length; near contact over some hundredths of a nanometre,
    // and deep in it over the overlap's.
    const double x = last.node.x_nm;
    const double scale = std::max(std::abs(x), 0.6);
    step = std::min({0.06 * scale, 1.5 * step, length / 25.0});
    const physics::TipSampleState before = state;
    double target = x;
    Walker::At next;
    for (;;) {
      target = way * (to_nm - x) <= step ? to_nm : x + way * step;
      next = walker.go(target, state);
      if (!next.good) {
        segment.good = false;
        return;
      }
      // The trapezium of the slopes misses h³F'''/12, the cubic h⁴F''''/384: a small part of it for any step
      // that this allows.
      const double missed = next.node.force_nn - last.node.force_nn -
                            0.5 * (target - x) * (last.node.slope_n_m + next.node.slope_n_m);
      if (std::abs(missed) <= tolerance_nn || step < kLeastStep_nm || parted(last, next)) break;
      step *= 0.5;
      state = before;
    }
    if (parted(last, next)) {
      // Where: halve what holds it. `low` has not leapt, `high` has.
      physics::TipSampleState low_state = before;
      Walker::At low = last;
      double high_x = target;
      Walker::At high = next;
      physics::TipSampleState high_state = state;
      for (int i = 0; i < kHalvings; ++i) {
        const double middle = 0.5 * (low.node.x_nm + high_x);
        physics::TipSampleState trial = low_state;
        const Walker::At at = walker.go(middle, trial);
        if (!at.good) break;
        if (parted(low, at)) {
          high = at;
          high_x = middle;
          high_state = trial;
        } else {
          low = at;
          low_state = trial;
        }
      }
      // The force bends like a root towards a fold: nodes that crowd there.
      physics::TipSampleState crowd = before;
      for (const double part : {0.5, 0.2, 0.08, 0.03, 0.01, 0.003}) {
        const double at_x = low.node.x_nm - part * (low.node.x_nm - x);
        const Walker::At at = walker.go(at_x, crowd);
        if (at.good && way * (at.node.x_nm - segment.nodes.back().x_nm) > 0) segment.nodes.push_back(at.node);
      }
      if (way * (low.node.x_nm - segment.nodes.back().x_nm) > 0) segment.nodes.push_back(low.node);
      const double size = std::abs(high.node.force_nn - low.node.force_nn);
      if (!segment.leap_x_nm || size > segment.leap_nn) {
        segment.leap_x_nm = high.node.x_nm;
        segment.leap_nn = size;
      }
      const bool bridge = high.bridge != low.bridge;
      std::optional<double>& place = bridge ? segment.bridge_x_nm : segment.dry_leap_x_nm;
      double& largest = bridge ? segment.bridge_nn : segment.dry_leap_nn;
      if (!place || size > largest) {
        place = high.node.x_nm;
        largest = size;
      }
      segment.starts.push_back(segment.nodes.size());
      segment.nodes.push_back(high.node);
      last = high;
      state = high_state;
      step = 0.02;
      continue;
    }
    segment.nodes.push_back(next.node);
    last = next;
  }
}

}  // namespace

double PathSegment::force_nn(double x_nm) const noexcept {
  const bool falling = nodes.size() > 1 && nodes.back().x_nm < nodes.front().x_nm;
  const double way = falling ? -1.0 : 1.0;
  const auto after = std::partition_point(
      nodes.begin(), nodes.end(), [&](const PathNode& node) { return way * node.x_nm <= way * x_nm; });
  if (after == nodes.begin()) return nodes.front().force_nn;
  if (after == nodes.end()) return nodes.back().force_nn;
  const PathNode& a = *(after - 1);
  const PathNode& b = *after;
  const auto index = static_cast<std::size_t>(after - nodes.begin());
  if (std::find(starts.begin(), starts.end(), index) != starts.end()) return a.force_nn;
  const double h = b.x_nm - a.x_nm;
  const double t = (x_nm - a.x_nm) / h;
  const double u = 1.0 - t;
  return u * u * (1.0 + 2.0 * t) * a.force_nn + t * t * (3.0 - 2.0 * t) * b.force_nn +
         h * t * u * (u * a.slope_n_m - t * b.slope_n_m);
}

CurvePath trace_path(const physics::TipSampleLaw& law, double radius_nm, double compliance_nm_nn,
                     double from_nm, double to_nm, double tolerance_nn) {
  CurvePath path;
  const Walker walker(law, radius_nm, compliance_nm_nn);
  physics::TipSampleState state;
  trace_segment(walker, state, from_nm, to_nm, tolerance_nn, path.approach);
  trace_segment(walker, state, to_nm, from_nm, tolerance_nn, path.retract);
  return path;
}

}  // namespace telenano::fit

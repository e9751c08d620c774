#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "tests/studies/precision/analytic_surface.h"
#include "tests/studies/precision/studies.h"

namespace telenano::studies {
namespace {

using physics::FootMemory;
using physics::HeightJet;
using physics::Search;
using physics::SplineSurface;
using physics::SurfaceContact;

/// A sphere's centre that is carried across a surface, and the true distances.
struct Ground {
  std::string condition;
  AnalyticSurface surface;
  double side_nm;
  double spacing_nm;
  double tip_radius_nm;
  std::vector<Vec3> centres{};
  std::vector<double> exact{};
};

/// One way to find the distance along the path; adding a method is adding an entry.
struct Method {
  std::string family;
  std::string setting;
  bool is_default;
  std::function<void(const Ground&, const SplineSurface&, double*)> run;
};

void follow(const Ground& ground, const SplineSurface& surface, Search search, bool keep, double* distances) {
  FootMemory memory;
  for (std::size_t i = 0; i < ground.centres.size(); ++i) {
    if (!keep) memory = FootMemory{};
    const SurfaceContact contact = surface.nearest(ground.centres[i], search, memory);
    distances[i] = contact.converged ? contact.distance_nm : NAN;
  }
}

/// n plain Newton or Gauss–Newton steps from the last foot; no step control.
void plain_steps(const Ground& ground, const SplineSurface& surface, int steps, bool newton,
                 double* distances) {
  double x = ground.centres[0].x();
  double y = ground.centres[0].y();
  for (std::size_t i = 0; i < ground.centres.size(); ++i) {
    const Vec3& c = ground.centres[i];
    HeightJet j = surface.jet(x, y);
    for (int k = 0; k < steps; ++k) {
      const double r = j.z - c.z();
      const double bend = newton ? r : 0.0;
      const double gx = x - c.x() + r * j.zx;
      const double gy = y - c.y() + r * j.zy;
      const double a = 1 + j.zx * j.zx + bend * j.zxx;
      const double b = j.zx * j.zy + bend * j.zxy;
      const double d = 1 + j.zy * j.zy + bend * j.zyy;
      const double det = a * d - b * b;
      x -= (d * gx - b * gy) / det;
      y -= (a * gy - b * gx) / det;
      if (!std::isfinite(x + y)) {
        x = c.x();
        y = c.y();
      }
      j = surface.jet(x, y);
    }
    distances[i] = (c - Vec3(x, y, j.z)).norm();
  }
}

/// The tangent plane under the centre: distance = height over the ground · cosine of its slope.
void tangent_plane(const Ground& ground, const SplineSurface& surface, double* distances) {
  for (std::size_t i = 0; i < ground.centres.size(); ++i) {
    const Vec3& c = ground.centres[i];
    const HeightJet j = surface.jet(c.x(), c.y());
    distances[i] = (c.z() - j.z) / std::sqrt(1 + j.zx * j.zx + j.zy * j.zy);
  }
}

std::vector<Method> methods() {
  std::vector<Method> all{
      {"global search, warm", "to 1e-6 cells", true,
       [](const Ground& g, const SplineSurface& s, double* d) { follow(g, s, Search::kGlobal, true, d); }},
      {"global search, cold", "to 1e-6 cells", false,
       [](const Ground& g, const SplineSurface& s, double* d) { follow(g, s, Search::kGlobal, false, d); }},
      {"local search, warm", "to 1e-6 cells", false,
       [](const Ground& g, const SplineSurface& s, double* d) { follow(g, s, Search::kLocal, true, d); }},
      {"tangent plane below", "", false, tangent_plane}};
  for (const int n : {1, 2, 3, 5}) {
    all.push_back(
        {"n Newton steps, warm", fmt::format("n = {}", n), false,
         [n](const Ground& g, const SplineSurface& s, double* d) { plain_steps(g, s, n, true, d); }});
  }
  for (const int n : {1, 3, 10}) {
    all.push_back(
        {"n Gauss–Newton steps, warm", fmt::format("n = {}", n), false,
         [n](const Ground& g, const SplineSurface& s, double* d) { plain_steps(g, s, n, false, d); }});
  }
  return all;
}

}  // namespace

Section nearest_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "nearest";
  section.title = "Nearest point of the surface";
  section.lead =
      "Distance from the tip's centre to the surface, in nm, along a path at 0.5 nm a step (500 nm/s at 1 "
      "kHz), against a dense search of the analytic surface that uses heights only. Samples every 2 nm "
      "(gentle) and 0.5 nm (rough), so that what interpolation adds (next section) stays near 1e-6 nm: that "
      "is the floor of the figure.";
  section.choice =
      "Default: the global search, started warm. Where the ground bends less than the tip all iterations "
      "find the same foot; where it bends more, the foot that is followed is soon not the nearest one any "
      "more, and a local method, however many steps it takes, is wrong by nanometres: more than the whole "
      "range of the adhesion. That certainty is what the search of the samples' tops costs.";
  std::vector<Ground> grounds{{"gentle ground: waves of 200 nm, 8 nm high, tip 20 nm", {8, 200}, 240, 2, 20},
                              {"rough ground: waves of 25 nm, 3 nm high, tip 20 nm", {3, 25}, 160, 0.5, 20}};
  const int points = effort.pick(60, 240);
  for (Ground& ground : grounds) {
    for (int i = 0; i < points; ++i) {
      const double along = 0.5 * (i - 0.5 * points);
      const double x = 0.8 * along;
      const double y = 0.6 * along * 0.7 + 3;
      // Where the sphere just touches: on rough ground it rides on the tops.
      Vec3 centre(x, y, ground.surface.height_nm(x, y) + ground.tip_radius_nm);
      double distance = 0;
      for (int k = 0; k < 3; ++k) {
        distance =
            dense_distance(ground.surface, centre, 1.2 * ground.tip_radius_nm, effort.quick ? 0.25 : 0.1);
        if (k < 2) centre.z() += ground.tip_radius_nm - distance;
      }
      ground.centres.push_back(centre);
      ground.exact.push_back(distance);
    }
    const SplineSurface surface(ground.surface.grid(ground.side_nm, ground.spacing_nm), ground.tip_radius_nm);
    std::vector<double> distances(ground.centres.size());
    for (const Method& method : methods()) {
      Row row{ground.condition, method.family, method.setting, method.is_default, {}, {}};
      method.run(ground, surface, distances.data());
      std::vector<double> errors;
      for (std::size_t i = 0; i < distances.size(); ++i)
        errors.push_back(std::fabs(distances[i] - ground.exact[i]));
      row.errors = summarise(errors);
      row.cost = measure([&] { method.run(ground, surface, distances.data()); }, distances.size(), effort);
      section.rows.push_back(row);
    }
  }
  section.figures.push_back(work_precision_figure(
      {"nearest", "Error against time",
       "Largest error of the distance. On rough ground only the methods that search everywhere are right.",
       ""},
      section.rows, "largest error (nm)", folder));
  return section;
}

}  // namespace telenano::studies

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <stdexcept>

#include "telenano/common/base/random.h"
#include "tests/studies/precision/analytic_surface.h"
#include "tests/studies/precision/studies.h"

namespace telenano::studies {
namespace {

using physics::HeightGrid;
using physics::HeightJet;
using physics::SplineSurface;

/// Height, slopes and curvatures between the samples; adding a scheme is adding an entry to schemes().
class Scheme {
 public:
  virtual ~Scheme() = default;
  virtual HeightJet jet(double x, double y) const = 0;
};

class BSpline final : public Scheme {
 public:
  explicit BSpline(const HeightGrid& grid) : surface_(grid) {}
  HeightJet jet(double x, double y) const override { return surface_.jet(x, y); }

 private:
  SplineSurface surface_;
};

class Bilinear final : public Scheme {
 public:
  explicit Bilinear(const HeightGrid& grid) : grid_(grid) {}
  HeightJet jet(double x, double y) const override {
    const double across = (x - grid_.x_first_nm) / grid_.dx_nm;
    const double along = (y - grid_.y_first_nm) / grid_.dy_nm;
    const int i = std::clamp(static_cast<int>(across), 0, grid_.columns - 2);
    const int j = std::clamp(static_cast<int>(along), 0, grid_.rows - 2);
    const double u = across - i;
    const double v = along - j;
    const double* z = &grid_.z_nm[static_cast<std::size_t>(j) * grid_.columns + i];
    const double z00 = z[0], z10 = z[1], z01 = z[grid_.columns], z11 = z[grid_.columns + 1];
    HeightJet jet;
    jet.z = (1 - v) * ((1 - u) * z00 + u * z10) + v * ((1 - u) * z01 + u * z11);
    jet.zx = ((1 - v) * (z10 - z00) + v * (z11 - z01)) / grid_.dx_nm;
    jet.zy = ((1 - u) * (z01 - z00) + u * (z11 - z10)) / grid_.dy_nm;
    jet.zxy = (z11 - z10 - z01 + z00) / (grid_.dx_nm * grid_.dy_nm);
    return jet;
  }

 private:
  HeightGrid grid_;
};

/// Bicubic convolution with a = -1/2 (Keys, IEEE Trans. ASSP 29:1153, 1981): C1, third order.
class CatmullRom final : public Scheme {
 public:
  explicit CatmullRom(const HeightGrid& grid) : grid_(grid) {}
  HeightJet jet(double x, double y) const override {
    const double across = (x - grid_.x_first_nm) / grid_.dx_nm;
    const double along = (y - grid_.y_first_nm) / grid_.dy_nm;
    const int i = std::clamp(static_cast<int>(across), 1, grid_.columns - 3);
    const int j = std::clamp(static_cast<int>(along), 1, grid_.rows - 3);
    const Weights wx(across - i);
    const Weights wy(along - j);
    HeightJet jet;
    for (std::size_t r = 0; r < 4; ++r) {
      const double* z =
          &grid_.z_nm[static_cast<std::size_t>(j - 1 + static_cast<int>(r)) * grid_.columns + (i - 1)];
      double value = 0, slope = 0, bend = 0;
      for (std::size_t c = 0; c < 4; ++c) {
        value += z[c] * wx.value[c];
        slope += z[c] * wx.slope[c];
        bend += z[c] * wx.bend[c];
      }
      jet.z += wy.value[r] * value;
      jet.zx += wy.value[r] * slope;
      jet.zy += wy.slope[r] * value;
      jet.zxx += wy.value[r] * bend;
      jet.zxy += wy.slope[r] * slope;
      jet.zyy += wy.bend[r] * value;
    }
    const double ix = 1 / grid_.dx_nm, iy = 1 / grid_.dy_nm;
    jet.zx *= ix;
    jet.zy *= iy;
    jet.zxx *= ix * ix;
    jet.zxy *= ix * iy;
    jet.zyy *= iy * iy;
    return jet;
  }

 private:
  struct Weights {
    explicit Weights(double u)
        : value{u * (-0.5 + u * (1 - 0.5 * u)), 1 + u * u * (-2.5 + 1.5 * u), u * (0.5 + u * (2 - 1.5 * u)),
                u * u * (-0.5 + 0.5 * u)},
          slope{-0.5 + u * (2 - 1.5 * u), u * (-5 + 4.5 * u), 0.5 + u * (4 - 4.5 * u), u * (-1 + 1.5 * u)},
          bend{2 - 3 * u, -5 + 9 * u, 4 - 9 * u, -1 + 3 * u} {}
    std::array<double, 4> value, slope, bend;
  };
  HeightGrid grid_;
};

struct SchemeEntry {
  std::string family;
  bool is_default;
  std::function<std::unique_ptr<Scheme>(const HeightGrid&)> make;
};

std::vector<SchemeEntry> schemes() {
  return {{"bicubic B-spline", true, [](const HeightGrid& g) { return std::make_unique<BSpline>(g); }},
          {"bicubic Catmull–Rom", false, [](const HeightGrid& g) { return std::make_unique<CatmullRom>(g); }},
          {"bilinear", false, [](const HeightGrid& g) { return std::make_unique<Bilinear>(g); }}};
}

double slope_error(const HeightJet& a, const HeightJet& b) {
  return std::hypot(a.zx - b.zx, a.zy - b.zy);
}

double bend_error(const HeightJet& a, const HeightJet& b) {
  return std::max({std::fabs(a.zxx - b.zxx), std::fabs(a.zxy - b.zxy), std::fabs(a.zyy - b.zyy)});
}

}  // namespace

Section interpolation_section(const Effort& effort, const FigureFolder& folder) {
  Section section;
  section.id = "interpolation";
  section.title = "Between the samples of a scan";
  section.lead =
      "Height, slope and curvature between samples of a surface that is known in closed form (crossed waves "
      "of 100 nm, 5 nm high), at seeded random points away from the rim. Errors are divided by the greatest "
      "height, slope and curvature of the waves.";
  section.choice =
      "Default: the bicubic B-spline. It is the only one of the three with continuous curvature, so that the "
      "ground that is dilated by the tip has no creases of the scan's cells; bilinear has no curvature at "
      "all, Catmull–Rom's jumps from cell to cell. Its "
      "height is of fourth order where Catmull–Rom's is of third, for the same sixteen samples and the same "
      "time.";
  const AnalyticSurface surface{5, 100};
  const double k = 2 * M_PI / surface.length_nm;
  const double height = 1.4 * surface.amplitude_nm;
  const double slope = height * k;
  const double bend = height * k * k;
  const int count = effort.pick(400, 4000);
  Random random(20260101);
  std::vector<Vec3> points;
  std::vector<HeightJet> exact;
  for (int i = 0; i < count; ++i) {
    // 70 nm from the rim at least: the mirrored ends of the spline are felt some samples into the grid.
    points.emplace_back(random.uniform(-80, 80), random.uniform(-80, 80), 0.0);
    exact.push_back(surface.jet(points.back().x(), points.back().y()));
  }
  std::vector<Line> lines;
  for (const SchemeEntry& entry : schemes()) {
    Line of_height{"height", entry.family, {}, {}};
    Line of_slope{"slope", entry.family, {}, {}};
    Line of_bend{"curvature", entry.family, {}, {}};
    for (const int per_wave : {4, 6, 8, 12, 16, 24, 32, 48, 64}) {
      const auto scheme = entry.make(surface.grid(300, surface.length_nm / per_wave));
      std::vector<double> z, s, b;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const HeightJet jet = scheme->jet(points[i].x(), points[i].y());
        z.push_back(std::fabs(jet.z - exact[i].z) / height);
        s.push_back(slope_error(jet, exact[i]) / slope);
        b.push_back(bend_error(jet, exact[i]) / bend);
      }
      double sink = 0;
      const Cost cost = measure(
          [&] {
            for (const Vec3& p : points) sink += scheme->jet(p.x(), p.y()).z;
          },
          points.size(), effort);
      if (!std::isfinite(sink)) throw std::logic_error("interpolation: not finite");
      const std::pair<const char*, std::vector<double>*> quantities[] = {
          {"height", &z}, {"slope", &s}, {"curvature", &b}};
      for (const auto& [name, errors] : quantities) {
        section.rows.push_back({name, entry.family, fmt::format("{} samples a wave", per_wave),
                                entry.is_default, summarise(*errors), cost});
      }
      for (Line* line : {&of_height, &of_slope, &of_bend}) line->x.push_back(per_wave);
      of_height.y.push_back(summarise(z).largest);
      of_slope.y.push_back(summarise(s).largest);
      of_bend.y.push_back(summarise(b).largest);
    }
    for (Line* line : {&of_height, &of_slope, &of_bend}) lines.push_back(std::move(*line));
  }
  std::stable_sort(section.rows.begin(), section.rows.end(), [](const Row& a, const Row& b) {
    return a.condition == "height" ? b.condition != "height"
                                   : a.condition == "slope" && b.condition == "curvature";
  });
  std::stable_sort(lines.begin(), lines.end(), [](const Line& a, const Line& b) {
    return a.panel == "height" ? b.panel != "height" : a.panel == "slope" && b.panel == "curvature";
  });
  section.figures.push_back(log_line_figure(
      {"interpolation", "Error against the density of samples",
       "Largest error, relative to the greatest value. Slopes of the lines are orders: B-spline 4, 3, 2 for "
       "height, slope and curvature.",
       ""},
      lines,
      {"samples a wavelength", "largest relative error", "set xtics (4,8,16,32,64)\nset xrange [3.5:72]\n"},
      folder));
  return section;
}

}  // namespace telenano::studies

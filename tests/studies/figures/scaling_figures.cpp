#include "tests/studies/figures/scaling_figures.h"

#include <fmt/format.h>

#include "tests/studies/report/paper_table.h"
#include "tests/studies/zwidth/scaling_study.h"

namespace telenano::studies {
namespace {

ScalingRegion omega_region() {
  control::ScalingPlant plant;
  plant.coupling_stiffness_n_m = 1 / (1 / 20.0 + 1 / 40.0);
  return scaling_region(plant, 0.25, control::device_force_scale_bound(0.8, 12, 500));
}

}  // namespace

Figure draw_ks11(const FigureFolder& folder) {
  const ScalingRegion region = omega_region();
  const auto cases = [&](double factor) {
    return fmt::format("α_v α_F = {:.3g}, {:.3g} times the exact bound of {:.3g}", factor,
                       factor / region.exact, region.exact);
  };
  write_beside_paper(
      folder, "ks11",
      {{"Z-width over the scale", "proportional to α_v α_F", "as printed", "KS section III.D, fig. 11",
        "|Z| less the device's is α_v α_F times the coupling's, KS eqs. 9 and 10", "agrees (their equation)"},
       {"case I", "α_F = 1/α_v: for high adhesion a better force feedback", "as printed", "KS section III.D",
        cases(1), "within the region"},
       {"case II", "α_F = 1/α_v²: for small adhesion a better force feedback", "as printed",
        "KS section III.D", cases(1e6), "beyond the region at α_v = 1e-6"},
       {"impedances of the figure", "k_c, b_c, m, b, T and α_v not stated", "no axis in the text",
        "KS fig. 11", "in the caption", "not comparable"}});
  return draw_transmitted_impedance(region, 1e-6, "ks11", folder);
}

Figure draw_ks12(const FigureFolder& folder) {
  const ScalingRegion region = omega_region();
  write_beside_paper(
      folder, "ks12",
      {{"bound of α_v α_F", "Llewellyn's criterion, KS eq. 21: stability is guaranteed", "as printed",
        "KS section III.D, fig. 12",
        fmt::format("{:.4g} by their criterion; {:.4g} exactly, of a sampled loop; a simulated device swings "
                    "from {:.4g} "
                    "on, in the worst hand from {:.4g}",
                    region.published, region.exact, region.simulated.free_device,
                    region.simulated.worst_hand),
        fmt::format("theirs permits {:.3g} times what is exact", region.published / region.exact)},
       {"bound of α_F by the device", "ε f̂_a/f̂_e, 0 < ε < 1", "as printed", "KS eq. 22",
        fmt::format("{:.3g} with ε = 0.8, 12 N, 500 nN", region.device_force_scale),
        "agrees (their equation)"},
       {"edges of the figure", "b, T, k_c and ε not stated", "no axis in the text", "KS fig. 12",
        "in the caption", "not comparable"}});
  return draw_scaling_region(region, "ks12", folder);
}

}  // namespace telenano::studies

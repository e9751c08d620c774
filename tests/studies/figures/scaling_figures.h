#pragma once

#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// For the simulated omega.3 at 1 kHz and the port of the scene flat_silicon_oxide: 40 and 20 N/m in series,
/// 500 nN.
Figure draw_ks11(const FigureFolder& folder);
Figure draw_ks12(const FigureFolder& folder);

}  // namespace telenano::studies

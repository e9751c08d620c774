#pragma once

#include <string>
#include <vector>

#include "tests/studies/report/figure_folder.h"
#include "tests/studies/zwidth/paper_study.h"

namespace telenano::studies {

/// What one of CB's four factors buys, all else equal: over the eight pairs of configurations that differ in
/// it alone, the ratio (with it over without it) of the stiffest wall and of the strongest virtual damper
/// that the simulation holds.
struct FactorGain {
  const char* factor = "";
  double stiffness_least = 0, stiffness_median = 0, stiffness_most = 0;
  double damping_least = 0, damping_median = 0, damping_most = 0;
};
/// Order: damper, rate, resolution, filter.
std::vector<FactorGain> factor_gains(const std::vector<PaperRow>& rows);
std::string factor_table(const std::vector<FactorGain>& gains);  ///< CSV

/// Rows as K over B: theory and simulation. Writes `id`.csv.
Figure draw_zwidth(const ZWidthOptions& options, const std::vector<ZWidthRow>& rows, const std::string& id,
                   const FigureFolder& folder);

/// CB fig. 3: a stable and an unstable wall over time.
Figure draw_cb03(const FigureFolder& folder);

/// CB figs. 4a-d: `part` 'a' fine encoder, no filter; 'b' coarse, none; 'c' fine, filter; 'd' coarse, filter.
/// Curves: damper in and out, 1 kHz and 100 Hz. Runs the paper study in the folder if it is not there yet.
Figure draw_cb04(char part, const FigureFolder& folder);

/// `file`.svg, .csv and .gp beside each other, for --plot. Throws UserError unless the name ends in .svg and
/// gnuplot is there.
struct PlotTarget {
  FigureFolder folder;
  std::string id;
};
PlotTarget plot_target(const std::string& file, const std::string& command);

}  // namespace telenano::studies

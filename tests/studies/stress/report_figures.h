#pragma once

#include <vector>

#include "tests/studies/report/figure_folder.h"
#include "tests/studies/stress/table.h"

namespace telenano::studies::stress {

/// Share of runs that went through, delay against loss, a panel a method.
Figure survival_figure(const std::vector<Row>& rows, const FigureFolder& folder);
/// Shown force, drift, least net energy over the round trip.
Figure round_trip_figure(const std::vector<Row>& rows, const FigureFolder& folder);
/// Force error over the station's rate, and over what a step of the whole loop costs (timed here).
Figure error_figure(const std::vector<Row>& rows, const Scenes& scenes, const FigureFolder& folder);
/// The energy budget of two runs tick by tick: through a burst of loss, and through a server's death.
Figure budget_figure(const Scenes& scenes, const FigureFolder& folder);

}  // namespace telenano::studies::stress

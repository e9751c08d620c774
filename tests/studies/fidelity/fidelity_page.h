#pragma once

#include <string>
#include <vector>

#include "tests/studies/fidelity/fidelity_grid.h"
#include "tests/studies/fidelity/sensitivity.h"
#include "tests/studies/report/figure_folder.h"

namespace telenano::studies::fidelity {

/// The pictures: one motion felt by each method beside the truth, heat maps of motion × round trip for each
/// method and loss, the worst cells by name, and which wrong renderers are found out (where they were tried).
/// `twin` with companding beside `twin` without, motion by motion: a table as HTML, and as CSV.
std::string companding_section(const std::vector<CellResult>& results,
                               const std::vector<CellResult>& companded);
std::string companding_csv(const std::vector<CellResult>& results, const std::vector<CellResult>& companded);

std::string fidelity_sections(const std::vector<CellResult>& results,
                              const std::vector<SensitivityRow>& sensitivity, const FigureFolder& folder);

}  // namespace telenano::studies::fidelity

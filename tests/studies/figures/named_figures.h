#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "tests/studies/report/figure_folder.h"

/// The figures of the source papers, drawn again from this program's own objects.
namespace telenano::studies {

/// Adding a figure is adding an entry to named_figures().
struct NamedFigure {
  const char* name;  ///< as --only takes it: paper and number
  const char* title;
  Figure (*draw)(const FigureFolder& folder);  ///< writes its CSV; the caption says what was found
};

std::span<const NamedFigure> named_figures();

/// Draws those in `only` (all if empty) into `out`: NAME.csv, NAME.gp, NAME.svg, and an index.html with title
/// and caption of each. Throws UserError for an unknown name, before anything is drawn.
void draw_figures(const std::vector<std::string>& only, const std::filesystem::path& out);

}  // namespace telenano::studies

#pragma once

#include <string>
#include <vector>

#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// One thing that a source paper says of a figure, beside what comes out here.
struct BesidePaper {
  std::string what;
  std::string paper;   ///< as it says it
  std::string off_by;  ///< how far that may be read wrongly; "as printed", or why there is no number
  std::string where;   ///< place in the paper
  std::string ours;
  std::string difference;  ///< ours against it: a number where both are numbers, else whether they agree
};

/// `id`.paper.csv in the folder.
void write_beside_paper(const FigureFolder& folder, const std::string& id,
                        const std::vector<BesidePaper>& rows);
/// The table of a figure as HTML; empty where none was written.
std::string beside_paper_html(const FigureFolder& folder, const std::string& id);

}  // namespace telenano::studies

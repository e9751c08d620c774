#pragma once

#include <string>
#include <vector>

#include "tests/studies/report/figure_folder.h"
#include "tests/studies/report/run_data.h"

namespace telenano::studies {

/// The report as one HTML page that needs no other file: figures inside, no script, no font from elsewhere.
std::string make_page(const std::string& title, const std::vector<RunData>& runs,
                      const std::vector<Figure>& figures, const std::string& note);

/// A page of the same kind with other contents: begin, pieces, end.
std::string page_begin(const std::string& title, const std::string& lead);
std::string figure_html(const Figure& figure);
std::string page_end();

std::string html_escaped(const std::string& text);

}  // namespace telenano::studies

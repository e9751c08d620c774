#pragma once

#include <string>
#include <vector>

#include "tests/studies/report/figures.h"
#include "tests/studies/report/run_data.h"

namespace telenano::studies {

/// The report as one HTML page that needs no other file: figures inside, no script, no font from elsewhere.
std::string make_page(const std::string& title, const std::vector<RunData>& runs,
                      const std::vector<Figure>& figures, const std::string& note);

std::string html_escaped(const std::string& text);

}  // namespace telenano::studies

#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "tests/studies/precision/work_precision.h"

namespace telenano::studies {

/// What the ground's fields look like over a scan, and a tip's force along raster lines beside elasticity's: two
/// figures for the section. `table_file` finds a table of tests/data/elastic by its name.
void add_ground_pictures(Section& section,
                         const std::function<std::filesystem::path(const std::string&)>& table_file,
                         bool quick, const FigureFolder& folder);

}  // namespace telenano::studies

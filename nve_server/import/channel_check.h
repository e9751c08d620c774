#pragma once

#include <string>
#include <string_view>

#include "telenano/nve_server/import/gwy_file.h"

/// What a channel in metres is: a height, or a signal of the instrument.
namespace telenano::import {

enum class TitleSays { kNothing, kHeight, kSignal };

/// By whole words in any letters: "Height (measured)", "Topography [Fwd]", "ZSensor"; but "Z Error", "Amplitude",
/// "X Sensor".
TitleSays title_says(std::string_view title);

/// `original`: a file that begins with "WSxM file". Gwyddion 2.62 takes "20 µm" in Latin-1 for 20 nm. What is not as
/// the file's own header says it, in one line; empty: nothing.
std::string differs_from_wsxm(std::string_view original, const GwyField& field);

}  // namespace telenano::import

#pragma once

#include <string>
#include <vector>

#include "tests/studies/methods/shown_stiffness.h"
#include "tests/studies/report/figure_folder.h"

namespace telenano::studies {

/// Every method at every round trip, in this order; spread over the cores. Those of `trace_rtt_ms` keep a
/// trace.
std::vector<PressResult> run_presses(const std::vector<control::Method>& methods,
                                     const std::vector<double>& rtt_ms, double trace_rtt_ms,
                                     std::uint64_t seed);

std::string press_csv(const std::vector<PressResult>& results);  ///< one row a method and round trip

/// Tables and figures for the page; writes shown_stiffness.csv and the figures' numbers into `folder`.
std::string press_section(const std::vector<PressResult>& results, const FigureFolder& folder);

/// Colour of a method, the same in every figure.
const char* method_colour(control::Method method);

}  // namespace telenano::studies

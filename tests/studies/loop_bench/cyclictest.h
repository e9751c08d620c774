#pragma once

#include <string>
#include <vector>

namespace telenano::studies {

/// How often a wake-up was late by so many whole microseconds: index = lateness, last = that or more.
using LatenessHistogram = std::vector<long>;

/// What `cyclictest --histogram` prints: "000012 000345" lines, comments, "# Histogram Overflows: 00003".
/// Throws RunError for anything else.
LatenessHistogram parse_cyclictest(const std::string& text, std::size_t buckets);

/// The lateness in µs below or at which this part (0 … 1) of all wake-ups lie; NaN without any.
double quantile_us(const LatenessHistogram& histogram, double part);

}  // namespace telenano::studies

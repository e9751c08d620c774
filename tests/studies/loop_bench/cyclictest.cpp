#include "tests/studies/loop_bench/cyclictest.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <sstream>

#include "telenano/common/base/error.h"

namespace telenano::studies {

LatenessHistogram parse_cyclictest(const std::string& text, std::size_t buckets) {
  LatenessHistogram histogram(buckets + 1, 0);
  std::istringstream lines(text);
  bool any = false;
  for (std::string line; std::getline(lines, line);) {
    long overflow = 0;
    if (std::sscanf(line.c_str(), "# Histogram Overflows: %ld", &overflow) == 1) histogram.back() = overflow;
    if (line.empty() || line[0] < '0' || line[0] > '9') continue;
    long late_us = 0, count = 0;
    if (std::sscanf(line.c_str(), "%ld %ld", &late_us, &count) != 2 || late_us < 0 || count < 0 ||
        static_cast<std::size_t>(late_us) >= buckets)
      throw RunError("cyclictest printed a histogram line that is none: " + line);
    histogram[static_cast<std::size_t>(late_us)] = count;
    any = true;
  }
  if (!any) throw RunError("cyclictest printed no histogram");
  return histogram;
}

double quantile_us(const LatenessHistogram& histogram, double part) {
  const long total = std::accumulate(histogram.begin(), histogram.end(), 0L);
  if (total == 0) return std::numeric_limits<double>::quiet_NaN();
  // The smallest value such that at least this part lies at or below it.
  const auto wanted = static_cast<long>(std::ceil(part * static_cast<double>(total)));
  long seen = 0;
  for (std::size_t late = 0; late < histogram.size(); ++late) {
    seen += histogram[late];
    if (seen >= wanted) return static_cast<double>(late);
  }
  return static_cast<double>(histogram.size() - 1);
}

}  // namespace telenano::studies

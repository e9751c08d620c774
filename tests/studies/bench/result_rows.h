#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace telenano::studies {

/// One quantity of the product beside its floor, both measured in the same run.
struct BenchRow {
  std::string what;      ///< case, e.g. "polled"
  std::string quantity;  ///< with its unit, e.g. "p99_us"
  double product = 0;
  std::optional<double> floor;
  std::optional<double> target;  ///< of product/floor, or of the product where there is no floor
  bool at_least = false;         ///< the target is a lower bound
};

inline double measure_of(const BenchRow& row) {
  return row.floor ? row.product / *row.floor : row.product;
}
inline bool holds(const BenchRow& row) {
  return !row.target || (row.at_least ? measure_of(row) >= *row.target : measure_of(row) <= *row.target);
}

/// CSV on standard output, with a header: bench,case,quantity,product,floor,ratio,target,holds. In words on
/// standard error what misses its target.
void print_rows(const std::string& bench, const std::vector<BenchRow>& rows);

/// Smallest value that at least the fraction `q` of all do not exceed; 0 of none. Sorts.
inline double quantile(std::vector<double>& values, double q) {
  if (values.empty()) return 0;
  const auto wanted = static_cast<double>(values.size()) * q;
  auto index = static_cast<std::size_t>(wanted);
  if (static_cast<double>(index) == wanted && index > 0) --index;
  index = std::min(index, values.size() - 1);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(index), values.end());
  return values[index];
}
inline double median(std::vector<double> values) {
  return quantile(values, 0.5);
}

}  // namespace telenano::studies
